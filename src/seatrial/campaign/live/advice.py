"""One sentence for the operator: continue, stop, switch, check the stream, or the model is wrong; it never commands the vehicle.

The goal is never met while the stream is in doubt, the innovations are inconsistent with the model, the coefficients contradict the trim,
or one is at the edge of its prior. A true value may lie on a physical edge, such as X_u = 0. Then the mean of the filter, which has no
edges, is outside by about a standard deviation. A wrong unit or sign puts it many outside.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config.schema import Goal
from seatrial.campaign.live.innovations import InnovationMemory, discounted
from seatrial.campaign.live.next_segment import Choice, Library
from seatrial.campaign.live.recursion import Recursion, within_bounds
from seatrial.core.display_units import Shown, listed
from seatrial.core.signals import RATES, SPEEDS
from seatrial.estimation.diagnostics.record_checks import UNLIKE, unlike_trim
from seatrial.messages.render import remedy, statement
from seatrial.numerics.gaussian import Gaussian

WINDOW_SECONDS = 20.0  # Seconds over which is looked at what the input teaches, and how large innovations are
# Root mean square of normalised innovations from which the model is called wrong, and below which it no longer is
WRONG_RMS, RIGHT_RMS = 2.2, 2.0
# Standard deviations by which the mean of the filter is beyond the edge of a prior from where on its coefficient is
# pushed against it
PUSHED_SD = 3.0
PUSHED_SECONDS = 10.0  # Seconds after which that is forgotten
# Share of the vehicles drawn from what is believed whose speed at trim must be another than stated
MIN_UNLIKE_SHARE = 0.95
AT_EDGE = 0.5  # Standard deviations from the edge of its prior within which a coefficient is named, where one is pushed
MIN_INNOVATIONS = 50  # Innovations before which nothing is said of a goal
SOON_SECONDS = 30.0  # Seconds to the goal for which no other input is worth a change
MIN_TIMES_SLOWER = 2.0  # Times the best segment's way to the goal from which a change is
# Seconds in which an input that excites a coefficient halves its standard deviation, at the rate of the last window
HALVING_SECONDS = 600.0
VELOCITY_OF_AXIS = {"T": "u", **SPEEDS}  # Velocity that each force or moment changes
OFTEN = 10.0  # Seconds between two looks into the library

Kind = Literal["go on", "stop", "switch", "wrong", "check"]


@dataclass(frozen=True)
class Coefficient:
    """What is known of one coefficient.

    Attributes:
        name: of it.
        unit: in which its prior is written.
        mean: of the belief.
        sd: honest, see `seatrial.campaign.live.innovations`.
        goal: standard deviation that is wanted; None for none.
        is_excited: whether the input of the last window teaches it; None before that is known.
    """

    name: str
    unit: str
    mean: float
    sd: float
    goal: float | None
    is_excited: bool | None


@dataclass(frozen=True)
class Look:
    """What is known at one time.

    Attributes:
        time: s since the first sample.
        samples: that were used.
        coefficients: in the model's order.
        innovations: of each channel, root mean square over what its noise allows: of the last window, NaN if there are too few.
        discount: what the information of the filter was divided by, so that the standard deviations hold.
        kind: of the advice.
        advice: one sentence.
    """

    time: float
    samples: int
    coefficients: tuple[Coefficient, ...]
    innovations: Mapping[str, float]
    discount: float
    kind: Kind
    advice: str

    def lines(self) -> list[str]:
        """Return it as a block of text."""
        rate = f" at {self.samples / self.time:.3g} Hz" if self.time > 0 else ""
        lines = [f"{self.time:.1f} s, {self.samples} samples{rate}"]
        width = max(len(one.name) for one in self.coefficients)
        for one in self.coefficients:
            share = f" ({abs(one.sd / one.mean):.1%})" if one.sd < abs(one.mean) else ""
            goal = "" if one.goal is None else f", goal ± {one.goal:.2g}{' met' if one.sd <= one.goal else ''}"
            taught = {True: "excited", False: "not excited", None: ""}[one.is_excited]
            lines.append(
                f"  {one.name:<{width}}  {one.mean:.4g} ± {one.sd:.2g} {one.unit}{share}{goal}{', ' + taught if taught else ''}"
            )
        known = [f"{name} {value:.2f}" for name, value in self.innovations.items() if value == value]
        if known:
            lines.append("  innovations divided by their expected size, last 20 s: " + ", ".join(known))
        if self.discount > 1.1:
            lines.append(
                f"  ± is up to {np.sqrt(self.discount):.2g} times the filter's own: innovations are larger or slower than white noise"
            )
        return [*lines, f"=> {self.advice}"]

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON-able values."""
        rows = [
            {"name": c.name, "unit": c.unit, "mean": c.mean, "sd": c.sd, "goal": c.goal, "excited": c.is_excited}
            for c in self.coefficients
        ]
        innovations = {name: value if value == value else None for name, value in self.innovations.items()}
        about = {"time_s": self.time, "samples": self.samples, "coefficients": rows, "innovations": innovations}
        return {**about, "discount": self.discount, "kind": self.kind, "advice": self.advice}


