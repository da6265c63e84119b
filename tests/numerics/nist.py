"""The 27 nonlinear-regression problems of NIST's Statistical Reference Datasets (StRD): data, models and certified answers.

Numbers: `nist/*.toml`, from https://www.itl.nist.gov/div898/strd/ (public domain). Two public copies of the files were compared:
they agree but for b1 of Roszman1, where one has 1.2019...; the certified residual sum of squares decides for .20196866396.
"""

import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from seatrial.numerics.least_squares import LeastSquares, least_squares


def _gauss(b, x):
    return b[0] * jnp.exp(-b[1] * x) + sum(b[i] * jnp.exp(-((x - b[i + 1]) ** 2) / b[i + 2] ** 2) for i in (2, 5))


def _lanczos(b, x):
    return sum(b[i] * jnp.exp(-b[i + 1] * x) for i in (0, 2, 4))


def _chwirut(b, x):
    return jnp.exp(-b[0] * x) / (b[1] + b[2] * x)


def _saturation(b, x):
    return b[0] * (1 - jnp.exp(-b[1] * x))


def _cubics(b, x):
    return (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def _waves(b, x):
    def wave(cosine, sine, period):
        return cosine * jnp.cos(2 * jnp.pi * x / period) + sine * jnp.sin(2 * jnp.pi * x / period)

    return b[0] + wave(b[1], b[2], 12) + wave(b[4], b[5], b[3]) + wave(b[7], b[8], b[6])


MODELS: dict[str, Callable] = {
    # Of Nelson the logarithm of y is modelled.
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": _saturation,
    "Chwirut1": _chwirut,
    "Chwirut2": _chwirut,
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "ENSO": _waves,
    "Eckerle4": lambda b, x: b[0] / b[1] * jnp.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": _gauss,
    "Gauss2": _gauss,
    "Gauss3": _gauss,
    "Hahn1": _cubics,
    "Kirby2": lambda b, x: (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2),
    "Lanczos1": _lanczos,
    "Lanczos2": _lanczos,
    "Lanczos3": _lanczos,
    "MGH09": lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * jnp.exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * jnp.exp(-x * b[3]) + b[2] * jnp.exp(-x * b[4]),
    "Misra1a": _saturation,
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** -2),
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * jnp.exp(-b[2] * x[1]),
    "Rat42": lambda b, x: b[0] / (1 + jnp.exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + jnp.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x - jnp.arctan(b[2] / (x - b[3])) / jnp.pi,
    "Thurber": _cubics,
}


class Problem(NamedTuple):
    """One problem as NIST certifies it.

    Attributes:
        difficulty: `lower`, `average` or `higher`, as NIST says.
        starts: NIST's start 1 and start 2.
        certified: parameters; beside them their standard deviations, residual sum of squares and residual standard deviation.
        data: y, shape (m,), and x, shape (m,) or (2, m).
    """

    name: str
    difficulty: str
    starts: tuple[np.ndarray, np.ndarray]
    certified: np.ndarray
    certified_se: np.ndarray
    certified_rss: float
    certified_sd: float
    data: tuple[np.ndarray, np.ndarray]

    @property
    def residual(self) -> Callable:
        """Residuals; one function for each model, so that problems of one model share compiled code."""
        return _residual(MODELS[self.name])

    def solve(self, start: int) -> LeastSquares:
        """Our answer from NIST's start 1 or 2."""
        return least_squares(self.residual, self.data, self.starts[start - 1])


class Digits(NamedTuple):
    """Correct significant digits: the least log relative error over parameters, and over all standard deviations."""

    parameters: float
    deviations: float


def problem(name: str) -> Problem:
    """Read one problem."""
    told = tomllib.loads((Path(__file__).parent / "nist" / f"{name}.toml").read_text(encoding="utf-8"))
    y = np.log(told["y"]) if name == "Nelson" else np.array(told["y"])
    x = np.array(told["x"]) if "x" in told else np.array([told["x1"], told["x2"]])
    starts = np.array(told["start_1"]), np.array(told["start_2"])
    certified = np.array(told["certified"]), np.array(told["certified_se"]), told["certified_rss"], told["certified_sd"]
    return Problem(name, told["difficulty"], starts, *certified, (y, x))


def digits(told: Problem, answer: LeastSquares) -> Digits:
    """Compare an answer with what NIST certifies, to 11 digits at most, which is what NIST prints."""
    deviations = np.append(answer.se, answer.sd), np.append(told.certified_se, told.certified_sd)
    return Digits(_log_relative_error(answer.x, told.certified), _log_relative_error(*deviations))


def table() -> str:
    """All problems from both starts: correct digits of parameters and of standard deviations, and steps taken."""
    lines = [f"{'':9} {'':8} {'start 1':^24}   {'start 2':^24}"]
    lines.append(f"{'problem':9} {'level':8} " + "   ".join([f"{'param.':>7} {'dev.':>7} {'steps':>8}"] * 2))
    for name in MODELS:
        told, cells = problem(name), []
        for start in (1, 2):
            answer = told.solve(start)
            found = digits(told, answer)
            cells.append(f"{found.parameters:7.1f} {found.deviations:7.1f} {answer.iterations:8d}")
        lines.append(f"{name:9} {told.difficulty:8} " + "   ".join(cells))
    return "\n".join(lines)


@cache
def _residual(model: Callable) -> Callable:
    return lambda b, data: data[0] - model(b, data[1])


def _log_relative_error(found: np.ndarray, true: np.ndarray) -> float:
    return float(np.min(-np.log10(np.maximum(np.abs(found / true - 1), 1e-11))))


if __name__ == "__main__":
    print(table())
