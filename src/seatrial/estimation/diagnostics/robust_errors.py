"""Standard deviations of coefficients that survive an error of the model.

Outside the model the curvature of the posterior says nothing about how far the mode would lie from the truth, or from the mode of other
data. Two things do. By how much the values move when what the model may lack is let in, as far as the data do not exclude it, is in
`omitted_effects`. By how much they move when a piece of the data goes, a run or a long block of time, is here: without piece i the mode
moves by d_i = (P - H_i)^-1 (r - s_i) - P^-1 r, s_i the slope and H_i the curvature of its log-likelihood at the mode, and

    V = (n - 1) / n sum_i d_i d_i' + C L C,   C = P^-1

is the jackknife over pieces (Efron and Stein, Annals of Statistics 9, 1981), the sandwich H^-1 (sum s s') H^-1 (Huber 1967, White 1982)
with the leverage of each piece taken out of it, which few pieces need (MacKinnon, Nielsen and Webb, Journal of Applied Econometrics 38,
2023). L is the curvature of the prior: what it says is not drawn anew with the data, and its own spread stays. Where the model is right,
V is C. The deviation of one parameter over the root of V has about Student's t distribution of n - 1 degrees of freedom.

All of it is along the values, and not along z: near the bound of a prior no step of z is small enough for the likelihood to be quadratic.
Each prior counts as a normal density of its own standard deviation. At the mode r, the slope of the log posterior density along the values,
is 0 but where a bound holds them back.

What the model lacks in every run alike moves every piece alike, and is not in V; docs/held_back.md shows what each of the two finds.

A run's own parameters (`u_0[run]`) are part of its piece: their priors say how runs differ, which the runs themselves show.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri, stdtrit

from seatrial.compiled.random_keys import seeded_key
from seatrial.estimation.diagnostics.candidate_effects import Effect
from seatrial.estimation.diagnostics.omitted_effects import BAND, OmittedEffects, omitted_effects
from seatrial.estimation.posterior.filter_error import FilterError
from seatrial.estimation.posterior.mode import MIN_CURVATURE, Mode
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.prediction.posterior_by_run import RunExpansion, expand_runs, split_runs
from seatrial.estimation.prediction.prediction import outputs_of_draws
from seatrial.estimation.prediction.prediction_scores import effective_samples
from seatrial.estimation.simulation.trial_data import TrialData

MIN_RUNS = 3  # Runs from which on the runs themselves are the pieces
MIN_BLOCKS, MAX_BLOCKS = 6, 24  # Fewest blocks of time that tell a spread, and most that are taken
# Length of a block over the time that one independent sample takes: blocks have to be nearly independent of each
# other.
MIN_BLOCK_LENGTHS = 3.0
MIN_SD_RATIO = 1.5  # Ratio of the two standard deviations from which both are shown


@dataclass(frozen=True)
class Pieces:
    """By how much values move when pieces of the data go; only of the k parameters that all runs share.

    Attributes:
        ratio: root of V over the standard deviation of the normal approximation, shape (k,).
        count: how many pieces; 0 where there are too few.
        basis: what they are, in words, or why there are none.
        are_runs: whether they are whole runs, not blocks of time.
    """

    ratio: Float[np.ndarray, " k"]
    count: int
    basis: str
    are_runs: bool = False

    @property
    def freedom(self) -> int:
        """Degrees of freedom of Student's t."""
        return self.count - 1

    @property
    def widening(self) -> float:
        """What a standard deviation is multiplied by so that 1.645 of it hold 90 % although few pieces tell it."""
        return float(stdtrit(self.freedom, BAND) / ndtri(BAND)) if self.count else 1.0