@dataclass(eq=False)
class Adviser:
    """What looks remember of each other.

    Attributes:
        recursion: of the campaign.
        channels: measured, in the order of the innovations.
        goal: of the campaign, None for none.
        hold: seconds for which a goal has to be met before it is called so.
        shown: units of the coefficients.
        library: of segments; None if there is none.
    """

    recursion: Recursion
    channels: tuple[str, ...]
    goal: Goal | None
    hold: float
    shown: Shown
    library: Library | None = None
    known: list[tuple[float, np.ndarray]] = field(default_factory=list)
    met_since: float | None = None
    is_wrong: bool = False
    pushed: dict[int, float] = field(default_factory=dict)
    asked: float = -np.inf
    choice: Choice | None = None
    waiting: "Future[Choice] | None" = None
    failure: BaseException | None = None
    pool: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "seatrial library"))

    def look(
        self, time: float, samples: int, belief: Gaussian, memory: InnovationMemory, doubts: Sequence[str] = ()
    ) -> Look:
        """Judge what is known.

        Args:
            time: s since the first sample.
            samples: that were used.
            belief: about the coefficients, in units of the recursion.
            memory: of the innovations.
            doubts: of the stream, in words, the gravest first.
        """
        scales, rms = self.recursion.scales, memory.look(time, WINDOW_SECONDS)
        discount = memory.discount()
        honest = discounted(np.asarray(belief.cov), discount)
        cut = within_bounds(np.asarray(belief.mean), honest, self.recursion.bounds)
        mean = cut * scales
        sd = np.sqrt(np.diag(honest)) * scales
        raw = 1.0 / np.diag(np.asarray(belief.cov))
        # The information about each coefficient that a second has brought in the last window; None before half of one.
        self.known.append((time, raw))
        while len(self.known) > 2 and self.known[1][0] <= time - WINDOW_SECONDS:
            self.known.pop(0)
        then, before = self.known[0]
        rate = None if time - then < WINDOW_SECONDS / 2 else np.maximum(raw - before, 0.0) / (time - then)
        wanted = self._wanted(mean)
        if memory.count.sum() >= MIN_INNOVATIONS:
            raw_mean = np.asarray(belief.mean)
            doubts = (*doubts, *self._unlike_trim(raw_mean, honest), *self._edges(time, raw_mean, cut, honest))
        kind, advice = self._advise(time, memory, rms, sd, wanted, self._left(raw, rate, wanted, discount), doubts)
        if kind in ("go on", "switch") and self.library is not None and np.isfinite(wanted).any():
            self._ask(time, mean, honest, discount, wanted)
        excited = None if rate is None else rate * HALVING_SECONDS >= 3.0 * raw
        model = self.recursion.model
        rows = []
        for i, term in enumerate(model.coefficients):
            factor, unit = self.shown(term.text, model.unit_of(term))
            goal = float(wanted[i]) * factor if np.isfinite(wanted[i]) else None
            taught = None if excited is None else bool(excited[i])
            rows.append(Coefficient(term.text, unit, float(mean[i]) * factor, float(sd[i]) * factor, goal, taught))
        seen = dict(zip(self.channels, rms.tolist(), strict=True))
        return Look(time, samples, tuple(rows), seen, discount, kind, advice)

    @property
    def trimmed(self) -> list[str]:
        """Measured speeds of which a trim is stated."""
        return [name for name in RATES[:3] if name in self.channels and self.recursion.trim.get(name)]

    def _unlike_trim(self, mean: np.ndarray, cov: np.ndarray) -> list[str]:
        """Return which speed the coefficients give at trim, if it is surely not the one that is stated; in units of the recursion."""
        messages, trim = [], self.recursion.trim
        for name in self.trimmed:
            share = self.recursion.shares_of_trim(name, mean, cov)
            if np.mean(share > UNLIKE) >= MIN_UNLIKE_SHARE or np.mean(share < 1 / UNLIKE) >= MIN_UNLIKE_SHARE:
                one = unlike_trim(name, trim[name], float(np.nanmedian(share)), "coefficients")
                messages.append(f"{remedy(one)} ({statement(one)})")
        return messages

    def _edges(self, time: float, mean: np.ndarray, cut: np.ndarray, cov: np.ndarray) -> list[str]:
        """Return which coefficients are at the edges of their priors, if one is pushed against its own; in units of the recursion.

        Args:
            time: s.
            mean: of the filter, which knows no edges.
            cut: what is left of it inside.
            cov: honest.
        """
        bounds, sd = self.recursion.bounds, np.sqrt(np.diag(cov))
        beyond = np.maximum(bounds[:, 0] - mean, mean - bounds[:, 1]) > PUSHED_SD * sd
        self.pushed |= {int(i): time for i in np.flatnonzero(beyond)}
        self.pushed = {i: then for i, then in self.pushed.items() if 0 <= time - then < PUSHED_SECONDS}
        if not self.pushed:
            return []
        is_near = np.min(np.abs(cut[:, None] - bounds), axis=1) < AT_EDGE * sd
        terms = [term for i, term in enumerate(self.recursion.model.coefficients) if is_near[i] or i in self.pushed]
        names = listed([term.text for term in terms])
        where = "is at the edge of its prior" if len(terms) == 1 else "are at the edges of their priors"
        signals = {name for term in terms for name in (*term.signals, VELOCITY_OF_AXIS.get(term.axis, ""))}
        shown = [name for name in self.channels if name in signals] or list(self.channels)
        checked = [*shown, *(name for name in self.recursion.model.controls if name in signals)]
        return [f"{names} {where}: check the unit and sign of {listed(checked)}; if they are right, widen the priors"]

    def _wanted(self, mean: np.ndarray) -> Float[np.ndarray, " k"]:
        """Return the standard deviation that is wanted of each coefficient, SI; infinite if nothing is asked."""
        goal, wanted = self.goal or Goal(), np.full(mean.size, np.inf)
        for i, name in enumerate(self.recursion.names):
            by_share = goal.shares[name] * abs(mean[i]) if name in goal.shares else np.inf
            wanted[i] = min(goal.sds.get(name, np.inf), by_share)
        return wanted

    def _left(self, raw: np.ndarray, rate: np.ndarray | None, wanted: np.ndarray, discount: float) -> float | None:
        """Return the seconds to the goal at the rate of the last window; None if there is no rate or no goal."""
        if rate is None or not np.isfinite(wanted).any():
            return None
        with np.errstate(all="ignore"):
            needed = 1.0 + ((self.recursion.scales / wanted) ** 2 - 1.0) * discount
            return float(np.where(needed > raw, (needed - raw) / rate, 0.0).max())

    def _advise(
        self,
        time: float,
        memory: InnovationMemory,
        rms: np.ndarray,
        sd: np.ndarray,
        wanted: np.ndarray,
        left: float | None,
        doubts: Sequence[str],
    ) -> tuple[Kind, str]:
        is_met = bool((sd <= wanted).all()) and np.isfinite(wanted).any() and memory.count.sum() >= MIN_INNOVATIONS
        worst = int(np.argmax(np.where(np.isfinite(rms), rms, -np.inf)))
        self.is_wrong = bool(rms[worst] > (RIGHT_RMS if self.is_wrong else WRONG_RMS))
        is_met = is_met and not doubts and not self.is_wrong
        self.met_since = (time if self.met_since is None else self.met_since) if is_met else None
        if doubts:
            return "check", doubts[0]
        if self.is_wrong:
            return "wrong", (
                f"the model is wrong: innovations of {self.channels[worst]} are {rms[worst]:.1f} times as large as its sensor noise allows"
            )
        if not np.isfinite(wanted).any():
            return "go on", "continue: [goal] has no standard deviation to reach"
        if self.met_since is not None:
            if time - self.met_since >= self.hold:
                return "stop", "the goal is met: stop"
            return (
                "go on",
                f"continue: the goal is met, and must stay met for {self.hold - (time - self.met_since):.0f} s more",
            )
        if left is None:
            return "go on", "continue: there are too few samples to estimate the time"
        choice = self.choice
        if (
            left > SOON_SECONDS
            and choice is not None
            and (not np.isfinite(left) or left > MIN_TIMES_SLOWER * choice.seconds)
        ):
            if np.isfinite(choice.seconds):
                return (
                    "switch",
                    f"this input will not reach the goal: switch to {choice.words}, about {choice.seconds:.0f} s of it",
                )
            return "switch", (
                f"no input will reach the goal; {choice.unmet} stays furthest from it: switch to {choice.words}"
            )
        if not np.isfinite(left) or left > 100 * HALVING_SECONDS:
            short = self.recursion.names[int(np.argmax(sd / wanted))]
            return "switch", f"this input will not reach the goal: it gives no information about {short}; excite it"
        return "go on", f"continue; goal in about {left:.0f} s"

    def _ask(self, time: float, mean: np.ndarray, honest: np.ndarray, discount: float, wanted: np.ndarray) -> None:
        """Have the library weighed beside the samples, every ten seconds."""
        assert self.library is not None
        if self.waiting is not None and self.waiting.done():
            done, self.waiting = self.waiting, None
            self.failure = done.exception()
            if self.failure is None:
                self.choice = done.result()
        if self.waiting is None and time - self.asked >= OFTEN:
            scales, self.asked = self.recursion.scales, time
            information = np.linalg.inv(honest) / np.outer(scales, scales)
            self.waiting = self.pool.submit(self.library.choose, mean, information, 1.0 / discount, wanted)
