"""The next trial of one vehicle: of some families, amplitudes and periods the one that tells most about its coefficients."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.compiled.engine import check_precision
from seatrial.core.argument_checks import check_array, check_each_of, check_kind, check_numbers
from seatrial.core.errors import InputError
from seatrial.core.result_table import table_html, table_text
from seatrial.design.prior_belief import coefficient_space, normal_belief, normal_of
from seatrial.design.sweep import Sweep, sweep_family
from seatrial.estimation.posterior.posterior import check_priors
from seatrial.estimation.posterior.simulated_record import checked_rates
from seatrial.estimation.priors import Prior
from seatrial.manoeuvres.family import Family, design_words
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import Schedule
from seatrial.numerics.gaussian import Gaussian
from seatrial.sampling.run import Draws
from seatrial.vehicles.model import VehicleModel

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class TrialDesign:
    """What was looked at, and the best of it.

    Attributes:
        sweeps: the entropy reduction of every design, one sweep for each family that has a design inside the limits, the best first.
        refused: why each other family has none, by its kind.
        sd_before: standard deviation of each coefficient before the trial, SI, by name.
        sd_after: what is predicted of it after the best trial.
        units: SI unit of each, by name.
    """

    sweeps: tuple[Sweep, ...]
    refused: Mapping[str, str]
    sd_before: Mapping[str, float]
    sd_after: Mapping[str, float]
    units: Mapping[str, str]

    @property
    def gain(self) -> float:
        """Entropy reduction that the best trial promises, nats."""
        best = self.sweeps[0]
        return float(best.gain[best.best])

    @property
    def schedule(self) -> Schedule:
        """Controls of the best trial, SI."""
        best = self.sweeps[0]
        row, column = best.best
        held = {name: value for name, value in best.trim if name != best.family.control}
        return best.family.schedule(float(best.amplitude[row]), float(best.period[column]), **held)

    def summary(self) -> "DataFrame":
        """Return a table with a row for each coefficient: its SI unit, its standard deviation before and after the best trial, and the
        share of it that is left."""
        from pandas import DataFrame

        after = [self.sd_after[name] for name in self.sd_before]
        return DataFrame(
            {
                "unit": [self.units[name] for name in self.sd_before],
                "sd_before": list(self.sd_before.values()),
                "sd_after": after,
                "left": np.divide(after, list(self.sd_before.values())),
            },
            index=list(self.sd_before),
        )

    @property
    def _heading(self) -> str:
        best = self.sweeps[0]
        row, column = best.best
        words = design_words(best.family, float(best.amplitude[row]), float(best.period[column]))
        return f"{words}: {self.gain:.2f} nat"

    @property
    def _remarks(self) -> list[str]:
        return [f"{kind}: no design, {why}" for kind, why in self.refused.items()]

    __repr__ = table_text
    _repr_html_ = table_html


def design_trial(
    model: VehicleModel,
    belief: Draws | Mapping[str, Prior],
    families: Family | Sequence[Family],
    amplitude: Sequence[float],
    period: Sequence[float],
    noise: Mapping[str, float],
    *,
    start: Mapping[str, float] | None = None,
    held: Mapping[str, float] | None = None,
    limits: Limits = Limits(),
    rates: Mapping[str, float] | None = None,
) -> TrialDesign:
    """Predict how much every trial of some families would tell, by running a filter over the motion that is expected.

    Args:
        model: vehicle; what it leaves open is what the trial is to tell.
        belief: draws of a posterior, or priors, of its coefficients by name, SI.
        families: shapes of the driven control, with its trim and timing.
        amplitude: changes from trim, SI.
        period: s.
        noise: standard deviation of each measured channel, SI.
        start: state at the first sample, signal name to SI value; 0 where nothing is said.
        held: value of every control that is not driven, SI.
        limits: bounds of the driven control.
        rates: samples a second of sensors that are slower than the families' sample time, 1/s.

    Returns:
        every design that was looked at with its entropy reduction, nats, and the best of them.

    Raises:
        InputError: no design inside the limits, something unknown of a coefficient or a control, an amplitude of 0, or a rate that no
            schedule of the families can have.
        NumericalError: the expected motion diverges for a design inside the limits.
    """
    check_precision()
    check_kind(
        model, VehicleModel, "model", 'build it of a vehicle: load_vehicle("remus100_surge").build(free=["X_u"])'
    )
    shapes = [families] if isinstance(families, Family) else families
    chosen = check_each_of(shapes, Family, "families", "give one Family, or a list of them")
    grid = check_array(amplitude, "amplitude"), check_array(period, "period")
    if still := [i for i, size in enumerate(grid[0]) if size == 0]:
        raise InputError(
            f"amplitude[{still[0]}]",
            found="0, with which nothing moves",
            expected="a change from trim that is not 0",
            remedy="leave it out",
        )
    noise = check_numbers(noise, "noise", known=model.channel_units(), above=0.0)
    start = check_numbers(start, "start", known=model.states)
    held = check_numbers(held, "held", known=model.controls)
    for family in chosen:
        checked_rates(rates, noise, family.time())
    check_kind(limits, Limits, "limits", "write for example Limits(upper=150.0)")
    if not (noise and chosen):
        raise InputError(
            "families" if noise else "noise",
            found="none",
            expected="one family at least" if noise else "one measured channel at least",
            remedy="name what is driven" if noise else 'give its standard deviation, for example {"u": 0.02}',
        )
    names = tuple(term.text for term in model.coefficients)
    before = _belief(belief, names)
    state = tuple(start.get(name, 0.0) for name in model.states)
    space, scales = coefficient_space(model, before, state, noise)
    sweeps, refused = [], {}
    for family in chosen:
        trim = _trim(model, family, held)
        mask = _measured(family, noise, rates or {})
        try:
            sweeps.append(sweep_family(space, family, *grid, limits, measured=mask, trim=trim))
        except InputError as error:
            if len(chosen) == 1:
                raise
            refused[family.kind] = error.sentence(with_remedy=False)
    if not sweeps:
        raise InputError(
            "families",
            found="; ".join(f"{kind}: {why}" for kind, why in refused.items()),
            expected="one design at least inside the limits",
            remedy="lower the amplitudes, choose other periods, or widen the limits if the vehicle allows it",
        )
    sweeps.sort(key=lambda sweep: -sweep.gain[sweep.best])
    after = sweeps[0].final_sd[sweeps[0].best] * scales
    return TrialDesign(
        tuple(sweeps),
        refused,
        dict(zip(names, map(float, scales), strict=True)),
        dict(zip(names, map(float, after), strict=True)),
        {term.text: term.unit for term in model.coefficients},
    )


def _belief(belief: Draws | Mapping[str, Prior], names: tuple[str, ...]) -> Gaussian:
    """Return the joint normal of the coefficients, SI."""
    if isinstance(belief, Draws):
        return normal_belief(belief.array(names))
    check_priors(belief, "belief")
    if missing := [name for name in names if name not in belief]:
        raise InputError(
            "belief",
            found="none of " + ", ".join(missing),
            expected="a prior of each of " + ", ".join(names),
            remedy="add them, or fix these coefficients in the vehicle",
        )
    return normal_of(tuple(belief[name] for name in names))


def _trim(model: VehicleModel, family: Family, held: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    known = {**held, family.control: family.trim}
    if family.control not in model.controls or any(name not in known for name in model.controls):
        raise InputError(
            f"manoeuvre {family.kind}, controls",
            found=", ".join(known),
            expected="a value of " + ", ".join(model.controls),
            remedy="drive one of them, and give the others in `held`",
        )
    return tuple((name, float(known[name])) for name in model.controls)


def _measured(family: Family, noise: Mapping[str, float], rates: Mapping[str, float]) -> np.ndarray:
    """Return 1 where each sensor gives a sample, 0 between, shape (n, m)."""
    time = family.time()
    steps = [max(1, round(1.0 / (rates[name] * family.sample_time))) if name in rates else 1 for name in noise]
    return np.column_stack([(np.arange(time.size) % every == 0).astype(float) for every in steps])
