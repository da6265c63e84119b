"""Rehearsal of a campaign: how many trials its goal takes if each is chosen anew, against one design repeated and random steps.

Vehicles are drawn from the priors, and every strategy is run on each with the same noise until the goal is met:

- `adaptive`: the best design under the priors first, then the design of the largest Bayesian D gain given the trials so far, by
  Fisher information at the estimate (`rehearsal_designs`) and not by the filter of `seatrial design`, which is far slower.
- `fixed`: the best design under the priors, again and again.
- `doublet`: the best repeated doublet under the priors, again and again, if that is not the fixed design.
- `random`: random steps of the largest amplitude, new ones for each trial.

After each trial the posterior of all so far is its mode and the normal approximation there.
"""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.schema import Goal
from seatrial.campaign.design.plan import goal_of
from seatrial.campaign.design.problem import plan_of
from seatrial.campaign.design.sweep import design_first, design_key
from seatrial.campaign.rehearsal.result import ADAPTIVE, Rehearsal
from seatrial.campaign.rehearsal.vehicles import Vehicle, draw_vehicle, joint_posterior, run_trial
from seatrial.campaign.store.stored_result import Store, StoredResult, key_of
from seatrial.compiled.programs import program
from seatrial.compiled.random_keys import random_key
from seatrial.core.dataset import Dataset
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.record import Record
from seatrial.core.reporter import SILENT, Reporter, run_side_by_side
from seatrial.design.design_problem import check_whole_trials
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.sweep import Trim, all_controls, in_blocks
from seatrial.design.trial_design import TrialDesign
from seatrial.design.trial_plan import TrialPlan
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.simulation.disturbance import disturbance_name
from seatrial.manoeuvres.family import Family
from seatrial.vehicles.model import VehicleModel

# Which trial to run next: the most informative of the campaign's designs given what is known, and random steps to
# compare with.
#
# Informative by the Bayesian D gain 0.5 ln(|P^-1 + I(c)| / |P^-1|), with c the estimate so far, P the covariance of the coefficients
# and I the Fisher information of the design about c under white noise of the size that `[sensors]` states. Over a grid it takes a
# fraction of the time of the filter that `seatrial design` runs; `seatrial design --compare` says how alike they order designs.

RANDOM = "random-steps"  # Shape of the trials that are drawn and not designed


