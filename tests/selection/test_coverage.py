"""The truths and the verdicts of docs/evidence.py, which repeats every estimator of evidence where the evidence is known."""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import logsumexp

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
import evidence_report as report
import evidence_targets as known


@jax.jit
def density_by_rows(target, rows, axis):
    """Density at every pair of z, the first from `rows` and the second from `axis`."""
    density = jax.vmap(lambda z: jnp.exp(target.log_density(z)))
    return jax.lax.map(lambda x: density(jnp.stack([jnp.full(axis.size, x), axis], -1)), rows)


@pytest.mark.parametrize(
    "problem",
    [
        lambda: known.normal(2),
        known.banana,
        known.beyond_the_edge,
        known.two_peaks,
        lambda: known.shells(2),
        known.egg_box,
    ],
)
def test_exact_values_of_two_parameters(problem):
    """By a sum over the plane of z, whose steps are a third of the narrowest peak's standard deviation at most."""
    problem = problem()
    axis = jnp.linspace(-7.0, 7.0, 1401)
    total = float(density_by_rows(problem.posterior, axis, axis).sum())
    assert np.log(total) + 2 * np.log(0.01) == pytest.approx(problem.log_evidence, abs=1e-5)


def test_published_values():
    """Of the shells Feroz, Hobson and Bridges (MNRAS 398, 2009) print two decimals; the egg box is what other packages test against."""
    found = [known.shells(d).log_evidence for d in (2, 5, 10, 20)]
    np.testing.assert_allclose(found, [-1.7456, -5.6736, -14.5905, -36.0865], atol=1e-4)
    assert known.egg_box().log_evidence == pytest.approx(235.856, abs=5e-4)


@pytest.mark.proof
def test_exact_value_of_the_regression():
    """At each noise the posterior of the coefficients is normal, so that its peak and its curvature give the integral."""
    problem = known.regression()
    design, measured = (np.asarray(x) for x in problem.posterior.data)
    noise = np.linspace(-6.0, 6.0, 601)
    square = (0.5 * 2.0**noise) ** 2
    precision = design.T @ design / square[:, None, None] + np.eye(3) / 4.0
    mean = np.linalg.solve(precision, (design.T @ measured / square[:, None] + 0.3 / 4.0)[..., None])[..., 0]
    peaks = np.asarray(jax.vmap(problem.posterior.log_density)(np.column_stack([(mean - 0.3) / 2.0, noise])))
    logs = peaks + 1.5 * np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(4.0 * precision)[1]
    assert logsumexp(logs) + np.log(0.02) == pytest.approx(problem.log_evidence, abs=1e-6)


def case(errors, stated=1.0, warned=False):
    return report.Case([report.Run(error, stated, warned) for error in errors], None)


@pytest.mark.parametrize(("outside", "low"), [(2, False), (6, False), (9, True)])
def test_too_few_runs_within_two_errors(outside, low):
    """Of 40 runs 1.8 are expected outside; 8 or more are in one of 2000 trials."""
    found = {("smc", "normal, 2"): case([0.0] * (40 - outside) + [3.0] * outside)}
    numbers = report.numbers_of(found, {"easy": ["normal, 2"]})
    assert bool(report.failures(numbers, ["normal, 2"])) == low
    assert not report.failures(numbers, [])


def test_wrong_in_silence():
    """Neither a run that complains, nor 0.05 nat, nor two errors; an error that is not stated is taken as none."""
    assert report.mutes(case([5.0], warned=True)) == 0
    assert report.mutes(case([0.05], 0.01)) == 0
    assert report.mutes(case([2.0, -4.0])) == 1
    assert report.mutes(case([0.2, np.nan], np.nan)) == 2
    assert report.failures(report.numbers_of({(report.DEFAULT, "two peaks, 2"): case([4.0])}, {}), []) != []


def test_numbers_of_a_case():
    """Of four runs one warned and one stated no error; scores and places of those that warned are of runs that stated one."""
    runs = [report.Run(*run) for run in ((0.1, 1.0, False), (9.0, np.nan, False), (3.0, 1.0, True), (-3.0, 1.0, False))]
    found = {(report.DEFAULT, "normal, 2"): report.Case(runs, 7)}
    numbers = report.numbers_of(found, {"easy": ["normal, 2"]})
    one = numbers["cases"]["agreement, normal, 2"]
    assert [one[key] for key in ("runs", "warned", "silent", "silent within", "within", "wrong")] == [4, 1, 2, 1, 1, 1]
    assert (one["scores"], one["grey"]) == ([0.1, 3.0, -3.0], [1])
    assert numbers["easy"] == {"runs": 4, "warned": 1, "silent": 2, "silent within": 1, "within": 1}


def test_tables_name_every_case():
    found = {("smc", "normal, 2"): case([0.0, 1.0]), ("smc", "two peaks, 2"): case([0.0, 9.0])}
    text = report.tables(report.numbers_of(found, {"easy": ["normal, 2"]}), ["normal, 2"], ["two peaks, 2"])
    assert "| smc | normal, 2 | 2 | 0 | 1.000 ± 0.147 |" in text
    assert "| two peaks, 2 | smc | 2 | 50% | 0% | 1 |" in text
