"""All subsets of a linear regression: ours against C of the same algorithm, a Gray-code sweep in C, a NumPy loop, and R's BMS.

The response hardly depends on the regressors, so that no block of structures is negligible and none is left out.
"""

import ctypes
import io
import resource
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from reference import as_c, load, on_cores
from timing import Ratio, Row, agree, alternate, row

import seatrial.selection.subsets.all_subsets as engine
from seatrial.selection.subsets.average import SubsetPosterior
from seatrial.selection.subsets.conjugate import GPrior, IndependentPrior, physical_prior
from seatrial.selection.subsets.gram import Gram, gram
from seatrial.selection.subsets.problem import Problem, averages, make_problem

SAMPLES, TOP = 400, 1000
BOUNDS = {16: 0.020, 20: 0.3, 25: 10.0}
"""Seconds on two cores."""
LOOPED = 12
PACKAGE = 16
"""Terms given to R."""
VAGUE = 1e-9
"""Shape and rate of a noise variance of which nothing is believed, as the package has it."""


class Case(NamedTuple):
    """Statistics, prior and names of k terms."""

    stats: Gram
    prior: IndependentPrior
    names: tuple[str, ...]


def speed(cores: int) -> list[Row | Ratio]:
    """Sizes 16, 20 and 25, averages, joint inclusion and the best thousand included."""
    return [found for k in BOUNDS for found in _one_size(k, cores)]


def package(cores: int) -> list[Row | Ratio]:
    """A published package of Bayesian model averaging on the same data, which must find the same inclusion probabilities."""
    phi, y = _data(PACKAGE)
    table = io.StringIO()
    np.savetxt(table, np.column_stack([y, phi]), delimiter=",")
    script = Path(__file__).with_name("peer_bms.R")
    said = subprocess.run(["Rscript", script], input=table.getvalue(), capture_output=True, text=True, check=True)
    taken, *inclusion = map(float, said.stdout.split())
    # Its offset is always there and believed to be anything: as many rows less one, all columns without their means.
    stats = gram(phi - phi.mean(0), y - y.mean())._replace(n=SAMPLES - 1)
    prior, names = GPrior(float(SAMPLES), VAGUE, VAGUE), tuple(f"t{i}" for i in range(PACKAGE))
    found = engine.all_subsets(stats, prior, names)
    agree("inclusion probabilities of seatrial and BMS", found.inclusion, np.array(inclusion), 1e-6)
    seconds = alternate({"": lambda: engine.all_subsets(stats, prior, names, threads=cores)}, 11)[""]
    group = f"all 2^{PACKAGE} subsets under a g-prior worth one row"
    rows = [
        row(group, "seatrial", cores, "ms", seconds, 1e-3),
        Row(group, "R, BMS", cores, "ms", 1e3 * taken, 1e3 * taken),
    ]
    return [*rows, Ratio(group, "BMS / seatrial", cores, taken / seconds.min())]


def _one_size(k: int, cores: int) -> list[Row | Ratio]:
    case, group, results = _case(k), f"all 2^{k} subsets, averages included", {}

    def ours() -> None:
        results["ours"] = engine.all_subsets(case.stats, case.prior, case.names, top=TOP, threads=cores)

    def reference() -> None:
        results["C"] = _in_c(case, cores)

    runs = {"seatrial": ours, "C, same algorithm": reference}
    start = time.perf_counter()
    ours()
    first = time.perf_counter() - start
    if k <= 20:
        runs["C, Gray code, evidence only"] = lambda: results.update(gray=_gray(case, cores))
    seconds = alternate(runs, 3 if k > 20 else 11)
    _check(results["ours"], *results["C"])
    if k <= 20:
        agree("total log evidence and Gray code", _log_total(results["ours"]), results["gray"], 1e-6)
    best = {name: taken.min() for name, taken in seconds.items()}
    rows = [row(group, name, cores, "ms", taken, 1e-3) for name, taken in seconds.items()]
    rows.append(Row(group, "seatrial, first call", cores, "ms", 1e3 * first, 1e3 * first))
    if k == min(BOUNDS):
        loop = 2.0 ** (k - LOOPED) * alternate({"": lambda: _loop(case)}, 1, warm_up=False)[""]
        rows.append(row(group, f"NumPy, one structure after another (of {2**LOOPED})", cores, "ms", loop, 1e-3))
    if k == max(BOUNDS):
        used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        rows += [Ratio(group, "memory, both and Python, MB", cores, used, at_most=2048)]
    bound = [Ratio(group, "seconds", cores, best["seatrial"], at_most=BOUNDS[k])] if cores == 2 else []
    return [*rows, *bound, Ratio(group, "seatrial / C", cores, best["seatrial"] / best["C, same algorithm"], at_most=3)]


