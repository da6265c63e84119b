"""One evidence from two methods, and a third where these do not agree; agreement or alarm in words.

Adaptive importance sampling about the modes is the most precise; tempered SMC starts from the prior and knows of no mode. Each is blind
where the other sees, so that their difference in units of their joint error is a test of both, but not of the likelihood and the prior,
which they share. One repeat of SMC is cooled further:
modes that its particles meet are given to importance sampling, which stays unbiased whatever it is given.

Where the noise is unknown and the priors are wide, tempered SMC may fail on a posterior that is all but normal: with N b less than
the number of coefficients, L^b is a power law of the residuals, of which every scale holds as much as every other, and few particles
meet the narrow ones. Nested sampling, which goes down in likelihood instead of temperature, has no such stretch, and is asked then.

A structure that the first repeat and importance sampling both find hopelessly behind another is given up: its last digits decide nothing.

What agreement cannot show: a mode that no particle met. Two methods can miss the same narrow peak and agree.

The work is cut into pieces that may run anywhere and in any order: `Gathering` says which are to be done, `do` does one.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.special import chdtri

from seatrial.compiled.pytrees import compiled_tree
from seatrial.compiled.random_keys import fold_in, split
from seatrial.core.argument_checks import check_kind
from seatrial.core.errors import NumericalError
from seatrial.core.reporter import Progress, no_progress
from seatrial.estimation.posterior.mode import Mode, climb, find_mode, rises
from seatrial.estimation.posterior.posterior import Posterior, as_key, check_posterior
from seatrial.estimation.prediction.remedies import listed
from seatrial.sampling.nested import NestedRun, sample_nested
from seatrial.sampling.target import Target, evaluate
from seatrial.sampling.tempered_smc import SMCResult, SMCSettings, Start, prior_particles, sample_tempered_smc
from seatrial.selection.evidence import Evidence, EvidenceSettings, combine_runs
from seatrial.selection.importance import ImportanceSettings, distance, edges_of, importance_evidence, laplace_proposal
from seatrial.selection.nested import combine_nested

# Search for modes beside the highest one known, among particles of tempered SMC that are cooled on to p L^10.
#
# In a phase transition a narrow peak holds the evidence and a broad one holds the particles up to b = 1 and beyond
# (Skilling, Bayesian Analysis 1, 2006); cold particles climb, so that a peak far above all that was met betrays
# itself. Particles at b = 1 show modes that are lower and hold evidence all the same.
#
# What it cannot see: a peak so narrow that no cold particle ever comes near it. Nothing that evaluates points can.

COLD = 10.0
MANY = 0.01
"""Share of the particles far from all known modes that are looked into."""
FAR = 1e-3
"""Share of a normal density that lies farther off than what counts as far."""
HIGHER_MODE = 0.1
"""Nats above the highest mode known that no rounding of its place explains."""
CLIMBS = 3
"""Climbs at most from each set of particles."""


@compiled_tree()
@dataclass(frozen=True)
class Cooled:
    """A target whose likelihood is raised to a power, 1 for the target itself: both share one compiled sampler."""

    target: Target
    power: Float[Array, ""]

    @property
    def dim(self) -> int:
        """Number of components of z."""
        return self.target.dim

    def log_prior(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the log prior density."""
        return self.target.log_prior(z)

    def log_likelihood(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Return the log-likelihood times the power."""
        return self.power * self.target.log_likelihood(z)

    def sample_prior(self, key: jax.Array, n: int) -> Float[Array, "n d"]:
        """Return the draws from the prior."""
        return self.target.sample_prior(key, n)


def sample_warm(target: Target, key: jax.Array, settings: SMCSettings, progress: Progress = no_progress) -> SMCResult:
    """Run tempered SMC as it is, by the program that `sample_cold` goes on with; errors as `sample_tempered_smc`."""
    start_key, key = split(key)
    start = prior_particles(target, start_key, settings.particles_for(target.dim))
    return sample_tempered_smc(Cooled(target, np.ones(())), key, settings, progress, start=start)


def sample_cold(
    target: Target, warm: SMCResult, key: jax.Array, settings: SMCSettings, progress: Progress = no_progress
) -> Float[np.ndarray, "particles d"]:
    """Cool the particles of a run ten times further, and return where they are then; errors as `sample_tempered_smc`."""
    start = Start(warm.particles, 1.0 / COLD)
    return sample_tempered_smc(Cooled(target, np.full((), COLD)), key, settings, progress, start=start).particles


def further_modes(
    posterior: Posterior, known: Mode, sets: Sequence[Float[np.ndarray, "particles d"]]
) -> tuple[Mode, ...]:
    """Climb from particles that lie far from all modes known, or higher than them, and return the modes that are new.

    Args:
        posterior: density.
        known: its highest mode found so far.
        sets: particles, the coldest first.
    """
    modes, edges = [known], edges_of(posterior)
    for particles in filter(len, sets):
        height, looked_into = evaluate(posterior, particles), np.zeros(len(particles), bool)
        for _ in range(CLIMBS):
            new = ~looked_into & np.isfinite(height) & _is_new(modes, edges, particles, height)
            start = particles[np.argmax(np.where(new, height, -np.inf))]
            if not new.mean() > MANY and not _is_higher_mode(modes, height[new]).any():
                break
            looked_into |= (particles == start).all(1)
            if any(rises(posterior, start, mode.z) for mode in modes):
                continue
            try:
                result = climb(posterior, start)
            except NumericalError:
                continue
            if _is_new(modes, edges, result.z[None], np.array([result.log_density]))[0]:
                modes.append(result)
    return tuple(modes[1:])


def _is_new(
    modes: Sequence[Mode],
    edges: Float[np.ndarray, "d 2"],
    z: Float[np.ndarray, "n d"],
    height: Float[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Return whether points lie far from all modes, or higher than them."""
    away = np.min([distance(laplace_proposal(mode, edges), z) for mode in modes], 0)
    return (away > chdtri(z.shape[1], FAR)) | _is_higher_mode(modes, height)


def _is_higher_mode(modes: Sequence[Mode], height: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    return height > max(mode.log_density for mode in modes) + HIGHER_MODE


ALARM, FLOOR = 3.0, 0.1
"""Difference that alarms: in joint errors, and in nats at least."""
BLUNT = 0.5
"""Joint error, nats, of a check: what it then still finds, 1.5 nats, moves odds between structures by a factor of four."""
MOST_REPEATS = 4
"""Repeats of tempered SMC at most, in those asked for."""
SHARP = 0.1
"""Error of tempered SMC, nats, down to which repeats are added where a verdict depends on what it does not resolve."""
HOPELESS = 50.0
"""Nats behind the best structure from which one is given up: it then has a probability below 1e-21."""
NESTED_RUNS, NESTED_LIVE, NESTED_MOVES = 4, 200, 4
"""Runs of nested sampling, live points of each, and slice moves for each parameter: an error of 0.2 nats where the data tell 26.

With 2 moves instead of 4, the usual size, it is 0.2 nats too low under wide priors (`wide regression` of docs/evidence.py).
"""
NESTED_UP_TO = 10
"""Parameters up to which nested sampling is asked: it takes 4 million evaluations in 10, 28 million in 20."""
Method = Literal["smc", "importance", "nested"]
PREFERRED: tuple[Method, ...] = ("importance", "smc", "nested")
"""The value is that of the first of these that is healthy."""
NESTED_KEY = 1 << 16
"""Number of nested sampling's own key among those made of the key of importance sampling."""
CALLED: Mapping[Method, str] = {
    "importance": "importance sampling",
    "smc": "tempered SMC",
    "nested": "nested sampling",
}
"""Methods as a sentence names them."""
FINE = 1000
"""Parts of a piece in which progress is told."""
HIGHER = 3.0
"""Nats above the highest peak known that count as another one."""


class Piece(NamedTuple):
    """A repeat of tempered SMC or of nested sampling; or importance sampling, with the first repeat's particles if there are any, and
    the mode if it is known."""

    method: Method
    repeat: int = 0
    first: "EvidenceRun | None" = None
    mode: Mode | None = None


class EvidenceRun(NamedTuple):
    """One repeat, or why it failed; of the first also its particles after they were cooled, shape (n, d), none where they could not be."""

    repeat: int
    smc: SMCResult | None
    cold: Float[np.ndarray, "n d"]
    failure: str = ""


class NestedRepeat(NamedTuple):
    """One repeat of nested sampling, or why there is none."""

    repeat: int
    run: NestedRun | None
    failure: str = ""


class Weighed(NamedTuple):
    """Evidence by a method, None where it failed, and why; what the first repeat's particles say against all methods; the highest mode."""

    method: Method
    evidence: Evidence | None
    failure: str | None = None
    alarms: tuple[str, ...] = ()
    mode: Mode | None = None


class Keys(NamedTuple):
    """Random keys of tempered SMC, and of importance sampling, of which that of nested sampling is made."""

    smc: jax.Array
    importance: jax.Array


def agreed_evidence(
    posterior: Posterior,
    keys: Keys | jax.Array | int = 0,
    settings: EvidenceSettings = EvidenceSettings(),
    progress: Progress = no_progress,
    mode: Mode | None = None,
) -> Evidence:
    """Return the evidence by importance sampling, checked by tempered SMC, and by nested sampling where that does not confirm it.

    Where the first complains, the value is that of the next that does not.

    Args:
        posterior: density to integrate.
        keys: random keys; or one of which both are made, or a seed.
        settings: repeats of tempered SMC that are asked for, and their size; more are made while they check too bluntly; and draws of the
            importance sampling.
        progress: called with the work done and the work in all, in thousandths of a piece.
        mode: of the posterior, from which importance sampling begins; looked for where not given.

    Returns:
        The chosen evidence. Its diagnostics hold `methods`: value, error, status, difference from the chosen and that in joint
        errors for each; `checks`, how many healthy methods confirm it; `resolution`, the smallest
        difference, nats, that these would have noticed, None without a check; and `notes`, what is known of those that do not although
        another does. Its status is empty only if one at least confirms it and none finds more.

    Raises:
        InputError: no posterior, or settings of something else.
        NumericalError: tempered SMC cannot leave the prior.
    """
    check_posterior(posterior)
    check_kind(settings, EvidenceSettings, "settings", "leave them out, or write EvidenceSettings(repeats=4)")
    gathering = Gathering(settings.repeats, mode)
    gather(posterior, gathering, keys_of(keys), settings, progress)
    return gathering.evidence()


def gather(
    posterior: Posterior,
    gathering: "Gathering",
    keys: Keys,
    settings: EvidenceSettings,
    progress: Progress = no_progress,
) -> None:
    """Do one after another all pieces of an evidence that are still to be done; arguments and errors as `agreed_evidence`."""
    waiting = gathering.begin()
    done = 0
    while waiting:
        piece = waiting.pop(0)

        def within(share: int, whole: int, done: int = done, pieces: int = done + 1 + len(waiting)) -> None:
            progress(round(FINE * (done + share / whole)), FINE * pieces)

        following = gathering.add(do(posterior, piece, keys, settings, within))
        waiting = [following, *waiting] if following else waiting
        done += 1
        progress(FINE * done, FINE * (done + len(waiting)))


def keys_of(keys: Keys | jax.Array | int) -> Keys:
    """Return the random keys of an evidence, of one key or of a seed where they are not given."""
    return keys if isinstance(keys, Keys) else Keys(*split(as_key(keys)))


def do(
    posterior: Posterior, piece: Piece, keys: Keys, settings: EvidenceSettings, progress: Progress = no_progress
) -> EvidenceRun | NestedRepeat | Weighed:
    """Do one piece of an evidence."""
    if piece.method == "importance":
        return _weigh(posterior, piece, keys.importance, settings.draws)
    if piece.method == "nested":
        return _nested(posterior, piece.repeat, fold_in(keys.importance, NESTED_KEY), progress)
    key = fold_in(keys.smc, piece.repeat)
    try:
        smc = sample_warm(posterior, key, settings.smc, progress)
    except NumericalError as error:
        return EvidenceRun(piece.repeat, None, np.empty((0, posterior.dim)), str(error))
    cold = smc.particles[:0]
    if piece.repeat == 0:
        with suppress(NumericalError):
            cold = sample_cold(posterior, smc, fold_in(key, 1), settings.smc)
    return EvidenceRun(piece.repeat, smc, cold)


class Gathering:
    """What has been found for one evidence, and what is still to be done for it.

    Attributes:
        most: repeats of tempered SMC at most.
        asked: of these, those asked for; with 0 importance sampling is done alone, for a value that decides nothing.
        runs: repeats that are there, by number; what is known before `begin` is not done again.
        nested: those of nested sampling.
        weighed: what the other methods found, by method.
        behind: nats behind the best structure, of one that is given up; 0 of any other.
        mode: from which importance sampling begins; None where it is to look for one.
        compared: whether its mode has been compared with those of the other structures; before, nothing is decided by it.
    """

    def __init__(self, asked: int, mode: Mode | None = None, compared: bool = True):
        self.asked, self.mode, self.compared = asked, mode, compared
        self.most = MOST_REPEATS * asked
        self.runs: dict[int, EvidenceRun] = {}
        self.nested: dict[int, NestedRun] = {}
        self.weighed: dict[Method, Weighed] = {}
        self.behind = 0.0
        self._begun: set[tuple[Method, int]] = set()

    def begin(self, most: int | None = None) -> list[Piece]:
        """Return all that can be done at once, of the repeats that are asked for so many at most; what was begun is not begun again."""
        repeats = [Piece("smc", repeat) for repeat in range(self.asked if most is None else min(most, self.asked))]
        new = [one for one in repeats if one.repeat not in self.runs and (one.method, one.repeat) not in self._begun]
        following = iter(self._following, None)
        return [*map(self._begin, new), *following]

    def add(self, result: EvidenceRun | NestedRepeat | Weighed) -> Piece | None:
        """Keep what was found, and return what can be done now, if anything can."""
        match result:
            case Weighed():
                self.weighed[result.method] = result
            case EvidenceRun():
                self.runs[result.repeat] = result
            case NestedRepeat(run=None):
                self.weighed["nested"] = Weighed("nested", None, result.failure)
            case NestedRepeat(run=run):
                self.nested[result.repeat] = run
        return self._following()

    @property
    def first(self) -> tuple[float, float] | None:
        """The lower and the higher of two first values, by importance sampling and by one repeat; None where one is not sound."""
        weighed, run = self.weighed.get("importance"), self.runs.get(0)
        if weighed is None or weighed.evidence is None or weighed.evidence.status or weighed.alarms:
            return None
        if run is None or run.smc is None:
            return None
        low, high = sorted((weighed.evidence.log_value, run.smc.log_evidence))
        return low, high

    def give_up(self, best: float) -> bool:
        """Give up a structure that cannot be the best, for a lower bound of that one's log evidence; returns whether it is given up."""
        self.behind = best - self.first[1] if self.first is not None and self.first[1] < best - HOPELESS else 0.0
        return self.behind > 0.0

    def sharpen(self) -> bool:
        """Ask for as many more repeats as bring their error to `SHARP`, as far as there may be so many; returns whether there are more."""
        runs = [run.smc for run in self._in_order() if run.smc is not None]
        if len(runs) < 2 or (found := combine_runs(runs)).status:
            return False
        before, wanted = self.asked, int(np.ceil(len(runs) * (found.std_error / SHARP) ** 2))
        self.asked = min(self.most, max(before, wanted))
        return self.asked > max(before, len(runs))

    def weigh_again(self, mode: Mode) -> None:
        """Let importance sampling begin again, from a mode that is higher than the one it found."""
        self.mode = mode
        del self.weighed["importance"]
        self._begun.remove(("importance", 0))

    def evidence(self) -> Evidence:
        """Return the evidence once all is there."""
        if "importance" not in self.weighed:
            raise RuntimeError("importance sampling has not been done yet")
        if self.behind and (own := self.weighed["importance"].evidence) is not None:
            alone = judge({"importance": own}, {}, alone=True, at_bounds=self._at_bounds)
            note = f"tempered SMC, run once, finds it {self.behind:.0f} nats behind the best or more, too"
            return replace(alone, diagnostics={**alone.diagnostics, "notes": [note]})
        found: dict[Method, Evidence] = {
            name: one.evidence for name, one in self.weighed.items() if one.evidence is not None
        }
        failed: dict[Method, str] = {name: one.failure for name, one in self.weighed.items() if one.failure is not None}
        there = self._in_order()
        healthy = [run.smc for run in there if run.smc is not None]
        if len(healthy) > 1:
            found["smc"] = combine_runs(healthy)
        elif there:
            failed["smc"] = next(run.failure for run in there if run.failure)
        if not found:
            raise NumericalError("; ".join(failed.values()))
        evidences = {name: found[name] for name in PREFERRED if name in found}
        failed = {name: failed[name] for name in PREFERRED if name in failed}
        alarms = self.weighed["importance"].alarms
        return judge(evidences, failed, alarms, alone=not self.asked, at_bounds=self._at_bounds)

    @property
    def _at_bounds(self) -> list[str]:
        mode = self.weighed["importance"].mode
        return [] if mode is None else [sentence for _, sentence in mode.at_bounds]

    def _following(self) -> Piece | None:
        """Importance sampling once a first repeat is there, more repeats while they check too bluntly, then nested sampling if need be."""
        if ("importance", 0) not in self._begun and (0 in self.runs or not self.asked):
            return self._begin(Piece("importance", first=self.runs.get(0), mode=self.mode))
        there = self._in_order()
        if not self.asked or len(there) < self.asked:
            return None
        if not _settled(there) and len(there) < self.most:
            piece = Piece("smc", len(there))
        elif self._is_weighed and "nested" not in self.weighed and self._is_unconfirmed():
            if len(self.nested) == NESTED_RUNS:
                self.weighed["nested"] = Weighed("nested", combine_nested([*self.nested.values()], NESTED_LIVE))
                return None
            piece = Piece("nested", len(self.nested))
        else:
            return None
        return None if (piece.method, piece.repeat) in self._begun else self._begin(piece)

    @property
    def _is_weighed(self) -> bool:
        return self.compared and "importance" in self.weighed

    def _is_unconfirmed(self) -> bool:
        try:
            return not self.evidence().diagnostics["checks"]
        except NumericalError:
            return True

    def _begin(self, piece: Piece) -> Piece:
        self._begun.add((piece.method, piece.repeat))
        return piece

    def _in_order(self) -> list[EvidenceRun]:
        """Return the repeats up to the first that is not there, or the first at which they are settled."""
        there: list[EvidenceRun] = []
        while len(there) in self.runs and not (len(there) >= self.asked and _settled(there)):
            there.append(self.runs[len(there)])
        return there


def judge(
    evidences: Mapping[Method, Evidence],
    failed: Mapping[Method, str],
    alarms: Sequence[str] = (),
    alone: bool = False,
    at_bounds: Sequence[str] = (),
) -> Evidence:
    """Choose the first healthy evidence, or the first if none is, and say what speaks against it.

    A healthy method that agrees confirms it. What another then lacks, or says against itself, is a note; but one that finds more has met
    something that the two that agree have not.

    Args:
        evidences: by method, the preferred first.
        failed: why other methods gave none.
        alarms: what else is known against the result.
        alone: whether no other method was asked.
        at_bounds: which parameters have their mode at a bound of their prior.
    """
    value = value_of({name: {"status": one.status} for name, one in evidences.items()})
    chosen, table, checks, higher, against, resolved = evidences[value], {}, 0, [], [], []
    for name, one in evidences.items():
        difference = one.log_value - chosen.log_value
        joint = float(np.hypot(np.nan_to_num(one.std_error), np.nan_to_num(chosen.std_error)))
        table[name] = {
            "log_value": one.log_value,
            "std_error": one.std_error,
            "status": one.status,
            "difference": difference,
            "joint_errors": difference / joint if joint > 0 else 0.0,
        }
        if one.status:
            against.append(f"{one.method} complains: {one.status}")
        if name == value:
            continue
        if not abs(difference) <= max(ALARM * joint, FLOOR):
            apart = f"{abs(difference) / max(joint, 1e-12):.0f} joint errors"
            (higher if difference > 0 else against).append(
                f"{one.method} finds {difference:+.2f} nats against {chosen.method}, {apart}: one of them misses part of the posterior"
            )
        elif not one.status and joint > BLUNT:
            against.append(f"{one.method} checks to {joint:.2f} nats only: use more particles or draws")
        elif not one.status:
            checks += 1
            resolved.append(max(ALARM * joint, FLOOR))
    against += [f"{CALLED[name]} failed: {why}" for name, why in failed.items()]
    if value != next(iter(evidences)) or failed:
        against.append(f"the value is that of {chosen.method}")
    said = [*alarms, *higher, *([] if checks or alone else against)]
    if not checks and not alone:
        said.append("no healthy independent method confirms the value")
    notes = [_note(name, table[name]) for name in table if name != value] if checks else []
    diagnostics = chosen.diagnostics | {
        "at_bounds": [*at_bounds],
        "methods": table,
        "checks": checks,
        "resolution": min(resolved, default=None),
        "notes": list(filter(None, notes)),
    }
    return Evidence(chosen.log_value, chosen.std_error, chosen.method, diagnostics, "; ".join(said))


def value_of(table: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the method whose value is taken, of a table as `judge` makes it: the first healthy one, or the first if none is."""
    return next((name for name, one in table.items() if not one["status"]), next(iter(table)))


def agrees(found: Mapping[str, Any]) -> bool:
    """Return whether a method's row of that table agrees with the value that is taken."""
    return abs(found["joint_errors"]) <= ALARM or abs(found["difference"]) <= FLOOR


def _note(name: Method, found: Mapping[str, Any]) -> str:
    """Say why a method is not counted beside two that agree; nothing of one that agrees too."""
    apart = not agrees(found)
    reasons = [complaint.split(": ")[0] for complaint in found["status"].split("; ") if complaint]
    if apart:
        reasons.append(f"it is {abs(found['difference']):.2f} nats {'above' if found['difference'] > 0 else 'below'}")
    return f"{CALLED[name]} is not counted ({listed(reasons)})" if reasons else ""


def _weigh(posterior: Posterior, piece: Piece, key: jax.Array, draws: int) -> Weighed:
    """Importance sampling about the mode and what particles of the first repeat, if there are any, met besides."""
    first = piece.first.smc if piece.first else None
    sets = () if piece.first is None or first is None else (piece.first.cold, first.particles)
    known, evidence, failure = [], None, None
    try:
        mode = find_own_mode(posterior, key) if piece.mode is None else piece.mode
        known = [mode, *further_modes(posterior, mode, sets)]
        evidence = importance_evidence(posterior, key, mode, ImportanceSettings(draws), known[1:])
    except NumericalError as error:
        failure = str(error)
    alarms = _higher(posterior, *sets, [mode.log_density for mode in known]) if sets else ()
    highest = max(known, key=lambda mode: mode.log_density, default=None)
    return Weighed("importance", evidence, failure, tuple(alarms), highest)


def find_own_mode(posterior: Posterior, key: jax.Array) -> Mode:
    """Find the mode from which importance sampling of such a key begins where none is known; errors as `find_mode`."""
    return find_mode(posterior, split(key, 3)[0])


def _nested(posterior: Posterior, repeat: int, key: jax.Array, progress: Progress) -> NestedRepeat:
    """One repeat of nested sampling, in no more parameters than it can be waited for."""
    if posterior.dim > NESTED_UP_TO:
        why = f"it is done up to {NESTED_UP_TO} parameters only, and these are {posterior.dim}"
        return NestedRepeat(repeat, None, why)
    size = {"live": NESTED_LIVE, "moves": NESTED_MOVES * posterior.dim}
    try:
        return NestedRepeat(repeat, sample_nested(posterior, fold_in(key, repeat), **size, progress=progress))
    except NumericalError as error:
        return NestedRepeat(repeat, None, str(error))


def _higher(posterior: Posterior, cold: np.ndarray, warm: np.ndarray, known: Sequence[float]) -> list[str]:
    """Return whether cold particles met a peak higher than those known and than where the others are, in words."""
    if not cold.size:
        return ["the particles could not be cooled, so no further peaks were searched for"]
    normal = float(evaluate(posterior, warm).max()) + 0.5 * float(chdtri(posterior.dim, 1.0 - 1e-3))
    higher = float(evaluate(posterior, cold).max()) - max([*known, normal])
    if higher <= HIGHER:
        return []
    return [
        f"a point {higher:.1f} nats above the highest peak the methods know exists: a narrow peak was missed and may "
        "hold most of the evidence; narrow the prior about it, or integrate each peak by itself"
    ]


def _settled(runs: Sequence[EvidenceRun]) -> bool:
    """Return whether more repeats would change nothing: these check sharply enough, or complain, or some failed."""
    healthy = [run.smc for run in runs if run.smc is not None]
    if len(healthy) < len(runs):
        return True
    found = combine_runs(healthy)
    return bool(found.status) or found.std_error <= BLUNT