@dataclass(frozen=True, eq=False)
class Design:
    """One trial: its shape, settings (SI) and all that it commands, sampled."""

    kind: str
    amplitude: float
    period: float
    control: Float[np.ndarray, "n c"]


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """All D designs of the campaign's families that fit and are inside the limits, and the plan of a trial.

    Attributes:
        campaign: configuration.
        kind: shape of each.
        amplitude: SI, shape (D,).
        period: s, shape (D,).
        control: every command, SI, shape (D, n, c).
        plan: start, sensors and times of any trial.
    """

    campaign: Campaign
    kind: tuple[str, ...]
    amplitude: Float[np.ndarray, " D"]
    period: Float[np.ndarray, " D"]
    control: Float[np.ndarray, "D n c"]
    plan: TrialPlan

    def design(self, index: int) -> Design:
        """One of them."""
        return Design(self.kind[index], float(self.amplitude[index]), float(self.period[index]), self.control[index])

    def best_of(self, designs: TrialDesign, kind: str) -> Design:
        """The design of one family that was the most informative in a sweep."""
        sweep = next(sweep for sweep in designs.sweeps if sweep.family.kind == kind)
        row, column = sweep.best
        return Design(kind, float(sweep.amplitude[row]), float(sweep.period[column]), sweep.best_controls())

    def most_informative(self, values: Float[np.ndarray, " k"], cov: Float[np.ndarray, "k k"]) -> Design:
        """The design of the largest Bayesian D gain.

        A design under which a vehicle of these values would run away is not run.

        Args:
            values: coefficients as they are known so far, SI.
            cov: their covariance.

        Raises:
            NumericalError: the vehicle would run away under every design.
        """
        gain = self.gains(values, cov)
        if np.isnan(gain).all():
            raise NumericalError("the estimated vehicle diverges under every design: narrow the priors")
        return self.design(int(np.nanargmax(gain)))

    def gains(self, values: Float[np.ndarray, " k"], cov: Float[np.ndarray, "k k"]) -> Float[np.ndarray, " D"]:
        """Bayesian D gain of every design, nats, NaN if the motion is not finite; arguments as `most_informative`."""
        (information,) = in_blocks(lambda part: (_information(self.plan, np.asarray(values), part),), self.control)
        finite = np.all(np.isfinite(information), axis=(1, 2))
        gain = find_criterion("fisher-d", cov)(np.where(finite[:, None, None], information, 0.0))
        return np.where(finite, gain, np.nan)

    def random(self, vehicle: int, number: int) -> Design:
        """Random steps of the largest amplitude, held as long as the middle of the grid says; new ones for every trial.

        They keep the limits of the control; those of the motion are not looked at.
        """
        seed = zlib.crc32(f"{self.campaign.seed} {vehicle} {number}".encode())
        hold = float(np.mean(self.campaign.design.grid()[1]))
        family = replace(self.campaign.family, kind=RANDOM, seed=seed)
        controls = all_controls(family, self.trim, np.array([self.swing]), np.array([hold]))
        return Design(RANDOM, self.swing, hold, controls[0])

    @property
    def trim(self) -> Trim:
        """Every command at trim."""
        return self.campaign.control_trim(self.plan.model)

    @cached_property
    def swing(self) -> float:
        """Largest amplitude of the grid from whose one end the control may go to the other."""
        family, limits = self.campaign.family, self.campaign.limits
        time = max(family.ramp, family.sample_time)
        amplitudes = self.campaign.design.grid()[0]
        inside = [a for a in amplitudes if not limits.excess(family.trim + a * np.array([-1.0, 1.0, -1.0]), time)]
        if not inside:
            raise InputError(
                self.campaign.where("design.amplitude"),
                found=f"amplitudes from {amplitudes[0]:g} (SI), none of which may be stepped to both sides of trim",
                expected="at least one, for the random steps that are compared with designs",
                remedy="lower the amplitudes or lengthen `ramp`",
            )
        return float(max(inside))

    @cached_property
    def trying(self) -> Float[np.ndarray, "D n c"]:
        """All designs, behind the least and the largest of any command, each held throughout, SI."""
        reach = self.swing * np.array([self._ratios.get(name, 0.0) for name, _ in self.trim])
        trim = np.array([value for _, value in self.trim])
        low = np.minimum(self.control.min((0, 1)), trim - reach)
        high = np.maximum(self.control.max((0, 1)), trim + reach)
        held = np.broadcast_to(np.stack([low, high])[:, None], (2, *self.control.shape[1:]))
        return np.concatenate([held, self.control])

    @property
    def _ratios(self) -> dict[str, float]:
        """Amplitude of each command that moves, over that of the driven one."""
        family = self.campaign.family
        return {family.control: 1.0, **{one.control: one.ratio for one in family.beside}}


def design_space(campaign: Campaign, designs: TrialDesign) -> DesignSpace:
    """All designs that a first sweep found to fit and to keep inside the limits."""
    kinds, parts = [], []
    for sweep in designs.sweeps:
        rows, columns, control = sweep.inside()
        kinds += [sweep.family.kind] * rows.size
        parts.append((sweep.amplitude[rows], sweep.period[columns], control))
    amplitudes, periods, controls = (np.concatenate(column) for column in zip(*parts, strict=True))
    plan = plan_of(campaign, campaign.model(campaign.full))
    return DesignSpace(campaign, tuple(kinds), amplitudes, periods, controls, plan)


@program
def _information(plan: TrialPlan, values: Array, controls: Float[Array, "lanes n c"]) -> Float[Array, "lanes k k"]:
    return jax.vmap(lambda control: plan.information(values, control))(controls)