def _data(k: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(k)
    phi = rng.normal(size=(SAMPLES, k)) + 0.5 * rng.normal(size=(SAMPLES, 1))
    return phi, 0.05 * phi[:, ::3].sum(1) + rng.normal(size=SAMPLES)


def _case(k: int) -> Case:
    return Case(gram(*_data(k)), physical_prior(np.full(k, 0.3), 1.0), tuple(f"t{i}" for i in range(k)))


def _problem(case: Case) -> Problem:
    k = len(case.names)
    return make_problem(case.stats, case.prior, [], range(k))


def _in_c(case: Case, cores: int):
    """Problem, log total, inclusion, mean, within, and the best scores, by the C reference."""
    problem, k = _problem(case), len(case.names)
    library, fixed = load("reference_subsets.c"), max(k - engine.BLOCK_LEVELS, 0)
    levels, lanes, width = k - fixed, 2**fixed, min(engine.BLOCK_LANES, 2**fixed)
    for function in (library.new_tree, library.new_best):
        function.restype = ctypes.c_void_p
    outer = ctypes.c_void_p(library.new_tree(*map(as_c, (k + 1, fixed, 1))))
    library.give(outer, as_c(np.ascontiguousarray(problem.matrix[np.triu_indices(k + 1)])), as_c(problem.start))
    library.eliminate(outer)
    r, blocks = levels, lanes // width
    shapes = [
        (lanes,),
        (lanes,),
        (lanes,),
        (r, lanes),
        (r, r, blocks),
        ((r + 1) * (r + 2) // 2, lanes),
        (r * (r + 1) // 2, lanes),
    ]
    sums = [np.zeros(shape) for shape in shapes]
    sums[0][:] = -np.inf
    lists = [ctypes.c_void_p(library.new_best(as_c(TOP))) for _ in range(cores)]

    def some(first: int, last: int, step: int, negligible: float, best: ctypes.c_void_p) -> None:
        before = map(as_c, (levels, width, first, last, step, problem.shape, negligible))
        library.add_blocks(outer, *before, best, *map(as_c, sums))

    some(blocks - 1, blocks, 1, -1e300, lists[0])
    floor = float(sums[0][-1]) - engine.NEGLIGIBLE_DEFICIT - k * np.log(2)
    on_cores(cores, lambda i: some(i, blocks - 1, cores, floor, lists[i]), list(range(cores)))
    peak, weight, corner, present, _, moment, spread = sums
    factor = np.exp(peak - peak.max())
    weight, corner, present, moment, spread = (x * factor for x in (weight, corner, present, moment, spread))
    whole = [np.empty(n * (n + 1) // 2) for n in (k + 1, k)]
    for less, (fine, coarse) in enumerate(zip((moment, spread), whole, strict=True)):
        library.take_back(outer, as_c(less), as_c(fine), as_c(corner), as_c(coarse))
    library.free_tree(outer)
    scores = np.concatenate([_ranked(library, best) for best in lists])
    full = [_unpacked(packed, n) for packed, n in zip(whole, (k + 1, k), strict=True)]
    found = averages(problem, full[0], full[1], float(corner.sum()))
    total = problem.constant + peak.max() + np.log(weight.sum())
    return total, present.sum(1) / weight.sum(), found, problem.constant + np.sort(scores)[::-1][:TOP]


def _ranked(library: ctypes.CDLL, best: ctypes.c_void_p) -> np.ndarray:
    score, number = np.empty(TOP), np.empty(TOP, np.int64)
    held = library.ranked(best, as_c(score), number.ctypes.data_as(ctypes.c_void_p))
    return score[:held]


def _unpacked(packed: np.ndarray, n: int) -> np.ndarray:
    full = np.zeros((n, n))
    full[np.triu_indices(n)] = packed
    return full + np.triu(full, 1).T


def _check(ours: SubsetPosterior, total: float, inclusion: np.ndarray, found, scores: np.ndarray) -> None:
    agree("total log evidences of seatrial and C", _log_total(ours), np.array(total), 1e-8)
    agree("inclusion probabilities", ours.inclusion[-inclusion.size :], inclusion, 1e-9)
    agree("averaged coefficients", ours.mean, found.mean, 1e-9)
    agree("covariances within", ours.within, found.within, 1e-9)
    agree("covariances between", ours.between, found.between, 1e-9)
    agree("best structures", ours.log_evidence, scores, 1e-8)


def _log_total(ours: SubsetPosterior) -> np.ndarray:
    """Log of the sum of all evidences, from one of them and its share."""
    return ours.log_evidence[0] - np.log(ours.probability[0])


def _gray(case: Case, cores: int) -> np.ndarray:
    """Log total by sweeping one term in or out at a time, each core its share of the last terms' settings."""
    problem, k = _problem(case), len(case.names)
    function, held = load("reference_subsets.c").gray_code, cores.bit_length() - 1
    function.restype = ctypes.c_double
    matrix = np.ascontiguousarray(problem.matrix)
    shares = on_cores(
        cores,
        lambda there: function(*map(as_c, (k, held, there, matrix, problem.start, problem.shape))),
        list(range(2**held)),
    )
    return problem.constant + np.logaddexp.reduce(np.array(shares))


def _loop(case: Case) -> None:
    """A Cholesky factor for each of some structures spread over all, as a script would have it."""
    problem, k = _problem(case), len(case.names)
    matrix, response, square = problem.matrix[:k, :k], problem.matrix[:k, k], problem.matrix[k, k]
    for number in range(0, 2**k, 2 ** (k - LOOPED)):
        there = [i for i in range(k) if number >> i & 1]
        factor = np.linalg.cholesky(matrix[np.ix_(there, there)])
        whitened = np.linalg.solve(factor, response[there])
        _ = -problem.shape * np.log(square - whitened @ whitened) - np.log(np.diag(factor)).sum()
