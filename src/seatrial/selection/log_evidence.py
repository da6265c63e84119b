"""Log evidence by two methods, and by a third if these do not agree: the schedule of the tasks, and the tasks.

Adaptive importance sampling about the modes is the most precise; tempered SMC starts from the prior and knows of no mode. Their
difference tests both (`method_agreement`). One repeat of SMC is cooled further (`further_modes`): modes that its particles meet are
given to importance sampling, which stays unbiased with any modes.

If the noise is unknown and the priors are wide, tempered SMC may fail on a posterior that is nearly normal: with N b less than the
number of coefficients, L^b is a power law of the residuals, of which every scale holds as much as every other, and few particles meet
the narrow ones. Nested sampling, which goes down in likelihood instead of temperature, has no such stretch, and is then asked.

Among structures most evidences decide nothing: a schedule may begin with importance sampling about modes that are known, and ask the second
method later (`check`), where a decision depends on it or the first is in doubt.

Tasks may run anywhere and in any order: `EvidenceSchedule` lists them, `run_task` does one.
"""

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import jax
import numpy as np
import scipy
from jaxtyping import Float

from seatrial.compiled.random_keys import fold_in, split
from seatrial.core.argument_checks import check_kind
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.estimation.posterior.mode import Mode, find_mode
from seatrial.estimation.posterior.posterior import Posterior, as_key, check_posterior
from seatrial.sampling.nested import NestedRun, sample_nested
from seatrial.sampling.target import evaluate
from seatrial.sampling.tempered_smc import SMCResult
from seatrial.selection.evidence import EvidenceSettings, combine_nested, combine_runs
from seatrial.selection.further_modes import further_modes, sample_cold, sample_warm
from seatrial.selection.importance import ImportanceSettings, importance_evidence
from seatrial.selection.method_agreement import MAX_CHECK_ERROR, METHOD_ORDER, Method, judge
from seatrial.selection.verdict import Evidence

MAX_REPEATS = 4  # Repeats of tempered SMC, in multiples of those asked for
# Error of tempered SMC, nats, down to which repeats are added if a verdict depends on less than it resolves.
SHARP_ERROR = 0.1
# Runs of nested sampling, live points of each, and slice moves for each parameter: an error of 0.2 nats if the data
# tell 26. With 2 moves instead of 4, the usual size, it is 0.2 nats too low under wide priors (`wide regression` of
# docs/evidence.py).
NESTED_RUNS, NESTED_LIVE, NESTED_MOVES = 4, 200, 4
# Parameters up to which nested sampling is asked: it takes 4 million evaluations in 10, 28 million in 20.
MAX_NESTED_DIM = 10
NESTED_KEY = 1 << 16  # Number of nested sampling's own key among those made of the key of importance sampling
PROGRESS_STEPS = 1000  # Of one task
MIN_PEAK_RISE = 3.0  # Nats above the highest known peak from which on a point belongs to another one


class EvidenceTask(NamedTuple):
    """A repeat of tempered SMC or of nested sampling; or importance sampling, with the first repeat's particles if there are any, and
    the modes that are known, the highest first."""

    method: Method
    repeat: int = 0
    first: "EvidenceRun | None" = None
    modes: tuple[Mode, ...] = ()


class EvidenceRun(NamedTuple):
    """One repeat of a method, or why it failed.

    Attributes:
        method: of the two that are repeated.
        repeat: number of the repeat.
        result: None if it failed.
        failure: why.
        cold: particles of the first repeat of tempered SMC after they were cooled, shape (n, d); none if they could not be.
    """

    method: Method
    repeat: int
    result: SMCResult | NestedRun | None
    failure: str = ""
    cold: Float[np.ndarray, "n d"] = np.empty((0, 0))


class MethodResult(NamedTuple):
    """Evidence by a method.

    Attributes:
        method: which.
        evidence: None if the method failed.
        failure: why.
        alarms: evidence of the first repeat's particles against all methods, in words.
        modes: those known, the highest first.
    """

    method: Method
    evidence: Evidence | None
    failure: str | None = None
    alarms: tuple[str, ...] = ()
    modes: tuple[Mode, ...] = ()


