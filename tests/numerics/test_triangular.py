from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import solve_triangular

from seatrial.numerics import triangular

SIZES = (1, 2, 4, 6)
RNG = np.random.default_rng(3)


def lower(n):
    rng = np.random.default_rng(n)
    return np.tril(rng.normal(size=(n, n)), -1) + np.diag(rng.uniform(0.5, 2, n))


def vector_of(n):
    return np.random.default_rng(n + 100).normal(size=n)


def scalars(matrix):
    """Rows of scalars; exact zeros become structural."""
    return [tuple(0.0 if entry == 0 else jnp.asarray(entry) for entry in row) for row in matrix]


def dense(triangle):
    return np.array([[*map(float, row), *[0.0] * (len(triangle) - len(row))] for row in triangle])


@pytest.mark.parametrize("n", SIZES)
def test_cholesky(n):
    factor = lower(n)
    assert np.allclose(dense(triangular.cholesky(scalars(factor @ factor.T))), factor, atol=1e-12)


def test_cholesky_reads_the_lower_triangle_only():
    matrix = np.array([[4.0, np.nan], [2.0, 5.0]])
    assert np.allclose(dense(triangular.cholesky(scalars(matrix))), [[2, 0], [1, 2]], atol=1e-15)


@pytest.mark.parametrize("matrix", [[[1.0, 2.0], [2.0, 1.0]], [[-1.0, 0.0], [0.0, 1.0]]])
def test_cholesky_of_an_indefinite_matrix_is_nan(matrix):
    assert np.isnan(dense(triangular.cholesky(scalars(np.array(matrix))))).any()


@pytest.mark.parametrize("n", SIZES)
def test_cholesky_of_an_array(n):
    factor = lower(n)
    assert np.allclose(triangular.cholesky_of_array(factor @ factor.T), factor, atol=1e-12)
    assert np.isnan(triangular.cholesky_of_array(-factor @ factor.T)).any()


@pytest.mark.proof
def test_programs_side_by_side_factor_many_matrices():
    """LAPACK's batches, shared out to the threads that run the programs, waited for each other for ever."""
    spread = lower(24) @ lower(24).T

    @jax.jit
    def again_and_again(start):
        def step(a, _):
            factor = jax.vmap(triangular.cholesky_of_array)(a)
            return factor @ factor.mT, None

        return jax.lax.scan(step, start, length=50)[0]

    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: np.asarray(again_and_again(np.tile(spread, (80, 1, 1)))), range(8)):
            assert np.allclose(found, spread, atol=1e-10)


ROWS = {
    "dense": RNG.normal(size=(9, 4)),
    "square": RNG.normal(size=(4, 4)),
    "ill conditioned": RNG.normal(size=(9, 4)) * [1, 1e5, 1e-5, 1],
    "diagonal noise below": np.vstack([RNG.normal(size=(6, 4)), np.diag([0.1, 0.2, 0.3, 0.4]), np.diag([1, 0, 0, 2])]),
    "diagonal": np.diag([3.0, 0.5, 1.0, 2.0]),
    "zero blocks": np.kron(np.eye(2), RNG.normal(size=(3, 2))),
    "zero row": np.vstack([RNG.normal(size=(5, 4)), np.zeros((1, 4))]),
    "scattered zeros": RNG.normal(size=(12, 4)) * (RNG.random((12, 4)) < 0.5),
}


@pytest.mark.parametrize("rows", ROWS.values(), ids=ROWS.keys())
def test_triangular_factor_is_the_r_of_numpy_qr(rows):
    r = np.linalg.qr(rows, mode="r")
    factor = dense(triangular.triangular_factor(scalars(rows)))
    assert (np.diagonal(factor) > 0).all()
    assert np.allclose(factor, (r * np.sign(np.diagonal(r))[:, None]).T, rtol=1e-9, atol=1e-12 * np.abs(rows).max())


@pytest.mark.parametrize("n", SIZES)
def test_downdate(n):
    factor = lower(n)
    vector = factor @ vector_of(n)
    vector *= 0.9 / np.linalg.norm(np.linalg.solve(factor, vector))
    new, failed = triangular.rank_one_downdate(triangular.to_triangle(jnp.asarray(factor)), tuple(jnp.asarray(vector)))
    assert not failed
    assert np.allclose(dense(new), np.linalg.cholesky(factor @ factor.T - np.outer(vector, vector)), atol=1e-11)


@pytest.mark.parametrize("size", [1.0001, 3.0])
@pytest.mark.parametrize("direction", range(4))
def test_downdate_that_does_not_exist_is_flagged(size, direction):
    factor = lower(4)
    vector = size * factor[:, direction]
    assert np.linalg.eigvalsh(factor @ factor.T - np.outer(vector, vector)).min() < 0
    new, failed = triangular.rank_one_downdate(triangular.to_triangle(jnp.asarray(factor)), tuple(jnp.asarray(vector)))
    assert failed
    assert (np.diagonal(dense(new)) > 0).all()


@pytest.mark.parametrize("n", SIZES)
def test_solves(n):
    factor, vector = lower(n), vector_of(n)
    rows, entries = triangular.to_triangle(jnp.asarray(factor)), tuple(jnp.asarray(vector))
    assert np.allclose(triangular.solve_lower(rows, entries), solve_triangular(factor, vector, lower=True), rtol=1e-11)


def test_solve_with_structural_zeros():
    factor = np.diag([2.0, 4.0, 5.0])
    factor[2, 1] = 1.0
    rows = tuple(row[: i + 1] for i, row in enumerate(scalars(factor)))
    assert np.allclose(triangular.solve_lower(rows, (0.0, 8.0, 0.0)), np.linalg.solve(factor, [0, 8, 0]))


def test_log_diagonal_is_half_the_log_determinant():
    factor = lower(5)
    half = 0.5 * np.linalg.slogdet(factor @ factor.T)[1]
    assert float(triangular.log_diagonal(triangular.to_triangle(jnp.asarray(factor)))) == pytest.approx(half, rel=1e-13)


def test_matrix_and_rows_are_inverse():
    factor = lower(4)
    assert np.array_equal(triangular.to_matrix(triangular.to_triangle(jnp.asarray(factor))), factor)
    assert np.array_equal(triangular.to_matrix(((2.0,), (0.0, jnp.asarray(3.0)))), [[2, 0], [0, 3]])


def test_structural_zeros_are_kept():
    x = jnp.asarray(2.0)
    assert triangular.is_zero(0.0)
    assert not triangular.is_zero(jnp.zeros(()))
    assert triangular.times(0.0, x) == 0.0
    assert triangular.plus(0.0, x) is x
    assert triangular.dot((0.0, x), (x, 0.0)) == 0.0
    assert isinstance(triangular.dot((0.0, x), (x, 0.0)), float)
    assert triangular.total([]) == 0.0


def test_batches_of_factors():
    rows = np.random.default_rng(4).normal(size=(8, 7, 3))
    batch = jax.vmap(lambda r: triangular.to_matrix(triangular.triangular_factor([tuple(row) for row in r])))(rows)
    assert np.allclose(batch @ np.swapaxes(batch, 1, 2), np.swapaxes(rows, 1, 2) @ rows, atol=1e-12)
