"""A campaign small enough for tests: two seconds of chains instead of a minute."""

import os
import sys
from contextlib import contextmanager
from pathlib import Path

from seatrial.campaign.store.estimates import StoredCoefficient
from seatrial.campaign.store.stored_result import Store, StoredResult
from seatrial.campaign.store.summary import NextTrial, Summary
from seatrial.estimation.diagnostics.known import Known, KnownParameter
from seatrial.selection.verdict import StoredAverage
from tests.campaigns import import_log, joined, priors, sensors, uniform, write_campaign

SMALL = joined(
    """[campaign]
name = "small"
seed = 3

[vehicle]
catalogue = "remus100_surge"

[structure]
always = ["X_uabsu", "T_nabsn"]
optional = ["X_u"]
""",
    priors(X_u=uniform(-3.6, 1.2), X_uabsu=uniform(-8.8, 0.0)),
    """[prior.T_nabsn]
distribution = "uniform"
lower = 2.0e-4
upper = 12.0e-4
""",
    sensors(u="0.05 m/s"),
    """[limits.n]
lower = "0 rpm"
upper = "1500 rpm"

[design]
control = "n"
duration = "30 s"
active = "20 s"
sample_time = "0.1 s"
amplitude = { from = "100 rpm", to = "200 rpm", points = 3 }
period = { from = "2 s", to = "20 s", points = 4 }

[truth]
X_u = -1.21
X_uabsu = -2.93
T_nabsn = 6.28e-4

[estimation]
chains = 16
warmup = 500
draws = 1000

[selection]
particles = 256
repeats = 2
""",
)
LOGGED = (
    "[truth]\nX_u = -1.21\nX_uabsu = -2.93\nT_nabsn = 6.28e-4",
    import_log("1", "log_{run}.csv", u=("speed", "m/s"), n=("rpm", "rpm")),
)
"""A replacement by which runs were logged: the truth goes."""
NO_X_U = (
    ('optional = ["X_u"]', "optional = []"),
    ('[prior.X_u]\ndistribution = "uniform"\nlower = -3.6\nupper = 1.2\n', ""),
    ("X_u = -1.21\n", ""),
)
"""Replacements that leave one structure of two coefficients."""


def write_small(folder: Path, *replacements: tuple[str, str]) -> Path:
    """Write the small campaign into a folder, some of its text replaced."""
    write_campaign(folder, SMALL, *replacements)
    return folder


def write_summary(
    folder: Path,
    terms: tuple[str, ...] = (),
    chosen: str = "M-0",
    correlated: tuple[tuple[str, str, float], ...] = (),
    **found: tuple[float, float],
) -> None:
    """Write the summary of a campaign that has been run: mean and standard deviation of what it found, all else blank."""
    numbers = dict.fromkeys(list(StoredCoefficient.__dataclass_fields__)[3:-2], 0.0)
    rows = tuple(
        StoredCoefficient(**{"name": name, "unit": "", "label": name, **numbers, "mean": mean, "sd": sd})
        for name, (mean, sd) in found.items()
    )
    blank = dict.fromkeys(KnownParameter.__dataclass_fields__, 0.0)
    partners = (
        KnownParameter(**{**blank, "name": a, "unit": "", "partner": b, "correlation": r}) for a, b, r in correlated
    )
    summary = Summary(
        name="small",
        chosen=chosen,
        terms=terms,
        coefficients=rows,
        quote=tuple(StoredAverage(one.name, "", one.name, one.mean, one.sd, 0.0, 0.0, "", 1.0) for one in rows),
        usable=True,
        known=Known("after", chosen, tuple(partners), (), ()),
        next_trial=NextTrial("", False, None),
        quoted="chosen",
        inclusion={},
        inclusion_error={},
        **dict.fromkeys(
            (
                "structures",
                "verdicts",
                "cautions",
                "findings",
                "alarms",
                "choice_alarms",
                "fits",
                "pooled",
                "baselines",
                "averaged",
            ),
            (),
        ),
    )
    StoredResult(Store(folder).summary, "any", Summary).write(summary)


# Which files are opened, as Python itself tells it.

_OPENED: list[set[Path]] = []


def _hear(event, about):
    if _OPENED and event in ("open", "os.listdir", "os.scandir") and isinstance(about[0], str | os.PathLike):
        _OPENED[0].add(Path(about[0]).absolute())


sys.addaudithook(_hear)


@contextmanager
def hearing_of_files(folder):
    """Files and folders below a folder that Python opens in the block, beside temporary ones and checkpoints."""
    found = set()
    _OPENED.append(found)
    try:
        yield found
    finally:
        _OPENED.clear()
        passing = {path for path in found if path.suffix in (".part", ".npz") or (path.is_dir() and path.name != "bag")}
        found -= {path for path in found if not path.is_relative_to(folder)} | passing