class Keys(NamedTuple):
    """Random keys of tempered SMC, and of importance sampling, of which that of nested sampling is made."""

    smc: jax.Array
    importance: jax.Array


def log_evidence(
    posterior: Posterior,
    *,
    settings: EvidenceSettings = EvidenceSettings(),
    key: Keys | jax.Array | int = 0,
    progress: Progress = no_progress,
    mode: Mode | None = None,
) -> Evidence:
    """Return the evidence by importance sampling, checked by tempered SMC, and by nested sampling if that does not confirm it.

    If the first warns, the value is that of the next that does not.

    Args:
        posterior: density to integrate.
        settings: repeats of tempered SMC that are asked for, and their size; more are made while they check too bluntly; and draws of the
            importance sampling.
        key: random key, or a seed; or the two keys that are made of it.
        progress: called with the work done and the work in all, in thousandths of a task.
        mode: of the posterior, from which importance sampling begins; found first if not given.

    Returns:
        The chosen evidence. Its diagnostics hold `methods`: value, error, status, difference from the chosen and that in joint
        errors for each; `checks`, how many healthy methods confirm it; `resolution`, the smallest
        difference, nats, that these would have noticed, None without a check; and `notes`, the failings of those that do not although
        another does. Its status is empty only if one at least confirms it and none finds more.

    Raises:
        InputError: no posterior, or settings of something else.
        NumericalError: tempered SMC cannot leave the prior.
    """
    check_posterior(posterior)
    check_kind(settings, EvidenceSettings, "settings", "leave them out, or write EvidenceSettings(repeats=4)")
    schedule = EvidenceSchedule(settings.repeats, () if mode is None else (mode,))
    run_schedule(posterior, schedule, keys_of(key), settings, progress)
    return schedule.evidence()


def run_schedule(
    posterior: Posterior,
    schedule: "EvidenceSchedule",
    keys: Keys,
    settings: EvidenceSettings,
    progress: Progress = no_progress,
) -> None:
    """Run one after another all tasks that remain; arguments and errors as `log_evidence`."""
    waiting = schedule.begin()
    done = 0
    while waiting:
        task = waiting.pop(0)

        def within(share: int, whole: int, done: int = done, tasks: int = done + 1 + len(waiting)) -> None:
            progress(round(PROGRESS_STEPS * (done + share / whole)), PROGRESS_STEPS * tasks)

        following = schedule.add(run_task(posterior, task, keys, settings, within))
        waiting = [following, *waiting] if following else waiting
        done += 1
        progress(PROGRESS_STEPS * done, PROGRESS_STEPS * (done + len(waiting)))


def keys_of(keys: Keys | jax.Array | int) -> Keys:
    """Return the random keys of an evidence, of one key or of a seed if they are not given."""
    return keys if isinstance(keys, Keys) else Keys(*split(as_key(keys)))


def run_task(
    posterior: Posterior, task: EvidenceTask, keys: Keys, settings: EvidenceSettings, progress: Progress = no_progress
) -> EvidenceRun | MethodResult:
    """Run one task of an evidence."""
    if task.method == "importance":
        return _run_importance(posterior, task, keys.importance, settings.draws)
    if task.method == "nested":
        return _run_nested(posterior, task.repeat, fold_in(keys.importance, NESTED_KEY), progress)
    key = fold_in(keys.smc, task.repeat)
    try:
        smc = sample_warm(posterior, key, settings.smc, progress)
    except NumericalError as error:
        return EvidenceRun("smc", task.repeat, None, str(error))
    cold = smc.particles[:0]
    if task.repeat == 0:
        with suppress(NumericalError):
            cold = sample_cold(posterior, smc, fold_in(key, 1), settings.smc)
    return EvidenceRun("smc", task.repeat, smc, cold=cold)


