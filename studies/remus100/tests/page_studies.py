"""A study whose parts are made up: small, of the shapes that are really computed, and quick to draw."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from studies.remus100.iteration import FITS
from studies.remus100.registry import ENTRIES
from studies.remus100.study import QUICK, Item, Number, Part, Sizes, Study
from studies.remus100.tuning import CHANGES
from studies.remus100.vehicle_file import NAMES, READINGS, Reading

A = READINGS["A"]
FILTERS = ("EKF", "UKF", "SRUKF", "SRUKF-C")
TIME = 0.1 * np.arange(150)
CHANNELS = ("u", "udot")
METHODS = ("importance sampling", "bridge sampling", "tempered SMC", "nested sampling")
VERDICTS = ("reproduced", "reproduced in shape", "differs", "cannot hold")


def make_study(folder: Path, reading: Reading = A, sizes: Sizes = QUICK) -> Study:
    """Return a study whose parts are made up as they are asked for."""
    return Study(folder, reading, sizes, PARTS)


def make_items(keys: Sequence[str] = tuple(ENTRIES)) -> list[Item]:
    """Return one made-up item for each key, all verdicts among them."""
    numbers = (Number("rms error of X_u [m/s^2]", -1.21, -1.1243, 0.0026), Number("share", None, 0.25))
    return [
        Item(
            key,
            f"Title of {key}",
            VERDICTS[i % 4],
            f"reason {i}; more of X_uabsu" if i % 4 else "",
            numbers,
            {"seed": i},
        )
        for i, key in enumerate(keys)
    ]


def _vehicle(study: Study) -> xr.Dataset:
    full = _random(0).normal(size=(TIME.size, 5))
    return xr.Dataset(
        {
            "full": (("time", "state"), full),
            "linear": (("time", "state"), full + 0.1),
            "surge": ("time", full[:, 0] - 0.1),
            "eigenvalues": (("mode", "part"), [[-3.0, 0.0], [-0.3, 0.0], [0.0, 0.0], [0.3, 0.5], [0.3, -0.5]]),
        },
        {"state": ["u", "w", "q", "z", "theta"], "time": TIME},
    )


def _filters(study: Study) -> xr.Dataset:
    random, shape = _random(1), (len(FILTERS), TIME.size)
    truth = np.array(list(study.reading.printed_truth.values()))
    true = np.column_stack([1.5 + 0.1 * np.sin(TIME), 0.1 * np.cos(TIME)])
    return xr.Dataset(
        {
            "n": ("time", study.reading.trim + 20 * np.sign(np.sin(TIME))),
            "measured": (("time", "channel"), true + 0.1 * random.normal(size=true.shape)),
            "true": (("time", "channel"), true),
            "u": (("filter", "time"), true[:, 0] + 0.01 * random.normal(size=shape)),
            "udot": (("filter", "time"), true[:, 1] + 0.01 * random.normal(size=shape)),
            "mean": (("filter", "time", "coefficient"), truth + 0.1 * random.normal(size=(*shape, 3))),
            "sd": (("filter", "time", "coefficient"), 1.0 + random.random((*shape, 3))),
            "clipped": (("filter", "time"), random.poisson(3.0, shape).astype(float)),
        },
        {
            "filter": list(FILTERS),
            "time": TIME,
            "coefficient": list(NAMES),
            "channel": list(CHANNELS),
            "seed": np.arange(4),
        },
    )


def _doublet(study: Study) -> xr.Dataset:
    one = _filters(study).sel(filter="SRUKF", drop=True)
    return one[["n", "measured", "true", "u", "udot", "mean", "sd"]]


def _tuning(study: Study) -> xr.Dataset:
    random, changes = _random(2), list(CHANGES)
    by_coefficient = {
        name: (("change", "seed", "coefficient"), 0.1 + random.random((len(changes), 3, len(NAMES))))
        for name in ("error", "sd", "travelled")
    }
    whole = {name: (("change", "seed"), random.random((len(changes), 3))) for name in ("residual", "state_error")}
    return xr.Dataset(by_coefficient | whole, {"change": changes, "coefficient": list(NAMES)})


def _sweep(study: Study, level: float) -> xr.Dataset:
    amplitude, period = np.linspace(study.reading.lowest, study.reading.highest, 5), np.linspace(1.0, 20.0, 6)
    gain = level + np.add.outer(0.02 * amplitude, np.sin(period))
    return xr.Dataset({"gain": (("amplitude", "period"), gain)}, {"amplitude": amplitude, "period": period})


def _relay(study: Study) -> xr.Dataset:
    amplitude, threshold = np.linspace(study.reading.lowest, study.reading.highest, 5), np.linspace(0.1, 0.5, 4)
    gain = 20.0 + np.add.outer(0.1 * amplitude, threshold)
    switches = np.where(threshold > 0.4, 1, 6) * np.ones((5, 1), int)
    return xr.Dataset(
        {
            "gain": (("amplitude", "threshold"), gain),
            "switches": (("amplitude", "threshold"), switches),
            "n": ("time", study.reading.trim + 20 * np.sign(np.sin(TIME))),
            "u": ("time", 1.5 + 0.2 * np.sin(TIME)),
        },
        {"amplitude": amplitude, "threshold": threshold, "time": TIME},
        {"best_amplitude": amplitude[-1], "best_threshold": threshold[2]},
    )


def _chain(study: Study, full: bool) -> xr.Dataset:
    random, reading = _random(3), study.reading
    names = (*NAMES, *((reading.doubted,) if full else ()), "sigma_u")
    truth = np.array([reading.printed_truth.get(name, 0.1) for name in names])
    draws = truth + 0.1 * random.normal(size=(2, 500, len(names)))
    lag = np.arange(31)
    one = {
        "mean": draws.mean((0, 1)),
        "sd": draws.std((0, 1)),
        "hpd_low": np.quantile(draws, 0.025, (0, 1)),
        "hpd_high": np.quantile(draws, 0.975, (0, 1)),
        "truth": truth,
    }
    return xr.Dataset(
        {
            **{name: ("parameter", column) for name, column in one.items()},
            "draws": (("chain", "draw", "parameter"), draws),
            "trace": (("iteration", "parameter"), draws[0, :101]),
            "raw_acf": (("lag", "parameter"), np.ones((lag.size, len(names)))),
            "acf": (("lag", "parameter"), np.exp(-lag / 5.0)[:, None] * np.ones(len(names))),
            "geweke": (("interval", "parameter"), random.normal(size=(20, len(names)))),
            "geweke_start": ("interval", 100.0 * np.arange(20)),
        },
        {"parameter": list(names), "iteration": 100 * np.arange(101), "lag": lag},
    )


def _listing(study: Study) -> xr.Dataset:
    p = np.array([0.0, 0.01, 0.02, 0.99, 1.0, 1.0, 1.0, 0.5])
    pair = np.stack([p, 1 - p], -1)
    return xr.Dataset(
        {"probability": (("repeat", "model"), pair), "shared_probability": (("shared_repeat", "model"), pair[-3:])},
        {"model": ["M-0", "M-1"]},
    )


def _evidence(study: Study) -> xr.Dataset:
    values = 6951.0 + np.column_stack([0.1 * np.arange(4), np.zeros(4)])
    return xr.Dataset(
        {"log_value": (("method", "model"), values), "error": (("method", "model"), np.full((4, 2), 0.05))},
        {"method": list(METHODS), "model": ["M-0", "M-1"]},
    )


def _odds(study: Study) -> xr.Dataset:
    p = np.array([[0.49, 0.51, 0.5], [0.48, 0.5, 0.46], [0.9, 0.99, 0.95], [1.0, 1.0, 0.999]])
    return xr.Dataset({"probability": (("value", "seed"), p)}, {"value": [0.1, 1.0, -20.0, -60.0]})


def _iteration(study: Study) -> xr.Dataset:
    designs, names = ["doublets of 5 s", "doublets of 29 s", "self-oscillating test"], [*NAMES, study.reading.doubted]
    alone = 1.0 + _random(4).random((len(designs), len(names)))
    return xr.Dataset(
        {
            "alone": (("design", "coefficient"), alone),
            "both": (("design", "coefficient"), 0.5 * alone),
            "first_sd": ("coefficient", np.full(len(names), 1.5)),
            "full_sd": (("fit", "coefficient"), np.array([1.0, 0.7, 0.1])[:, None] * np.ones(len(names))),
            "probability": ("fit", [0.3, 0.2, 0.02]),
            "error": ("fit", [0.01, 0.01, 0.001]),
        },
        {"design": designs, "coefficient": names, "fit": list(FITS)},
    )


def _random(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


PARTS: dict[str, Part] = {
    "vehicle": _vehicle,
    "filters": _filters,
    "chosen-doublet": _doublet,
    "tuning": _tuning,
    "sweep-short": partial(_sweep, level=20.0),
    "sweep-medium": partial(_sweep, level=21.0),
    "sweep-long": partial(_sweep, level=22.0),
    "relay": _relay,
    "chain-3": partial(_chain, full=False),
    "chain-6-full": partial(_chain, full=True),
    "chain-6-reduced": partial(_chain, full=False),
    "listing-4": _listing,
    "listing-5": _listing,
    "evidence-4": _evidence,
    "evidence-5": _evidence,
    "odds": _odds,
    "iteration": _iteration,
}
"""Made-up parts by name: those that figures are drawn from."""