DOUBLET = "repeated-doublet"
MIN_VEHICLES = 2  # Of one alone there is no standard error
# What is kept; NaN, or -1 for the family, of trials that were not run
DIMENSIONS = {
    "truth": ("vehicle", "coefficient"),
    "refused": ("vehicle",),
    "trials": ("vehicle", "strategy"),
    "met": ("vehicle", "strategy"),
    "estimate": ("vehicle", "strategy", "trial", "coefficient"),
    "sd": ("vehicle", "strategy", "trial", "coefficient"),
    "family": ("vehicle", "strategy", "trial"),
    "amplitude": ("vehicle", "strategy", "trial"),
    "period": ("vehicle", "strategy", "trial"),
}

Choose = Callable[[int, np.ndarray | None, np.ndarray | None], Design]
"""Design of a trial: from its number, and the coefficients' values and covariance after the trials before, None of the first."""
Outcome = dict[str, np.ndarray]


def rehearse(campaign: Campaign, vehicles: int, reporter: Reporter = SILENT) -> Rehearsal:
    """Rehearse a campaign on vehicles drawn from its priors; a rehearsal that was interrupted, or is to be larger, goes on.

    The goal is the standard deviations of `[goal]`; whether one structure is decided is not rehearsed.

    Args:
        campaign: configuration.
        vehicles: how many, two at least.
        reporter: receives what happens.

    Raises:
        InputError: no standard deviation is asked for, or too few vehicles.
        NumericalError: a prior of which hardly a draw can be simulated.
    """
    check_whole_trials(campaign.design.per, campaign.where, "a rehearsal", joules=True)
    if any(name.startswith(disturbance_name("")) for name in campaign.priors):
        campaign.check_no_autopilot("a rehearsal of disturbances")
    goal = goal_of(campaign)
    if vehicles < MIN_VEHICLES:
        raise InputError(
            "rehearsal", found=f"{vehicles} vehicles", expected=f"{MIN_VEHICLES} at least", remedy="ask for more"
        )
    kept = stored_rehearsal(campaign)
    outcomes = _outcomes(kept.read().data) if kept.is_current() else []
    if len(outcomes) < vehicles:
        designs = design_first(campaign, reporter)
        space = design_space(campaign, designs)
        fixed = {"fixed": space.best_of(designs, designs.best.family.kind)}
        if any(sweep.family.kind == DOUBLET for sweep in designs.sweeps[1:]):
            fixed["doublet"] = space.best_of(designs, DOUBLET)
        report = reporter.progress(f"rehearse {vehicles} vehicles")
        report(len(outcomes), vehicles)
        while len(outcomes) < vehicles:
            outcomes.append(_rehearse_one(campaign, goal, space, fixed, len(outcomes)))
            kept.write(
                Rehearsal(
                    _dataset(campaign.model(campaign.full), campaign.families, (ADAPTIVE, *fixed, "random"), outcomes)
                )
            )
            report(len(outcomes), vehicles)
    return Rehearsal(kept.read().data.isel(vehicle=slice(vehicles)))