class EvidenceSchedule:
    """The tasks of one evidence: those done, with their results, and those that remain.

    Attributes:
        max_repeats: of tempered SMC.
        asked: of these, those asked for; with 0 importance sampling is done alone, until `check` asks for more.
        runs: repeats of tempered SMC, by number; one that is known before `begin` is not run again.
        nested: those of nested sampling.
        results: of the other methods, by method.
        modes: about which importance sampling draws, the highest first; none if it is to find one.
    """

    def __init__(self, asked: int, modes: Sequence[Mode] = ()):
        self.asked, self.modes = asked, tuple(modes)
        self.max_repeats = MAX_REPEATS * asked
        self.runs: dict[int, EvidenceRun] = {}
        self.nested: dict[int, NestedRun] = {}
        self.results: dict[Method, MethodResult] = {}
        self._begun: set[tuple[Method, int]] = set()

    def begin(self) -> list[EvidenceTask]:
        """Return all tasks that can run at once and have not begun."""
        tasks = [EvidenceTask("smc", repeat) for repeat in range(self.asked)]
        new = [task for task in tasks if task.repeat not in self.runs and (task.method, task.repeat) not in self._begun]
        begun = [self._begin(task) for task in new]
        while (following := self._following()) is not None:
            begun.append(following)
        return begun

    def add(self, result: EvidenceRun | MethodResult) -> EvidenceTask | None:
        """Keep a result, and return the task that can run now, if there is one."""
        match result:
            case MethodResult():
                self.results[result.method] = result
            case EvidenceRun(method="smc"):
                self.runs[result.repeat] = result
            case EvidenceRun(result=NestedRun() as run):
                self.nested[result.repeat] = run
            case EvidenceRun():
                self.results["nested"] = MethodResult("nested", None, result.failure)
        return self._following()

    @property
    def is_doubtful(self) -> bool:
        """Whether importance sampling alone does not do: it failed, complains of itself, or drew about several modes."""
        alone = self.results["importance"]
        return alone.evidence is None or bool(alone.evidence.status) or len(alone.modes) > 1

    def check(self, repeats: int) -> None:
        """Ask for the second method, and for importance sampling again, about what its particles meet too."""
        self.asked, self.max_repeats = repeats, MAX_REPEATS * repeats
        self.modes = self.results.pop("importance").modes
        self._begun.remove(("importance", 0))

    def sharpen(self) -> bool:
        """Ask for as many more repeats as bring their error to `SHARP_ERROR`, within the maximum; returns whether there are more."""
        healthy = _healthy(self._in_order())
        if len(healthy) < 2 or (evidence := combine_runs(healthy)).status:
            return False
        before, wanted = self.asked, int(np.ceil(len(healthy) * (evidence.std_error / SHARP_ERROR) ** 2))
        self.asked = min(self.max_repeats, max(before, wanted))
        return self.asked > max(before, len(healthy))

    def evidence(self) -> Evidence:
        """Return the evidence once all tasks are done."""
        if "importance" not in self.results:
            raise RuntimeError("importance sampling has not been done yet")
        importance = self.results["importance"]
        at_bounds = importance.modes[0].at_bounds if importance.modes else ()
        evidences: dict[Method, Evidence] = {}
        failures: dict[Method, str] = {}
        for name, result in self.results.items():
            if result.evidence is not None:
                evidences[name] = result.evidence
            if result.failure is not None:
                failures[name] = result.failure
        runs = self._in_order()
        if len(healthy := _healthy(runs)) > 1:
            evidences["smc"] = combine_runs(healthy)
        elif runs:
            failures["smc"] = next(run.failure for run in runs if run.failure)
        if not evidences:
            raise NumericalError("; ".join(failures.values()))
        evidences = {name: evidences[name] for name in METHOD_ORDER if name in evidences}
        failures = {name: failures[name] for name in METHOD_ORDER if name in failures}
        return judge(evidences, failures, importance.alarms, alone=not self.asked, at_bounds=at_bounds)

    def _following(self) -> EvidenceTask | None:
        """Importance sampling after a first repeat, more repeats while they check too bluntly, then nested sampling if need be."""
        if ("importance", 0) not in self._begun and (0 in self.runs or not self.asked):
            return self._begin(EvidenceTask("importance", first=self.runs.get(0), modes=self.modes))
        runs = self._in_order()
        if not self.asked or len(runs) < self.asked:
            return None
        if not _is_settled(runs) and len(runs) < self.max_repeats:
            task = EvidenceTask("smc", len(runs))
        elif self._needs_nested():
            if len(self.nested) == NESTED_RUNS:
                evidence = combine_nested([*self.nested.values()], NESTED_LIVE)
                self.results["nested"] = MethodResult("nested", evidence)
                return None
            task = EvidenceTask("nested", len(self.nested))
        else:
            return None
        return None if (task.method, task.repeat) in self._begun else self._begin(task)

    def _needs_nested(self) -> bool:
        if "importance" not in self.results or "nested" in self.results:
            return False
        try:
            return not self.evidence().diagnostics["checks"]
        except NumericalError:
            return True

    def _begin(self, task: EvidenceTask) -> EvidenceTask:
        self._begun.add((task.method, task.repeat))
        return task

    def _in_order(self) -> list[EvidenceRun]:
        """Return the repeats up to the first that is missing, or the first at which they are settled.

        The evidence is then the same in whatever order they came.
        """
        runs: list[EvidenceRun] = []
        while len(runs) in self.runs and not (len(runs) >= self.asked and _is_settled(runs)):
            runs.append(self.runs[len(runs)])
        return runs


