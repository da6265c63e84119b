"""PySINDy's fit of the surge vehicle, in an environment of its own: the log comes as JSON on stdin, coefficients go to stdout.

Its library holds the three terms that are there, and no threshold removes any: least squares of smoothed derivatives, as they come.
"""

import json
import sys
import warnings

import numpy as np
import pysindy as ps  # pyright: ignore[reportMissingImports]
from timing import processor_seconds

REPEATS = 5
TERMS = {
    "X_u": lambda u, n: u + 0.0 * n,
    "X_uabsu": lambda u, n: u * np.abs(u) + 0.0 * n,
    "T_nabsn": lambda u, n: n * np.abs(n) + 0.0 * u,
}


def fit(question: dict) -> list[float]:
    """Return the coefficients of `TERMS`, SI."""
    speed, control = np.array(question["measured"]), np.array(question["control"])
    u_size, n_size = np.abs(speed).mean(), np.abs(control).mean()
    names = [lambda u, n, name=name: name for name in TERMS]
    library = ps.CustomLibrary(library_functions=list(TERMS.values()), function_names=names)
    model = ps.SINDy(ps.STLSQ(threshold=0.0, alpha=0.0), library, ps.SmoothedFiniteDifference())
    model.fit(speed[:, None] / u_size, t=question["step"], u=control[:, None] / n_size)
    sizes = np.array([1.0, 1.0 / u_size, u_size / n_size**2 / question["share"]])
    return (question["mass"] * sizes * model.coefficients()[0]).tolist()


def main() -> None:
    """Answer."""
    question = json.load(sys.stdin)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        values, first, again = processor_seconds(lambda: fit(question), REPEATS)
    json.dump({"values": values, "version": ps.__version__, "first": first, "again": again.tolist()}, sys.stdout)


if __name__ == "__main__":
    main()
