"""Standard deviations that survive model error: fits without each piece, the textbook sandwich, coverage where the model lacks a term."""

import numpy as np
import pytest
from scipy import stats

from seatrial.estimation.diagnostics.candidate_effects import Effect
from seatrial.estimation.diagnostics.omitted_effects import OmittedEffects
from seatrial.estimation.diagnostics.robust_errors import Pieces, RobustErrors, jackknife, robust_errors
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.posterior import posterior_of_density
from seatrial.estimation.posterior.record_posterior import make_posterior
from seatrial.estimation.priors import Normal, Uniform, truncated_normal
from seatrial.messages.predictions import model_error_text
from seatrial.vehicles.whole import whole_vehicle
from tests.estimation_cases import make_trial, slow_noise
from tests.selection.run_cases import (
    FIXED_DRAG,
    NOISE,
    PRIOR,
    STEP,
    TRUTH,
    N,
    design_of_runs,
    linear_runs,
    posterior_of_runs,
    speed,
)


def pieces_of(design, miss, of, sd):
    """Scores and curvatures of the pieces of a linear regression at its posterior mean, prior standard normal; and its precision."""
    precision = design.T @ design / sd**2 + np.eye(design.shape[1])
    mean = np.linalg.solve(precision, design.T @ miss / sd**2)
    left = miss - design @ mean
    labels = np.unique(of)
    scores = np.stack([design[of == i].T @ left[of == i] for i in labels]) / sd**2
    curvatures = np.stack([design[of == i].T @ design[of == i] for i in labels]) / sd**2
    return precision, scores, curvatures, mean


def test_jackknife_is_the_spread_of_fits_without_each_piece():
    rng = np.random.default_rng(1)
    design, of = rng.normal(size=(60, 3)), np.repeat(np.arange(5), 12)
    miss = design @ [0.3, -0.2, 0.5] + 0.4 * rng.normal(size=60) + 0.3 * rng.normal(size=5)[of]
    precision, scores, curvatures, mean = pieces_of(design, miss, of, 0.4)
    moved = [pieces_of(design[of != i], miss[of != i], of[of != i], 0.4)[3] - mean for i in range(5)]
    held = np.linalg.inv(precision) @ np.linalg.inv(precision)
    expected = 4 / 5 * np.transpose(moved) @ np.array(moved) + held
    np.testing.assert_allclose(jackknife(precision, scores, curvatures, np.ones(3), np.zeros(3)), expected, rtol=1e-10)


def test_many_small_pieces_make_it_the_textbook_sandwich():
    """Of White's V = H^-1 (sum s s') H^-1 with errors that grow along the regressor, and no prior to speak of."""
    rng = np.random.default_rng(2)
    x = rng.normal(size=4000)
    design = np.column_stack([np.ones(4000), x])
    miss = design @ [1.0, 2.0] + np.abs(x) * rng.normal(size=4000)
    precision, scores, curvatures, _ = pieces_of(design, miss, np.arange(4000), 1.0)
    bread = np.linalg.inv(precision)
    np.testing.assert_allclose(
        jackknife(precision, scores, curvatures, np.zeros(2), np.zeros(2)),
        bread @ scores.T @ scores @ bread,
        rtol=0.02,
    )


def test_of_runs_by_hand():
    """The starts of the runs are their own and go with them; only what is shared is told."""
    runs = linear_runs(5)
    joint = posterior_of_runs(runs)
    found = robust_errors(joint, find_mode(joint, 0))
    design, middle = design_of_runs(runs)
    miss = np.concatenate([run[2] for run in runs]) - middle
    of = np.arange(len(miss)) // N
    precision, scores, curvatures, _ = pieces_of(design, miss, of, NOISE)
    cov = jackknife(precision, scores, curvatures, np.append(np.ones(2), np.zeros(5)), np.zeros(7))
    expected = np.sqrt(np.diag(cov) / np.diag(np.linalg.inv(precision)))[:2]
    at = [found.names.index(name) for name in PRIOR]
    np.testing.assert_allclose(found.pieces.ratio[at], expected, rtol=1e-3)
    assert (found.pieces.count, found.pieces.freedom, found.pieces.basis) == (5, 4, "5 runs")
    # No error of the model takes a value farther than its prior reaches from there, be the value where the prior hardly is.
    value = find_mode(joint, 0).by_name["X_0"]
    reach = np.sqrt(np.mean((stats.norm(*PRIOR["X_0"]).rvs(100_000, random_state=0) - value) ** 2))
    assert found.farthest[found.names.index("X_0")] == pytest.approx(reach, rel=0.01)
    assert found.pieces.widening == pytest.approx(stats.t.ppf(0.95, 4) / 1.644854, rel=1e-5)