@dataclass(frozen=True)
class RobustErrors:
    """What survives an error of the model, of each of the k parameters that all runs share.

    Attributes:
        names: of the parameters.
        pieces: by how much they move when pieces of the data go.
        omitted: what the model lacks.
        spread: of `omitted`, of these parameters, shape (k,).
        causes: likewise.
        farthest: root mean square distances of their priors from their values at the mode, SI, shape (k,): as far off as a value is by the
            prior alone, and as an error of the model can take it.
    """

    names: tuple[str, ...]
    pieces: Pieces
    omitted: OmittedEffects
    spread: Float[np.ndarray, " k"]
    causes: tuple[tuple[Effect, ...], ...]
    farthest: Float[np.ndarray, " k"]

    @property
    def ratio(self) -> Float[np.ndarray, " k"]:
        """Standard deviation with the error of the model over that within it, not widened for few pieces."""
        return np.sqrt(np.maximum(self.pieces.ratio, 1.0) ** 2 + self.spread**2 - 1.0)

    def wider(self, name: str, sd: float) -> float | None:
        """Return the standard deviation of a parameter with the error of the model, widened for few pieces.

        Args:
            name: of the parameter.
            sd: its standard deviation within the model.

        Returns:
            None where it is not told, or is less than half as large again.
        """
        if name not in self.names or self.ratio[(at := self.names.index(name))] <= MIN_SD_RATIO:
            return None
        stated = min(
            sd * float(np.sqrt(self._of_pieces(at) ** 2 + self.spread[at] ** 2 - 1.0)), float(self.farthest[at])
        )
        return stated if stated > MIN_SD_RATIO * sd else None

    def is_prior(self, name: str, wider: float) -> bool:
        """Whether a standard deviation of `wider` is that of the prior about the value, which is to say that nothing narrows it."""
        return wider >= 0.999 * float(self.farthest[self.names.index(name)])

    def cause(self, name: str) -> tuple[Effect, ...]:
        """Return the effects, any of which makes most of the second standard deviation of a parameter; none where pieces of the data do."""
        at = self.names.index(name)
        return self.causes[at] if self.spread[at] > self._of_pieces(at) else ()

    def _of_pieces(self, at: int) -> float:
        return max(float(self.pieces.ratio[at]), 1.0) * self.pieces.widening


def robust_errors(posterior: Posterior, mode: Mode) -> RobustErrors:
    """Return how the standard deviations at the mode compare with what pieces of the data, and effects left out, say.

    Args:
        posterior: of records; of a log density of one's own nothing is told.
        mode: of the posterior, all its parameters.
    """
    shared = np.array([i for i in posterior.places if "[" not in posterior.names[i]], int)
    omitted = omitted_effects(posterior, mode)
    names = tuple(posterior.names[i] for i in shared)
    causes = tuple(omitted.causes[i] for i in shared)
    values = dict(zip(mode.names, mode.values, strict=True))
    priors = {one.name: one.prior for one in posterior.parameters}
    farthest = np.array([np.hypot(priors[one].sd, values[one] - priors[one].mean) for one in names])
    pieces = _pieces(posterior, mode, shared)
    return RobustErrors(names, pieces, omitted, omitted.spread[shared], causes, farthest)


def jackknife(
    precision: Float[np.ndarray, "d d"],
    scores: Float[np.ndarray, "n d"],
    curvatures: Float[np.ndarray, "n d d"],
    prior: Float[np.ndarray, " d"],
    rest: Float[np.ndarray, " d"],
) -> Float[np.ndarray, "d d"]:
    """Return V of the module's head.

    Args:
        precision: curvature of the log posterior density at the mode, sign turned.
        scores: gradient of the log-likelihood of each piece there.
        curvatures: its curvature, sign turned.
        prior: curvature of each parameter's log prior density, sign turned.
        rest: gradient of the log posterior density there.
    """
    n, beyond = len(scores), _solve(precision, rest)
    moves = np.stack([_solve(precision - h, rest - s) - beyond for s, h in zip(scores, curvatures, strict=True)])
    held = _solve(precision, np.diag(np.sqrt(np.maximum(prior, 0.0))))
    return (n - 1) / n * moves.T @ moves + held @ held.T


def _pieces(posterior: Posterior, mode: Mode, shared: np.ndarray) -> Pieces:
    if not isinstance(posterior.likelihood, OutputError | FilterError):
        return _nothing(shared, "a log density of one's own has no runs")
    if len(posterior.likelihood.labels) < MIN_RUNS:
        return _by_blocks(posterior, mode, shared)
    there = expand_runs(split_runs(posterior), mode.z)
    basis = f"{len(posterior.likelihood.labels)} runs"
    return _compared(posterior, there, there.gradient, there.along_values, shared, basis, own_is_drawn=True)


def _nothing(shared: np.ndarray, why: str) -> Pieces:
    return Pieces(np.ones(shared.size), 0, why)


