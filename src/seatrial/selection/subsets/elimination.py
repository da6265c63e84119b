"""Level doubling: one elimination step over all subsets of the terms so far gives those with the next term, too.

A symmetric matrix [[p, b^T], [b, R]] is kept for every subset, as a lane. Without the next term what remains is R; with it,

    R - b b^T / p,   determinant times p,   coefficient of the term c = j^T z with j = -b / p and z the rest, the last entry -1,

so that each level doubles the lanes and the number of a lane is its bitmask (bit of the first level lowest). When no term is
left, what remains is 2 b_n. Moments go back the same way: from Q = sum of w z z^T over a lane's two halves, weighted,

    [[j^T Q1 j, j^T Q1], [Q1 j, Q0 + Q1]]

where Q1 is of the half with the term, whose posterior covariance adds v / p to the corner. Each lane costs the same at any k.
"""

import numpy as np
from jaxtyping import Float


class SubsetElimination:
    """Buffers of `levels` doublings of matrices of a given size, in `lanes` lanes, reused by every run.

    NumPy, on blocks that nearly fit the cache. The same steps as one XLA program took as long or longer, since it fuses the way
    back badly, after seconds of compilation.
    """

    def __init__(self, size: int, levels: int, lanes: int):
        """Buffers for matrices of shape (size, size, lanes)."""
        sizes = [(size - level, lanes << level) for level in range(levels + 1)]
        self.matrices = _by_turns([(n, n, m) for n, m in sizes])
        self.moments = _by_turns([(n, n, m) for n, m in sizes])
        self.spreads = _by_turns([(n - 1, n - 1, m) for n, m in sizes])
        self.determinants = _by_turns([(m,) for _, m in sizes])
        self.slopes = [np.empty((n - 1, m)) for n, m in sizes[:-1]]
        self.inverses = [np.empty(m) for _, m in sizes[:-1]]
        self.product = np.empty(max([(n - 1) ** 2 * m for n, m in sizes]))

    def eliminate(
        self,
        matrix: Float[np.ndarray, "size size lanes"],
        determinant: Float[np.ndarray, " lanes"],
        pivots: Float[np.ndarray, " levels"] | None = None,
        squares: Float[np.ndarray, " levels"] | None = None,
    ) -> tuple[Float[np.ndarray, "rest rest more"], Float[np.ndarray, " more"]]:
        """All subsets of the first terms.

        Args:
            matrix: what remains before, a lane for each subset so far.
            determinant: product of the pivots so far.
            pivots: what the determinant is multiplied by for each term, if not by the pivot of elimination.
            squares: added to the last diagonal entry by the presence of each term.

        Returns:
            What remains of each lane and its determinant; the buffers keep them, until the next run.
        """
        determinants = self.determinants
        determinants[0][:] = determinant
        for level, (slope, inverse) in enumerate(zip(self.slopes, self.inverses, strict=True)):
            p, b, rest = matrix[0, 0], matrix[0, 1:], matrix[1:, 1:]
            np.divide(-1.0, p, out=inverse)
            np.multiply(b, inverse, out=slope)
            without, present = _halves(self.matrices[level + 1])
            without[:] = rest
            np.multiply(slope[:, None], b, out=present)
            present += rest
            if squares is not None:
                present[-1, -1] += squares[level]
            fewer, more = _halves(determinants[level + 1])
            fewer[:] = determinants[level]
            np.multiply(determinants[level], p if pivots is None else pivots[level], out=more)
            matrix = self.matrices[level + 1]
        return matrix, determinants[-1]

    def gather_moments(self, moment: Float[np.ndarray, "rest rest more"]) -> Float[np.ndarray, "size size lanes"]:
        """Sums over each lane's subsets of w z z^T, z the posterior means and -1, from those over the finest lanes."""
        self.moments[-1][:] = moment
        for level in reversed(range(len(self.slopes))):
            self._join(self.moments[level + 1], self.slopes[level], level, self.moments[level])
        return self.moments[0]

    def gather_spreads(
        self, spread: Float[np.ndarray, "less less more"], scale: Float[np.ndarray, " more"]
    ) -> tuple[Float[np.ndarray, "fewer fewer lanes"], Float[np.ndarray, " lanes"]]:
        """Sums over each lane's subsets of v A_S^-1, and of v, from those over the finest lanes; one row less than moments."""
        self.spreads[-1][:] = spread
        for level in reversed(range(len(self.slopes))):
            joined = self.spreads[level]
            self._join(self.spreads[level + 1], self.slopes[level][:-1], level, joined)
            fewer, more = _halves(scale)
            joined[0, 0] -= self.inverses[level] * more
            scale = fewer + more
        return self.spreads[0], scale

    def _join(self, halves: np.ndarray, slope: np.ndarray, level: int, out: np.ndarray) -> None:
        """Moments of a lane from those of its halves."""
        without, present = _halves(halves)
        product = self.product[: present.size].reshape(present.shape)
        np.add(without, present, out=out[1:, 1:])
        np.multiply(present, slope[:, None], out=product)
        cross = np.sum(product, axis=0, out=out[0, 1:])
        out[1:, 0] = cross
        np.sum(slope * cross, axis=0, out=out[0, 0])


def _by_turns(shapes: list[tuple[int, ...]]) -> list[np.ndarray]:
    """Arrays of which every second one lies in the same memory, so that what is in use stays in cache."""
    sizes = [int(np.prod(shape)) for shape in shapes]
    pair = [np.empty(max(sizes[turn::2], default=0)) for turn in (0, 1)]
    return [pair[i % 2][:size].reshape(shape) for i, (size, shape) in enumerate(zip(sizes, shapes, strict=True))]


def _halves(lanes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Views of the lanes without the last term, and of those with it."""
    half = lanes.shape[-1] // 2
    return lanes[..., :half], lanes[..., half:]
