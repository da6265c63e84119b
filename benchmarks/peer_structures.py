"""PySINDy and SysIdentPy on surge trials, in an environment of their own: trials come as JSON on stdin, terms go to stdout.

Speed and propeller speed are given in shares of their trim, so that all columns are of order one. PySINDy's library has the same seven
terms as ours. SysIdentPy selects among polynomials of degree 3 in the last speed and propeller speed; the last speed itself, which every
discrete model has, says nothing about X_u and is not counted.
"""

import contextlib
import json
import sys
import time
import warnings

import numpy as np
import pysindy as ps  # pyright: ignore[reportMissingImports]
import sysidentpy  # pyright: ignore[reportMissingImports]
from sysidentpy.basis_function import Polynomial  # pyright: ignore[reportMissingImports]
from sysidentpy.model_structure_selection import FROLS  # pyright: ignore[reportMissingImports]

TERMS = {
    "X_0": lambda u, n: 1.0 + 0.0 * u,
    "X_u": lambda u, n: u + 0.0 * n,
    "X_uabsu": lambda u, n: u * np.abs(u) + 0.0 * n,
    "X_u3": lambda u, n: u**3 + 0.0 * n,
    "T_n": lambda u, n: n + 0.0 * u,
    "T_nabsn": lambda u, n: n * np.abs(n) + 0.0 * u,
    "T_un": lambda u, n: u * n,
}
PATH = np.geomspace(1e-4, 0.3, 15)
"""Thresholds tried where they are chosen."""
POWERS = {
    (): "X_0",
    ("y", "y"): "X_uabsu",
    ("y", "y", "y"): "X_u3",
    ("x",): "T_n",
    ("x", "x"): "T_nabsn",
    ("x", "y"): "T_un",
}


def main() -> None:
    """Answer."""
    question = json.load(sys.stdin)
    methods = {
        "PySINDy, as it comes": sindy_default,
        "PySINDy, threshold by the other half": sindy_chosen,
        "FROLS": frols,
    }
    names = {"FROLS": f"SysIdentPy {sysidentpy.__version__} FROLS, by AIC"}
    found = {}
    with contextlib.redirect_stdout(sys.stderr), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, method in methods.items():
            terms, start = [], time.perf_counter()
            for trial in question["trials"]:
                u, n = np.array(trial["u"]) / question["u"], np.array(trial["n"]) / question["n"]
                terms.append(method(u, n, question["step"]))
            seconds = (time.perf_counter() - start) / len(terms)
            label = names.get(name, name.replace("PySINDy", f"PySINDy {ps.__version__}"))
            found[label] = {"terms": terms, "seconds": seconds}
    json.dump(found, sys.stdout)


def sindy(u: np.ndarray, n: np.ndarray, step: float, threshold: float, normalize: bool) -> ps.SINDy:
    """A fit to one trial."""
    library = ps.CustomLibrary(
        library_functions=list(TERMS.values()), function_names=[lambda u, n, k=k: k for k in TERMS]
    )
    optimizer = ps.STLSQ(threshold=threshold, normalize_columns=normalize)
    model = ps.SINDy(optimizer, library, ps.SmoothedFiniteDifference())
    model.fit(u[:, None], t=step, u=n[:, None])
    return model


def sindy_default(u: np.ndarray, n: np.ndarray, step: float) -> list[str]:
    """Threshold 0.1."""
    return present(sindy(u, n, step, 0.1, False))


def sindy_chosen(u: np.ndarray, n: np.ndarray, step: float) -> list[str]:
    """The threshold whose fit to the first half predicts the accelerations of the second best, then all of the trial."""
    half, scores = u.size // 2, []
    for threshold in PATH:
        model = sindy(u[:half], n[:half], step, threshold, True)
        scores.append(model.score(u[half:, None], t=step, u=n[half:, None]))
    return present(sindy(u, n, step, PATH[int(np.argmax(scores))], True))


def present(model: ps.SINDy) -> list[str]:
    """Terms with a coefficient."""
    return [name for name, value in zip(TERMS, model.coefficients()[0], strict=True) if value != 0]


def frols(u: np.ndarray, n: np.ndarray, step: float) -> list[str]:
    """Forward regression with orthogonal least squares."""
    model = FROLS(ylag=1, xlag=1, basis_function=Polynomial(degree=3), order_selection=True, n_info_values=10)
    model.fit(X=n[:, None], y=u[:, None])
    found = []
    for regressor in model.final_model:
        factors = tuple(sorted("y" if code // 1000 == 1 else "x" for code in regressor if code))
        if factors != ("y",):
            found.append(POWERS.get(factors, "other"))
    return found


if __name__ == "__main__":
    main()