@pytest.mark.proof
def test_coverage_where_runs_differ_and_noise_is_slow():
    """The truth has a constant force of each run's own and noise with a memory; of 60 vehicles the wide one holds 90 %."""
    narrow, wide = [], []
    for seed in range(60):
        joint = posterior_of_runs(slow_runs(6, seed))
        mode = find_mode(joint, 0, starts=64, tries=1)
        found = robust_errors(joint, mode)
        at = joint.names.index("T_nabsn")
        away = abs(mode.values[at] - TRUTH["T_nabsn"]) / mode.sd[at] / stats.norm.ppf(0.95)
        narrow.append(away < 1)
        wide.append(away < found.pieces.ratio[found.names.index("T_nabsn")] * found.pieces.widening)
    assert np.mean(narrow) < 0.7
    assert stats.binom.ppf(0.005, 60, 0.9) / 60 <= np.mean(wide)


@pytest.mark.parametrize(
    ("memory", "least", "most"), [pytest.param(0.0, 0.5, 1.6, marks=pytest.mark.proof), (1.0, 1.5, 6.0)]
)
def test_blocks_of_one_run(memory, least, most):
    """Blocks that are long beside what residuals remember: white residuals change nothing, slow ones three times and more."""
    rng = np.random.default_rng(5)
    rev = np.repeat(rng.uniform(4, 14, 100), 8)
    noise = coloured(rng, len(rev), memory)
    record = make_trial(STEP * np.arange(len(rev)), rev, "one", u=speed(rev, 1.0, *TRUTH.values()) + NOISE * noise)
    priors = {"sigma_u": Normal(NOISE, 0.2 * NOISE)} | {name: Normal(*numbers) for name, numbers in PRIOR.items()}
    joint = make_posterior(
        whole_vehicle(FIXED_DRAG, tuple(PRIOR), moves=("u",)), record, priors, ["u"], start={"u": 1.0}
    )
    found = robust_errors(joint, find_mode(joint, 0))
    assert 6 <= found.pieces.count <= 24
    assert "blocks of" in found.pieces.basis
    ratio = found.pieces.ratio[[found.names.index(name) for name in PRIOR]]
    assert least < ratio.min()
    assert ratio.max() < most
    assert (found.wider("T_nabsn", 1e-6) is None) == (memory == 0.0)


@pytest.mark.proof
def test_at_the_bound_of_a_prior_the_steps_are_along_the_values():
    """X_0 lies at the upper end of a uniform prior. Along z the ratios of this record were 300; now they are those without the bound."""
    rng = np.random.default_rng(4)
    rev = np.repeat(rng.uniform(4, 14, 100), 8)
    shown = speed(rev, 1.0, *TRUTH.values()) + NOISE * coloured(rng, len(rev), 1.0)
    record = make_trial(STEP * np.arange(len(rev)), rev, "one", u=shown)
    ratios = []
    for upper in (20.0, TRUTH["X_0"] - 0.1):
        priors = {"sigma_u": Normal(NOISE, 0.2 * NOISE), "X_0": Uniform(-20.0, upper)}
        priors["T_nabsn"] = Normal(*PRIOR["T_nabsn"])
        joint = make_posterior(
            whole_vehicle(FIXED_DRAG, tuple(PRIOR), moves=("u",)), record, priors, ["u"], start={"u": 1.0}
        )
        found = robust_errors(joint, find_mode(joint, 0))
        ratios.append(found.pieces.ratio[[found.names.index(name) for name in PRIOR]])
    np.testing.assert_allclose(ratios[1], ratios[0], rtol=0.02)


