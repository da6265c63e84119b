import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.estimation.priors import Normal
from seatrial.sampling import de_metropolis
from seatrial.sampling.diagnostics import diagnose
from seatrial.sampling.run import ChainSettings
from seatrial.sampling.sampler import advance_chains, sample, start_chains
from tests.estimation_cases import posterior

KEY = jax.random.key(3)


@pytest.mark.proof
def test_two_modes_far_apart_get_their_shares():
    """0.3 N(-6, 1) + 0.7 N(6, 1): starts lie half and half, and only steps from mode to mode can set the shares right."""

    def two(values, data):
        a = values["a"]
        mixture = jnp.logaddexp(jnp.log(0.3) - 0.5 * (a + 6) ** 2, jnp.log(0.7) - 0.5 * (a - 6) ** 2)
        return mixture + 0.5 * (a / 100) ** 2

    target = posterior({"a": Normal(0.0, 100.0)}, two)
    values = target.unconstrain(jnp.where(jnp.arange(32) % 2, 6.0, -6.0)[:, None])
    draws = sample(de_metropolis, target, values, 1e-4 * jnp.eye(1), KEY, ChainSettings(draws=4000))
    right = np.asarray(target.constrain(jnp.asarray(draws.z))) > 0
    error = np.sqrt(0.21 / diagnose(right.astype(float)).ess_bulk[0])
    assert error < 0.02
    assert right.mean() == pytest.approx(0.7, abs=4 * error)


def test_snooker_moves_along_the_line_and_knows_its_volume():
    """The correction is the log-determinant of the map, over scales, of the line: numerically, for d = 3."""
    rng = np.random.default_rng(0)
    z, difference, c = (jnp.asarray(rng.normal(size=(1, 3))) for _ in range(3))

    def end(z):
        """Where a step of fixed length along the line ends: the map whose volume is asked for."""
        away = z - c[0]
        length = jnp.sum((away0 / jnp.linalg.norm(away0)) * difference[0]) * 1.7
        return z + length * away / jnp.linalg.norm(away)

    away0 = z[0] - c[0]
    step, log_volume = de_metropolis._snooker(z, difference, c, jnp.array([1.7]))
    np.testing.assert_allclose(z[0] + step[0], end(z[0]), rtol=1e-12)
    expected = np.linalg.slogdet(np.asarray(jax.jacfwd(end)(z[0])))[1]
    np.testing.assert_allclose(log_volume[0], expected, rtol=1e-10)


def test_rows_are_three_different_ones_each_equally_often():
    rows = np.asarray(de_metropolis._three_rows(jax.random.key(0), 60_000, 5))
    assert rows.min() == 0
    assert rows.max() == 4
    a, b, c = rows
    assert ((a != b) & (b != c) & (a != c)).all()
    counts = np.bincount(25 * a + 5 * b + c)
    counts = counts[counts > 0]
    assert counts.size == 60
    assert np.abs(counts - 1000).max() < 5 * np.sqrt(1000)


def test_archive_takes_in_the_chains_and_forgets_its_first_rows():
    target = posterior({"a": Normal(0.0, 1.0)}, lambda values, data: 0.0 * values["a"])
    settings = ChainSettings(chains=32, warmup=400, draws=100)
    run = start_chains(de_metropolis, target, jnp.zeros((32, 1)), 1e4 * jnp.eye(1))
    assert np.asarray(run.state.archive).std() > 50
    for _ in range(4):
        run = advance_chains(de_metropolis, target, run, KEY, settings)
    archive = np.asarray(run.state.archive)
    assert archive.shape == (1024, 1)
    assert archive.std() == pytest.approx(1.0, abs=0.2)
