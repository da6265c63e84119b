"""What to do next: run which trial and for what, or stop and why.

Of two structures with expected log Bayes factor m after the trial, the log odds are normal with mean l + m and variance 2 m if the one
with log odds l now is true; they are settled beyond 19 to 1. It holds where a trial is linear in what the structures differ by.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.import_table import ImportTable
from seatrial.campaign.config.schema import Goal
from seatrial.campaign.data.simulate import Chosen, chosen_of
from seatrial.campaign.design.residual_noise import noise_words
from seatrial.campaign.inference.judge_predictions import fitted_failures, held_back_alarms, hold_back_words
from seatrial.campaign.inference.quick_estimates import FirstAnswer
from seatrial.campaign.workflow.outcome import Outcome
from seatrial.core.display_units import listed, percent
from seatrial.design.trial_design import TrialDesign
from seatrial.estimation.diagnostics.known import ErrorShares
from seatrial.manoeuvres.family import design_words
from seatrial.messages.render import sentences
from seatrial.messages.structures import BETTER_EVIDENCE, condition_of, one_design, trial_words
from seatrial.selection.contenders import Contenders
from seatrial.selection.verdict import DECIDED

EXAMPLE_GOAL = Goal({"X_uabsu": 0.03}, trials=4)  # That of the template `design`

POINTER = "see the caution about it"  # What stands for a caution that is told on the same page
MIN_GAIN = 0.2  # Entropy reduction, nats, below which another trial of the family is not worth running


@dataclass(frozen=True)
class KnownCoefficient:
    """What is known of one coefficient, SI.

    Attributes:
        mean: the value to quote.
        sd: its standard deviation.
        shares: what that is made of.
        cause: what adds most to it if that is not the noise, in words.
    """

    mean: float
    sd: float
    shares: ErrorShares = ErrorShares()
    cause: str = ""

    @property
    def rest(self) -> float:
        """The part of the standard deviation that no trial of the same kind narrows: all but noise and the choice of terms."""
        return self.sd * float(np.sqrt(max(0.0, 1.0 - self.shares.noise - self.shares.terms)))

    def after(self, sd: float, *, decided: bool) -> float:
        """Return the standard deviation after a trial.

        Args:
            sd: noise that the trial leaves.
            decided: whether the trial decides about the terms.
        """
        open_part = 0.0 if decided else self.sd * float(np.sqrt(self.shares.terms))
        return min(self.sd, float(np.linalg.norm([sd, self.rest, open_part])))


Known = Mapping[str, KnownCoefficient]


@dataclass(frozen=True)
class Proposal:
    """The next trial, or none.

    Attributes:
        trial: what to run; None to stop.
        standing: where the campaign stands.
        advice: what to run and what it promises, or why to stop.
        expected: standard deviations after the trial, and the noise that they assume, in words.
        why: what has to be corrected first; empty if no health check failed.
        quoted: that check, in the words of its caution or alarm.
    """

    trial: Chosen | None
    standing: tuple[str, ...]
    advice: tuple[str, ...]
    expected: tuple[str, ...] = ()
    why: str = ""
    quoted: str = ""

    @property
    def first(self) -> tuple[str, ...]:
        """What to correct first, if anything."""
        return (f"{self.why}: {self.quoted}",) if self.why else ()

    @property
    def words(self) -> tuple[str, ...]:
        """What to do, without where the campaign stands."""
        return (*self.first, *self.advice, *self.expected)

    @property
    def lines(self) -> tuple[str, ...]:
        """All of it in words."""
        return (*self.standing, *self.words)

    def beside(self, cautions: Collection[str]) -> "Proposal":
        """Return it for a page that prints these cautions too: one that it quotes is only pointed at."""
        return replace(self, quoted=POINTER) if self.quoted in cautions else self


def propose(outcome: Outcome) -> Proposal:
    """Weigh the goal, the doubt about the structure and what the best designs promise, after what failed."""
    if (wrong := _wrong(outcome)) is not None:
        return wrong
    standing = _standing(outcome)
    proposal, failed = _weighed(outcome, standing), _failed(outcome)
    if not failed or proposal.why or outcome.next is None:
        return proposal
    if proposal.trial is None:
        proposal = Proposal(None, standing, ("no trial yet: there is an alarm; run again after the correction",))
    return replace(proposal, why="first correct the failure", quoted=failed)


def _failed(outcome: Outcome) -> str:
    """Return which failed check of the chosen structure, or of the choice if that is asked for, comes first; empty if none failed."""
    goal, choice = outcome.campaign.goal, outcome.selection
    if outcome.own_alarms:
        return outcome.own_alarms[0]
    if (goal is None or goal.decided) and not choice.is_reliable and not choice.is_settled:
        return f"the evidence does not separate the models yet; {BETTER_EVIDENCE}"
    return outcome.disowned


def _weighed(outcome: Outcome, standing: tuple[str, ...]) -> Proposal:
    goal, doubt = outcome.campaign.goal, _in_doubt(outcome)
    unmet = _unmet(goal, _known(outcome))
    counting = goal is not None and goal.only_trials
    if goal is not None and not unmet and not doubt:
        if not counting and outcome.disowned:
            why = "no trial yet: the goal is met only if the ± is right, but the residuals contradict it"
            return Proposal(None, standing, (), why=why, quoted=outcome.disowned)
        if not counting:
            words = f"the goal is met: {_goal_words(outcome)}"
            missing = before_stop(outcome.campaign.imports, outcome.campaign.goal, bool(outcome.trials.predict))
            advice = (f"{words}; before you stop, {'; and '.join(missing)}",) if missing else (f"stop: {words}",)
            return Proposal(None, standing, advice)
        if len(outcome.trials.fit) >= goal.trials:
            trials = f"{goal.trials} trial{'s are' if goal.trials != 1 else ' is'}"
            return Proposal(None, standing, (f"stop: {trials} run, as [goal] requires",))
    if outcome.next is None:
        why = outcome.undesigned or "add [design] to the campaign to choose one from its designs"
        return Proposal(None, standing, (f"no trial is proposed: {why}",))
    contenders = outcome.contenders
    if doubt and contenders is not None and (odds := settling(contenders, outcome.selection.probability)) > 1 - DECIDED:
        promise = f"it settles {' against '.join(contenders.labels)} with probability {odds:.2f} ({contenders.nats:.2g} nat expected)"
        if not unmet or odds > 0.5:
            return _run(
                outcome.next, contenders.decisive, _known(outcome), _noise(outcome), standing, promise, decides=True
            )
    if not doubt and (stop := _beyond_trials(goal, _known(outcome))):
        return Proposal(None, standing, (stop,))
    proposal = _most_informative(outcome.next, _known(outcome), _noise(outcome), standing, counting)
    if contenders is None or outcome.selection.is_settled:
        return proposal
    return replace(proposal, advice=(*proposal.advice, trial_words(contenders, outcome.selection)))


def before_stop(imports: ImportTable | None, goal: Goal | None, is_tested: bool) -> list[str]:
    """Return what is missing before a goal that is met is a reason to stop.

    Args:
        imports: runs and their logs; None if none is imported.
        goal: end of the campaign; None if not stated.
        is_tested: whether a run was held back. Of simulated trials none is: the vehicle is known.
    """
    missing = []
    if imports is not None and not is_tested:
        missing.append(f"test the model, because no run was held back: {hold_back_words(imports)}")
    if goal == EXAMPLE_GOAL:
        missing.append("state the precision that you need in [goal]: this goal is the example of the template")
    return missing


def propose_by_mode(campaign: Campaign, first: FirstAnswer, designs: TrialDesign, trials: int) -> Proposal:
    """Weigh the goal and what the best designs promise, by the posterior mode of the most probable structure.

    Args:
        campaign: with its goal.
        first: the mode.
        designs: swept from draws about it.
        trials: that were fitted.
    """
    known = {
        name: KnownCoefficient(value, sd, first.shares.get(name, ErrorShares()), first.causes.get(name, ""))
        for name, _, ((value, sd),) in first.rows
    }
    goal = campaign.goal
    unmet = _unmet(goal, known)
    head = f"after {trials} trial{'s' * (trials != 1)}, by the posterior mode of {first.structure.label}:"
    standing = [head, *_unmet_lines(unmet, known)]
    counting = goal is not None and goal.only_trials
    if goal is not None and not (unmet or goal.decided or counting):
        confirm = "confirm it by `seatrial next` without --by"
        missing = before_stop(
            campaign.imports, campaign.goal, campaign.imports is not None and bool(campaign.imports.predict)
        )
        advice = f"before you stop, {'; and '.join([*missing, confirm])}" if missing else confirm
        stop = "" if missing else "stop: "
        return Proposal(None, tuple(standing), (f"{stop}the posterior mode meets the goal; {advice}",))
    assert first.drawn is not None
    if stop := _beyond_trials(goal, known):
        return Proposal(None, tuple(standing), (stop,))
    return _most_informative(designs, known, noise_words(campaign, first.drawn), tuple(standing), counting)


def _beyond_trials(goal: Goal | None, known: Known) -> str:
    """Return why no trial is proposed if none can meet what is left of the goal: empty if one may."""
    unmet = _unmet(goal, known)
    if not unmet or any(known[name].rest <= known[name].sd / ratio for name, ratio in unmet.items()):
        return ""
    causes = listed(list(dict.fromkeys(known[name].cause or "errors other than noise" for name in unmet)))
    return f"stop: no trial of this kind meets the goal for {listed(list(unmet))}: correct {causes} first"


def _most_informative(
    designs: TrialDesign, known: Known, noise: str, standing: tuple[str, ...], counting: bool
) -> Proposal:
    gain = float(designs.best.gain[designs.best.best])
    if gain < MIN_GAIN and not counting:
        why = f"stop: another trial of this kind would give little information ({gain:.2f} nat): change sensors, limits or manoeuvres"
        return Proposal(None, standing, (why,))
    return _run(designs, designs.best.best, known, noise, standing, _gain_words(gain, len(designs.names)))


def settling(contenders: Contenders, probability: Sequence[float]) -> float:
    """Probability that the decisive design settles between the two most probable structures, at 19 to 1."""
    first, second = -np.sort(-np.asarray(probability))[:2]
    if second <= 0:
        return 1.0
    share, odds, m = first / (first + second), float(np.log(first / second)), max(contenders.nats, 1e-12)
    enough, spread = np.log(DECIDED / (1 - DECIDED)), np.sqrt(2 * m)

    def beyond(mean: float) -> float:
        normal = NormalDist(0.0, spread)
        return normal.cdf(mean - enough) + normal.cdf(-mean - enough)

    return share * beyond(odds + m) + (1 - share) * beyond(-odds + m)


def _gain_words(gain: float, count: int) -> str:
    """Return the effect of an entropy reduction, nats, on one of so many coefficients.

    The entropy is the sum of the logarithms of the standard deviations along the axes of the covariance: exp(-gain / count) is the
    geometric mean of their ratios after and before, and of those of the coefficients themselves if the correlations stay as they were.
    """
    less = percent(1.0 - float(np.exp(-gain / count)))
    if count == 1:
        return f"it reduces the noise in the ± of the coefficient by {less} ({gain:.2f} nat)"
    return f"it reduces the noise in the ± by {less} on average ({gain:.2f} nat for {count} coefficients)"


def _noise(outcome: Outcome) -> str:
    return noise_words(outcome.campaign, outcome.chosen)


def _known(outcome: Outcome) -> Known:
    return {row.name: KnownCoefficient(row.mean, row.sd, row.shares, row.cause) for row in outcome.summary.quote}


def _unmet(goal: Goal | None, known: Known) -> dict[str, float]:
    return {} if goal is None else goal.unmet({name: (one.mean, one.sd) for name, one in known.items()})


def _unmet_lines(unmet: Mapping[str, float], known: Known) -> list[str]:
    """Return how well each coefficient is known whose goal is not met, and how much of that no trial narrows."""
    lines = []
    for name, ratio in unmet.items():
        one, size = known[name], abs(known[name].mean)
        stays = f"; without noise it would be {percent(one.rest / size)}: {one.cause}" if one.cause else ""
        lines.append(f"{name} is known to {_beside_wanted(one.sd / size, one.sd / ratio / size)} wanted{stays}")
    return lines


def _in_doubt(outcome: Outcome) -> bool:
    goal = outcome.campaign.goal
    return (goal is None or goal.decided) and float(max(outcome.selection.probability)) < DECIDED


def _standing(outcome: Outcome) -> tuple[str, ...]:
    trials, chosen = len(outcome.trials.fit), outcome.chosen.structure.label
    unless = "" if outcome.selection.is_settled else condition_of(outcome.selection)
    probability = f"{float(max(outcome.selection.probability)):.2f}{unless}"
    lines = [f"after {trials} trial{'s' * (trials != 1)}: {chosen} with probability {probability}"]
    known = _known(outcome)
    return (*lines, *_unmet_lines(_unmet(outcome.campaign.goal, known), known))


def _goal_words(outcome: Outcome) -> str:
    """Name what was wanted: each standard deviation as a share of the value, and whether one model was to hold the probability."""
    goal, known = outcome.campaign.goal, _known(outcome)
    assert goal is not None
    shares = {**goal.shares, **{name: sd / abs(known[name].mean) for name, sd in goal.sds.items() if name in known}}
    wanted = [
        f"{name} to {percent(shares[name])}" if name in known else f"no {name} in the model"
        for name in (*goal.shares, *goal.sds)
    ]
    return listed([*wanted, *(["one model"] if goal.decided else [])])


def _beside_wanted(share: float, wanted: float) -> str:
    """Both in per cent, with as many digits as separate them."""
    if percent(share) != percent(wanted):
        return f"{percent(share)}, {percent(wanted)}"
    return f"{100 * share:.4g} %, {100 * wanted:.4g} %"


def _wrong(outcome: Outcome) -> Proposal | None:
    """What forbids to believe the model; None if nothing does."""
    failures = [
        ("the model does not explain the fitted runs", text) for text in sentences(fitted_failures(outcome.fits))
    ]
    failures += [("an effect is missing", text) for text in sentences(outcome.chosen.left_out)]
    unseen = sentences(held_back_alarms(outcome.fits, outcome.pooled))
    failures += [("the model fails on held-back runs", text) for text in unseen]
    if not failures:
        return None
    why, quoted = failures[0]
    failed = [fit for fit in outcome.fits if fit.held_back and fit.level == "fail"]
    further = " or, if runs leave the fitted range, fit such runs" if any(fit.outside for fit in failed) else ""
    advice = f"more trials would narrow the error bars without removing the error: correct the model{further} before the next one"
    return Proposal(None, _standing(outcome), (advice,), why=f"stop: {why}", quoted=quoted)


def _run(
    designs: TrialDesign,
    at: tuple[int, int],
    known: Known,
    noise: str,
    standing: tuple[str, ...],
    promise: str,
    *,
    decides: bool = False,
) -> Proposal:
    sweep = designs.best
    chosen = chosen_of(sweep, at)
    words = design_words(sweep.family, chosen.amplitude, chosen.period)
    after = dict(zip(designs.names, sweep.final_sd[at], strict=True))
    shrink = ", ".join(
        f"{name} from {percent(one.sd / abs(one.mean))} to {percent(one.after(sd, decided=decides) / abs(one.mean))}"
        for name, sd in after.items()
        if (one := known.get(name)) is not None
    )
    expected = (f"expected ± with every error: {shrink}", *((noise,) if noise else ()))
    return Proposal(chosen, standing, (f"run {one_design(words)}", promise), expected)