@pytest.mark.proof
def test_a_block_with_nearly_all_of_the_residuals_moves_no_value_out_of_sight():
    """The record begins 0.2 m/s from the assumed start; with the noise's curvature in each block the ratios were 1e5 and more."""
    rng = np.random.default_rng(6)
    rev = np.repeat(rng.uniform(4, 14, 100), 8)
    shown = speed(rev, 1.2, *TRUTH.values()) + 0.3 * NOISE * rng.normal(size=len(rev))
    record = make_trial(STEP * np.arange(len(rev)), rev, "one", u=shown)
    priors = {"sigma_u": truncated_normal(NOISE, 20 * NOISE, lower=0.0)} | {
        name: Normal(*numbers) for name, numbers in PRIOR.items()
    }
    joint = make_posterior(
        whole_vehicle(FIXED_DRAG, tuple(PRIOR), moves=("u",)), record, priors, ["u"], start={"u": 1.0}
    )
    ratio = robust_errors(joint, find_mode(joint, 0)).pieces.ratio
    assert ratio.min() > 2
    assert ratio.max() < 20


@pytest.mark.parametrize(("pieces", "expected"), [(3, 1.8), (10, 1.1)])
def test_widening_for_few_pieces(pieces, expected):
    """Student's t of pieces - 1 degrees of freedom beside the normal law, at 90 %; below half as large again nothing is told."""
    few, lag = Pieces(np.array([2.0, 1.4, 0.5]), pieces, f"{pieces} runs"), Effect("command lag", "n", "s")
    none = OmittedEffects((), (), np.ones(3), ((),) * 3)
    found = RobustErrors(
        ("a", "b", "c"), few, none, np.array([1.0, 1.0, 3.0]), ((lag,),) * 3, np.array([9.0, 9.0, 0.5])
    )
    assert few.widening == pytest.approx(expected, abs=0.05)
    assert found.wider("a", 0.1) == pytest.approx(0.2 * few.widening)
    assert found.wider("b", 0.1) is None
    assert found.wider("c", 0.1) == pytest.approx(0.1 * np.sqrt(few.widening**2 + 8.0))
    assert found.wider("c", 0.4) is None, "the prior has hardly more"
    assert found.wider("c", 0.2) == 0.5, "no more than the prior"
    assert (found.cause("a"), found.cause("c")) == ((), (lag,))
    assert found.wider("d", 0.1) is None
    assert f"{pieces - 1} degrees of freedom" in model_error_text(found)


@pytest.mark.proof
def test_what_tells_nothing():
    own = posterior_of_density(lambda values: -(values["a"] ** 2), {"a": Normal(0.0, 1.0)})
    found = robust_errors(own, find_mode(own, 0))
    assert found.pieces.count == 0
    assert found.wider("a", 1.0) is None
    assert "no runs" in found.pieces.basis
    assert "not judged" in model_error_text(found)
    joint = posterior_of_runs(slow_runs(1, 0))
    short = robust_errors(joint, find_mode(joint, 0))
    assert short.pieces.count == 0
    assert "6 are needed" in short.pieces.basis
    assert "effects that the model may lack" in model_error_text(short)


def coloured(rng, n, memory):
    """Unit noise with a correlation time, s; white for 0."""
    return slow_noise(rng, STEP * np.arange(n), memory) if memory else rng.normal(size=n)


def slow_runs(count, seed):
    """Runs as `linear_runs`, each with a constant force of its own and noise of 2 s."""
    rng = np.random.default_rng(100 + seed)
    runs = []
    for _ in range(count):
        rev = np.repeat(rng.uniform(4, 14, 6), 8)
        start = rng.uniform(0.5, 2.0)
        clean = speed(rev, start, TRUTH["T_nabsn"], TRUTH["X_0"] + 0.5 * rng.normal())
        runs.append((rev, start, clean + NOISE * coloured(rng, N, 2.0)))
    return runs
