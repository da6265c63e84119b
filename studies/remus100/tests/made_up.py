"""Made-up results of every part, such that each claim holds as the paper makes it and figures are quick to draw; tests change them."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from studies.remus100.designs import PERIODS
from studies.remus100.iteration import FITS
from studies.remus100.reading import NAMES, Reading
from studies.remus100.registry import ENTRIES
from studies.remus100.study import Item, Number, Sizes, Study
from studies.remus100.tests.studies import TINY, A
from tests.cases import RPM

PRINTED = np.array([-1.21, -2.93, 6.28])
SD = np.array([0.4, 0.2, 0.1])
DOUBTED = (*NAMES, "X_du3")
FILTERS = ("EKF", "UKF", "SRUKF", "SRUKF-C")
METHODS = ("importance sampling", "bridge sampling")
VERDICTS = ("reproduced", "not comparable", "contradicted")


def trial(time: np.ndarray) -> dict[str, tuple]:
    """A propeller that steps to both sides of its trim, and two channels seen through noise."""
    true = np.column_stack([1.5 + 0.1 * np.sin(time), 0.1 * np.cos(time)])
    noise = 0.1 * np.random.default_rng(3).normal(size=true.shape)
    both = ("time", "channel")
    return {"n": ("time", A.turns + 20 * np.sign(np.sin(time))), "true": (both, true), "measured": (both, true + noise)}


def filters() -> xr.Dataset:
    """Four equal filters, but the EKF quicker and closer, the UKF failing once, and the constrained one at half the error."""
    kind, seeds, time = ("filter",), 40, np.arange(1500) * 0.01
    draws = SD * np.random.default_rng(0).normal(size=(seeds, 3))
    falling = np.multiply.outer(1 / (0.05 + time), SD)
    shown = trial(time)
    clipped = np.zeros((4, 1500))
    clipped[3, :50] = 1
    return xr.Dataset(
        {
            "final_mean": (("filter", "seed", "coefficient"), PRINTED + np.multiply.outer([1, 1, 1, 0.5], draws)),
            "final_sd": (("filter", "seed", "coefficient"), np.tile(SD, (4, seeds, 1))),
            "relative_error": (
                ("filter", "seed", "mark", "coefficient"),
                np.tile(np.array([0.1, 0.2, 0.2, 0.1])[:, None, None, None], (1, seeds, 15, 3)),
            ),
            "clipped": (("filter", "time"), clipped),
            "early_udot_error": (("filter", "seed"), np.tile([[0.1], [0.1], [0.1], [0.2]], seeds)),
            "failures": (kind, [0, 1, 0, 0]),
            "smallest_sd": (kind, [1e-3] * 4),
            "sd": (("filter", "time", "coefficient"), np.tile(falling, (4, 1, 1))),
            "mean": (("filter", "time", "coefficient"), PRINTED + np.tile(falling, (4, 1, 1))),
            "u": (("filter", "time"), np.tile(shown["true"][1][:, 0], (4, 1))),
            "udot": (("filter", "time"), np.tile(shown["true"][1][:, 1], (4, 1))),
            "seconds": (kind, [0.01, 0.02, 0.03, 0.03]),
            **shown,
        },
        {
            "filter": list(FILTERS),
            "channel": ["u", "udot"],
            "seed": np.arange(seeds),
            "coefficient": list(NAMES),
            "mark": np.arange(1.0, 16.0),
            "time": time,
        },
    )


def tuning() -> xr.Dataset:
    """Everything twice as large after a change, but residuals half as large."""
    change = ["as printed", "P x 1e4", "Q x 1e4", "R x 100"]
    size = np.tile(np.array([1.0, 2, 2, 2])[:, None, None], (1, 4, 3))
    names = ("error", "sd", "error_at_3_s", "travelled")
    return xr.Dataset(
        {
            **dict.fromkeys(names, (("change", "seed", "coefficient"), size)),
            "residual": (("change", "seed"), 1 / size[..., 0]),
            "noise": ("channel", [0.101, 0.099]),
            "noise_error": ("channel", [0.001, 0.001]),
        },
        {"change": change, "coefficient": list(NAMES)},
        {"findings": json.dumps({name: ["something"] for name in change})},
    )


def sweep(peak: float, drop: float) -> xr.Dataset:
    """Gain over amplitude and period, with one ridge and a drop behind it."""
    over_period = np.where(peak >= PERIODS, 0.1 * PERIODS, 0.1 * peak - drop)
    gain = 20 + np.add.outer(0.05 * np.arange(20), over_period)
    return xr.Dataset(
        {"gain": (("amplitude", "period"), gain), "seconds": ((), 0.4)},
        {"amplitude": np.linspace(100, 200, 20) * RPM, "period": PERIODS},
    )


def chosen_doublet() -> xr.Dataset:
    """Standard deviations that fall until 41 s."""
    time = np.arange(6000) * 0.01
    sd = np.multiply.outer(1 / (1 + np.minimum(time, 41)), SD)
    shown, every = trial(time), ("time", "coefficient")
    estimates = {name: ("time", shown["true"][1][:, i]) for i, name in enumerate(("u", "udot"))}
    return xr.Dataset(
        {"sd": (every, sd), "mean": (every, PRINTED + sd), **estimates, **shown},
        {"time": time, "coefficient": list(NAMES), "channel": ["u", "udot"]},
    )


def relay() -> xr.Dataset:
    """Designs that oscillate, and as many that do not."""
    time = 0.1 * np.arange(150)
    return xr.Dataset(
        {
            "gain": (("amplitude", "threshold"), [[25.0, 23.0], [18.0, 17.0]]),
            "switches": (("amplitude", "threshold"), [[9, 1], [9, 1]]),
            "n": ("time", A.turns + 20 * np.sign(np.sin(time))),
            "u": ("time", 1.5 + 0.2 * np.sin(time)),
        },
        {"amplitude": [200 * RPM, 100 * RPM], "threshold": [0.4, 0.5], "time": time},
        {"best_amplitude": 200 * RPM, "best_threshold": 0.4},
    )


def iteration() -> xr.Dataset:
    """A redesigned second trial that teaches ten times more."""
    designs = ["doublets of 10 s", "doublets of 29 s"]
    table = np.multiply.outer([6.0, 4.0, 0.5], np.ones(4))
    return xr.Dataset(
        {
            "alone": (("design", "coefficient"), table[:2]),
            "both": (("design", "coefficient"), table[1:]),
            "first_sd": ("coefficient", np.full(4, 6.5)),
            "full_sd": (("fit", "coefficient"), table),
            "reduced_sd": (("fit", "coefficient"), table),
            "probability": ("fit", [0.3, 0.2, 0.02]),
            "error": ("fit", [0.001] * 3),
        },
        {"design": designs, "fit": list(FITS), "coefficient": list(DOUBTED)},
    )


def chain(sd: float, names: tuple[str, ...], seconds: float = 10.0) -> xr.Dataset:
    """Estimates one sd from the truth, normal draws, four chains that agree."""
    names, rng = (*names, "sigma_u"), np.random.default_rng(1)
    ones = np.ones(len(names))
    truth = np.array([*PRINTED, *([0.1] if "X_du3" in names else []), 0.0757])
    draws = truth + sd * rng.normal(size=(4, 500, len(names)))
    ends = {"hpd_low": truth - 2 * sd, "hpd_high": truth + 2 * sd}
    columns = ends | {
        "mean": truth + sd,
        "truth": truth,
        "sd": sd * ones,
        "mcse": 0.01 * sd * ones,
        "r_hat": 1.001 * ones,
    }
    return xr.Dataset(
        {
            **{name: ("parameter", column) for name, column in columns.items()},
            "ess": ("parameter", 10_000 * ones),
            "draws": (("chain", "draw", "parameter"), draws),
            "trace": (("iteration", "parameter"), draws[0, :101]),
            "raw_acf": (("lag", "parameter"), np.ones((201, len(names)))),
            "geweke_start": ("interval", 100.0 * np.arange(20)),
            "geweke": (("interval", "parameter"), np.tile(0.5 * ones, (20, 1))),
            "printed_geweke": (("interval", "parameter"), np.tile(0.1 * ones, (20, 1))),
            "acf": (("lag", "parameter"), np.multiply.outer(0.5 ** np.arange(201), ones)),
            "covariance": (("parameter", "other"), np.eye(len(names))),
            "acceptance": ((), 0.23),
            "seconds": ((), seconds),
            "criterion_value": ("criterion", [-1000.0, -996.0, 4.0, -1004.0, -1000.0, -1000.0]),
            "criterion_error": ("criterion", [0.1] * 6),
        },
        {
            "parameter": list(names),
            "criterion": ["DIC", "BPIC", "p_D", "Dbar", "WAIC", "PSIS-LOO"],
            "iteration": 100 * np.arange(101),
            "lag": np.arange(201),
        },
    )


def full_chain() -> xr.Dataset:
    """M-0: wider, farther, its criteria higher by one; X_du3 a hundred times more uncertain than it is large."""
    data = chain(0.4, DOUBTED)
    sd = xr.where(data["parameter"] == "X_du3", 10.0, data["sd"])
    higher = [-999.0, -994.0, 5.0, -1004.0, -999.0, -999.0]
    return data.assign(sd=sd, criterion_value=("criterion", higher))


def starts() -> xr.Dataset:
    """From half the truth a chain arrives after 300 iterations, from the mode it need not."""
    height = np.zeros((2, 21, 4))
    height[0, :3] = -1e4
    return xr.Dataset(
        {"height": (("start", "iteration", "chain"), height)},
        {"start": ["half the truth", "posterior mode"], "iteration": 100 * np.arange(21)},
    )


def listing(p: float) -> xr.Dataset:
    """A Listing 1 that works: 1 000 effective draws, each seed near the printed number."""
    probability = p + 0.01 * np.random.default_rng(2).normal(size=(10, 2)) * [1, -1]
    both = ("repeat", "model")
    return xr.Dataset(
        {
            "probability": (both, probability),
            "shared_probability": (("shared_repeat", "model"), probability[:5]),
            "log_values": (both, np.full((10, 2), 6950.0) + 0.01 * np.arange(10)[:, None]),
            "ess": (both, np.full((10, 2), 1000.0)),
        },
        {"model": ["M-0", "M-1"]},
    )


def evidence(p: float) -> xr.Dataset:
    """Two methods that agree on the printed probability."""
    logs = np.tile([6950.0, 6950.0 - np.log(p / (1 - p))], (2, 1))
    return xr.Dataset(
        {
            "log_value": (("method", "model"), logs),
            "error": (("method", "model"), np.full((2, 2), 0.01)),
            "wide_log_value": ((), 6950.0),
            "wide_error": ((), 0.01),
        },
        {"method": list(METHODS), "model": ["M-0", "M-1"]},
    )


def odds() -> xr.Dataset:
    """Undecided at the printed values, certain at the largest."""
    p = np.multiply.outer([0.5, 0.49, 0.9, 1.0], np.ones(3))
    return xr.Dataset({"probability": (("value", "seed"), p)}, {"value": [0.1, 1.0, -20.0, -60.0]})


def readings() -> xr.Dataset:
    """Standard deviations under B 1.6 times those under A, probabilities the same."""
    sds = np.multiply.outer([1.0, 1.6], SD)
    return xr.Dataset(
        {
            **dict.fromkeys(("filter_sd", "fit_sd", "full_fit_sd"), (("reading", "coefficient"), sds)),
            "gain_10_s": ("reading", [25.0, 24.6]),
            "gain_20_s": ("reading", [25.2, 24.8]),
            "probability": (("reading", "value"), [[0.5, 0.49], [0.5, 0.5]]),
        },
        {"reading": ["A", "B"], "coefficient": list(NAMES), "value": [0.1, 1.0]},
    )


def vehicle() -> xr.Dataset:
    """Speeds that rise by 0.1 m/s and agree to a tenth of that."""
    time = np.arange(1000) * 0.01
    rise = 1.5 + 0.1 * (1 - np.exp(-time / 3))
    states = np.column_stack([rise, *np.zeros((4, 1000))])
    return xr.Dataset(
        {
            "a": (("state", "by_state"), -np.eye(5)),
            "trim": ("state", [1.5, 0, 0, 0, 0]),
            "eigenvalues": (("mode", "part"), [[-0.3, 0], [0.4, 0], [-1, 0.7], [-1, -0.7], [0, 0]]),
            "full": (("time", "state"), states),
            "linear": (("time", "state"), 1.001 * states),
            "surge": ("time", rise),
        },
        {"state": ["u", "w", "q", "z", "theta"], "time": time},
        {"surge_trim": 1.5},
    )


def equations() -> xr.Dataset:
    """One row of each section, exact, and one that is sampled."""
    rows = [("(4)", "slope"), ("(13), (14)", "entropy"), ("(6), (7), (9), (10)", "by draws"), ("(18) to (20)", "prior")]
    equation, what = zip(*rows, strict=True)
    return xr.Dataset(
        {"ours": ("row", [-0.4, 4.0, 4.0, 2.0]), "independent": ("row", [-0.4, 4.0, 4.01, 2.0])},
        {"equation": ("row", list(equation)), "what": ("row", list(what))},
    )


BUILD: dict[str, Callable[[], xr.Dataset]] = {
    "equations": equations,
    "vehicle": vehicle,
    "filters": filters,
    "tuning": tuning,
    "sweep-short": partial(sweep, 10.0, 0.1),
    "sweep-medium": partial(sweep, 10.0, 0.2),
    "sweep-long": partial(sweep, 11.0, 0.3),
    "sweep-ekf": partial(sweep, 10.0, 0.2),
    "chosen-doublet": chosen_doublet,
    "relay": relay,
    "iteration": iteration,
    "chain-3": partial(chain, 0.1, NAMES),
    "chain-3-metropolis": partial(chain, 0.1, NAMES, seconds=1000.0),
    "chain-6-full": full_chain,
    "chain-6-reduced": partial(chain, 0.1, NAMES),
    "starts": starts,
    "listing-4": partial(listing, 0.4642),
    "listing-5": partial(listing, 0.5501),
    "evidence-4": partial(evidence, 0.4642),
    "evidence-5": partial(evidence, 0.5501),
    "odds": odds,
    "readings": readings,
}
Change = Callable[[xr.Dataset], xr.Dataset]


def change(name: str, function: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Replace one variable by a function of its values."""
    return lambda data: data.assign({name: (data[name].dims, function(data[name].values.copy()))})


class InMemory(Study):
    """A study that keeps nothing on disk."""

    def part(self, name: str) -> xr.Dataset:
        return self.parts[name](self)


def make_items(keys: Sequence[str] = tuple(ENTRIES)) -> list[Item]:
    """One made-up item for each key, all verdicts among them."""
    numbers = (Number("rms error of X_u [m/s^2]", -1.21, -1.1243, 0.0026), Number("share", None, 0.25))
    kinds = len(VERDICTS)
    reasons = [f"reason {i}; more of X_uabsu" if i % kinds else "" for i in range(len(keys))]
    return [
        Item(key, f"Title of {key}", VERDICTS[i % kinds], reasons[i], numbers, {"seed": i})
        for i, key in enumerate(keys)
    ]


def made_up_study(
    changes: Mapping[str, Change] | None = None,
    reading: Reading = A,
    folder: Path = Path("nowhere"),
    sizes: Sizes = TINY,
) -> Study:
    """A study whose parts are made up, some of them changed."""
    changed = changes or {}

    def part(name: str) -> xr.Dataset:
        return changed[name](BUILD[name]()) if name in changed else BUILD[name]()

    parts = {name: lambda _, name=name: part(name) for name in BUILD}
    return InMemory(folder, reading, sizes, parts)