def _compared(
    posterior: Posterior,
    there: RunExpansion,
    scores: np.ndarray,
    hessians: np.ndarray,
    shared: np.ndarray,
    basis: str,
    own_is_drawn: bool,
) -> Pieces:
    """Compare V with C.

    Args:
        posterior: of records.
        there: all of its runs at the mode.
        scores: of the pieces, along values that grow by the slopes of the map from z, shape (n, d).
        hessians: likewise, shape (n, d, d).
        shared: places of the parameters that are told.
        basis: what the pieces are.
        own_is_drawn: whether a run's own parameters go with it.
    """
    prior = (there.slope / [one.prior.sd for one in posterior.parameters]) ** 2
    precision = np.diag(prior) - there.along_values.sum(0)
    if own_is_drawn:
        prior = np.where(["[" in name for name in posterior.names], 0.0, prior)
    # Which parameters are those of the sensors' noise. Their curvature in a piece grows with the squares of its
    # residuals. One piece can have more of it than all together, and the step without that piece would be far too
    # long: of these parameters, and across to the others, H_i is 0 in d_i.
    noise = np.isin(posterior.names, list(posterior.likelihood.output.noise_parameters))
    curvatures = np.where(noise[:, None] | noise, 0.0, -hessians)
    wide = np.diag(jackknife(precision, scores, curvatures, prior, -there.bend))[shared]
    narrow = np.diag(_solve(precision, np.eye(posterior.dim)))[shared]
    return Pieces(np.sqrt(wide / narrow), len(scores), basis, own_is_drawn)


def _by_blocks(posterior: Posterior, mode: Mode, shared: np.ndarray) -> Pieces:
    """Likewise of blocks of time of one run or two: the score of a block is that of all before its end less that before its start."""
    data: TrialData = posterior.data
    apart = _time_of_one(posterior, mode)
    step = np.asarray(data.step)
    lengths = step.sum(1)
    counts = (
        np.floor(lengths / (MIN_BLOCK_LENGTHS * apart)).astype(int)
        if np.isfinite(apart)
        else np.zeros(len(lengths), int)
    )
    counts = np.minimum(counts, max(1, MAX_BLOCKS // len(lengths)))
    if counts.sum() < MIN_BLOCKS:
        return _nothing(
            shared,
            f"{counts.sum()} blocks of time that are longer than the memory of the residuals, {MIN_BLOCKS} are needed",
        )
    scores, hessians = [], []
    time = data.time
    runs = split_runs(posterior)
    for r, count in enumerate(counts):
        before = np.zeros(posterior.dim), np.zeros((posterior.dim, posterior.dim))
        weight = [float(i == r) for i in range(len(counts))]
        for edge in np.arange(1, count + 1) / max(count, 1) * lengths[r]:
            known = replace(runs.runs[r], data=_until(runs.runs[r].data, time[r] < edge * (1 + 1e-9)))
            cut = replace(runs, runs=tuple(known if i == r else one for i, one in enumerate(runs.runs)))
            result = expand_runs(cut, mode.z, weight)
            scores.append(result.gradient[r] - before[0])
            hessians.append(result.along_values[r] - before[1])
            before = result.gradient[r], result.along_values[r]
    there = expand_runs(runs, mode.z)
    basis = f"{len(scores)} blocks of {lengths.sum() / len(scores):.3g} s"
    return _compared(posterior, there, np.stack(scores), np.stack(hessians), shared, basis, own_is_drawn=False)


def _time_of_one(posterior: Posterior, mode: Mode) -> float:
    """Return the longest time, of all channels, that one independent residual of the simulation at the mode takes, s."""
    longest = 0.0
    for one, at in zip((runs := split_runs(posterior)).runs, map(runs.places, range(len(runs.runs))), strict=True):
        values = {name: np.array([value]) for name, value in zip(one.names, mode.values[at], strict=True)}
        shown = np.asarray(outputs_of_draws(one.likelihood.output)(values, one.data, seeded_key(0)))[0]
        time = one.data.time[0]
        for i, channel in enumerate(one.data.channels):
            here = np.asarray(channel.present)[0] > 0
            residual = np.asarray(channel.measured)[0][here] - shown[here, i]
            if here.sum() < 8 or not np.isfinite(residual).all():
                continue
            longest = max(longest, float(np.ptp(time[here])) / effective_samples(time[here], residual))
    return longest or np.inf


def _until(data: TrialData, known: np.ndarray) -> TrialData:
    """Return the data of one trial without the measurements of samples that are not known; of the same shape."""
    channels = []
    for channel in data.channels:
        present = np.asarray(channel.present) * known
        kind = np.where(present > 0, np.asarray(channel.kind), 0)
        counts = np.bincount(kind[present > 0], minlength=channel.counts.shape[-1])[None].astype(float)
        channels.append(
            channel._replace(
                measured=np.where(present > 0, np.asarray(channel.measured), 0.0),
                present=present,
                kind=kind,
                counts=counts,
            )
        )
    return data._replace(channels=tuple(channels))


def _solve(precision: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve with a precision of which directions without curvature have the prior's, as in the normal approximation."""
    values, vectors = np.linalg.eigh(0.5 * (precision + precision.T))
    return (vectors / np.where(values <= MIN_CURVATURE, 1.0, values)) @ (vectors.T @ right)
