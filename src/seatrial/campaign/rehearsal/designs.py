"""Which trial to run next: the most informative of the campaign's designs given what is known, and random steps to compare with.

Informative by the Bayesian D gain 0.5 ln(|P^-1 + I(c)| / |P^-1|), with c the estimate so far, P the covariance of the coefficients
and I the Fisher information of the design about c under white noise of the size that `[sensors]` states. Over a grid it takes a
fraction of the time of the filter that `seatrial design` runs; `seatrial design --compare` says how alike they order designs.
"""

import zlib
from dataclasses import dataclass, replace
from functools import cached_property

import jax
import numpy as np
from jaxtyping import Array, Float

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.design.evaluate import plan_of
from seatrial.campaign.design.sweep import Designs
from seatrial.compiled.programs import program
from seatrial.core.errors import InputError, NumericalError
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.sweep import Trim, all_controls, in_blocks
from seatrial.design.trial_plan import TrialPlan

RANDOM = "random-steps"
"""Shape of the trials that are drawn and not designed."""


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

    def best_of(self, designs: Designs, kind: str) -> Design:
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
            raise NumericalError("the vehicle as estimated so far runs away under every design: narrow the priors")
        return self.design(int(np.nanargmax(gain)))

    def gains(self, values: Float[np.ndarray, " k"], cov: Float[np.ndarray, "k k"]) -> Float[np.ndarray, " D"]:
        """Bayesian D gain of every design, nats, NaN where the motion is not finite; arguments as `most_informative`."""
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
                expected="one at least, for the random steps with which designs are compared",
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


def design_space(campaign: Campaign, designs: Designs) -> DesignSpace:
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