def _healthy(runs: Sequence[EvidenceRun]) -> list[SMCResult]:
    return [run.result for run in runs if isinstance(run.result, SMCResult)]


def _is_settled(runs: Sequence[EvidenceRun]) -> bool:
    """Return whether more repeats would change nothing: these check sharply enough, or complain, or some failed."""
    if len(healthy := _healthy(runs)) < len(runs):
        return True
    evidence = combine_runs(healthy)
    return bool(evidence.status) or evidence.std_error <= MAX_CHECK_ERROR


def _run_importance(posterior: Posterior, task: EvidenceTask, key: jax.Array, draws: int) -> MethodResult:
    """Importance sampling about the mode and the other modes that particles of the first repeat, if there are any, met."""
    first = task.first.result if task.first else None
    sets = (task.first.cold, first.particles) if task.first and isinstance(first, SMCResult) else ()
    known, evidence, failure = task.modes, None, None
    try:
        known = further_modes(posterior, known or (find_own_mode(posterior, key),), sets)
        evidence = importance_evidence(posterior, key, known[0], ImportanceSettings(draws), known[1:])
    except NumericalError as error:
        failure = str(error)
    alarms = _missed_peak(posterior, *sets, [mode.log_density for mode in known]) if sets else ()
    return MethodResult("importance", evidence, failure, tuple(alarms), known)


def find_own_mode(posterior: Posterior, key: jax.Array) -> Mode:
    """Find the mode from which importance sampling of such a key begins if none is known; errors as `find_mode`."""
    return find_mode(posterior, key=split(key, 3)[0])


def _run_nested(posterior: Posterior, repeat: int, key: jax.Array, progress: Progress) -> EvidenceRun:
    """One repeat of nested sampling, in as many parameters as it can be waited for."""
    if posterior.dim > MAX_NESTED_DIM:
        why = f"it is done up to {MAX_NESTED_DIM} parameters only, and these are {posterior.dim}"
        return EvidenceRun("nested", repeat, None, why)
    size = {"live": NESTED_LIVE, "moves": NESTED_MOVES * posterior.dim}
    try:
        run = sample_nested(posterior, fold_in(key, repeat), **size, progress=progress)
    except NumericalError as error:
        return EvidenceRun("nested", repeat, None, str(error))
    return EvidenceRun("nested", repeat, run)


def _missed_peak(posterior: Posterior, cold: np.ndarray, warm: np.ndarray, known: Sequence[float]) -> list[str]:
    """Return an alarm if cold particles met a peak higher than those known and than all others, in words."""
    if not cold.size:
        return ["the particles could not be cooled, so the search for further peaks was skipped"]
    # The mode of a normal posterior lies so far above the highest of its particles that one in a thousand is farther.
    normal = float(evaluate(posterior, warm).max()) + 0.5 * float(scipy.special.chdtri(posterior.dim, 1.0 - 1e-3))
    rise = float(evaluate(posterior, cold).max()) - max([*known, normal])
    if rise <= MIN_PEAK_RISE:
        return []
    return [
        f"a point {rise:.1f} nats above the highest peak the methods know exists: a narrow peak was missed and may contain most of the "
        f"evidence. Narrow the prior about it, or integrate each peak separately"
    ]