def known_after(campaign: Campaign, records: Sequence[Record], most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mode of the full structure's k coefficients and their covariance, SI, given all records of a vehicle.

    Args:
        campaign: configuration.
        records: trials of one vehicle, from `run_trial`.
        most: trials there can be, see `joint_posterior`.
    """
    posterior, k = joint_posterior(campaign, records, most), len(campaign.model(campaign.full).coefficients)
    mode = find_mode(posterior, key=random_key(campaign.seed, "rehearsal mode"))
    slope = np.asarray(jax.jvp(posterior.constrain, (jnp.asarray(mode.z),), (jnp.ones(posterior.dim),))[1])
    return mode.values[:k], (mode.cov * np.outer(slope, slope))[:k, :k]


def stored_rehearsal(campaign: Campaign) -> StoredResult[Rehearsal]:
    """Return where a rehearsal is kept, of as many vehicles as there are so far, and what it depends on."""
    return StoredResult(
        Store(campaign.folder).rehearsal,
        rehearsal_key(campaign),
        Rehearsal,
        f"seatrial plan {campaign.folder} --vehicles 20",
    )


def rehearsal_key(campaign: Campaign) -> str:
    """Key of a rehearsal of any number of vehicles."""
    goal = goal_of(campaign)
    return key_of(
        "rehearsal",
        design_key(campaign),
        {"shares": dict(goal.shares), "sds": dict(goal.sds), "trials": goal.trials},
        campaign.estimation,
        campaign.seed,
    )


def _rehearse_one(
    campaign: Campaign, goal: Goal, space: DesignSpace, fixed: Mapping[str, Design], index: int
) -> Outcome:
    """Every strategy on one vehicle."""
    vehicle = draw_vehicle(
        campaign, space.plan, space.trying, jax.random.fold_in(random_key(campaign.seed, "rehearsal"), index)
    )

    def adaptive(number: int, values: np.ndarray | None, cov: np.ndarray | None) -> Design:
        return fixed["fixed"] if values is None or cov is None else space.most_informative(values, cov)

    def repeated(design: Design, number: int, values: np.ndarray | None, cov: np.ndarray | None) -> Design:
        return design

    def drawn(number: int, values: np.ndarray | None, cov: np.ndarray | None) -> Design:
        return space.random(index, number)

    strategies: Sequence[Choose] = [adaptive, *(partial(repeated, one) for one in fixed.values()), drawn]
    outcomes = run_side_by_side([partial(_run_strategy, campaign, goal, vehicle, choose) for choose in strategies])
    names = [term.text for term in campaign.model(campaign.full).coefficients]
    each = {name: np.stack([outcome[name] for outcome in outcomes]) for name in outcomes[0]}
    return {
        "truth": np.array([vehicle.values[name] for name in names]),
        "refused": np.array(vehicle.refused),
        **each,
    }


def _run_strategy(campaign: Campaign, goal: Goal, vehicle: Vehicle, choose: Choose) -> Outcome:
    """Trials of one vehicle until the goal is met."""
    names = [term.text for term in campaign.model(campaign.full).coefficients]
    most, kinds = goal.trials, _kinds(campaign.families)
    estimate, sd = np.full((2, most, len(names)), np.nan)
    family, (amplitude, period) = np.full(most, -1), np.full((2, most), np.nan)
    records: list[Record] = []
    values = cov = None
    met = False
    while not met and len(records) < most:
        i = len(records)
        design = choose(i + 1, values, cov)
        records.append(run_trial(campaign, vehicle, i + 1, design.control))
        values, cov = known_after(campaign, records, most)
        estimate[i], sd[i] = values, np.sqrt(np.diag(cov))
        family[i], amplitude[i], period[i] = kinds.index(design.kind), design.amplitude, design.period
        met = not goal.unmet({name: (values[j], sd[i, j]) for j, name in enumerate(names)})
    return {
        "trials": np.array(len(records)),
        "met": np.array(int(met)),
        "estimate": estimate,
        "sd": sd,
        "family": family,
        "amplitude": amplitude,
        "period": period,
    }


def _kinds(families: Sequence[Family]) -> list[str]:
    kinds = [family.kind for family in families]
    return kinds if RANDOM in kinds else [*kinds, RANDOM]


def _outcomes(data: Dataset) -> list[Outcome]:
    return [{name: data[name].values[i] for name in DIMENSIONS} for i in range(data.sizes["vehicle"])]


def _dataset(
    model: VehicleModel, families: tuple[Family, ...], strategies: Sequence[str], outcomes: Sequence[Outcome]
) -> Dataset:
    stacked = {name: (dims, np.stack([one[name] for one in outcomes])) for name, dims in DIMENSIONS.items()}
    names = [term.text for term in model.coefficients]
    data = Dataset(stacked, {"strategy": list(strategies), "coefficient": names})
    data["family"].attrs = {
        "flag_values": np.arange(len(_kinds(families))),
        "flag_meanings": " ".join(_kinds(families)),
    }
    data["amplitude"].attrs, data["period"].attrs = {"units": "SI"}, {"units": "s"}
    return data
