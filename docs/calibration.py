"""Calibrate nine error models with the default sampler, and every method with white noise: `python docs/calibration.py`.

About 20 minutes on two cores; an interrupted run resumes. Writes docs/dev/calibration.svg and the table in docs/dev/calibration.md.
"""

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from equation_error_ranks import equation_error_ranks
from matplotlib.figure import Figure

import seatrial
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.calibration import calibrate
from seatrial.cli.console import ConsoleReporter
from seatrial.core.files import write_text
from seatrial.estimation.diagnostics.calibration import DRAWS, Calibration
from seatrial.report.drawing import draw_svg
from seatrial.report.figures.style import BAND, BLUE, INK, ORANGE, POINT, SMALL, own_settings, style_axes
from seatrial.sampling.names import DEFAULT, METHODS

HERE = Path(__file__).parent
FOLDER = HERE.parent / "outputs" / "calibration"
REPLICATES = 400
WIDTH, ROW, BOTTOM = 640.0, 84.0, 40.0
RESULTS = "<!-- results -->"
"""Where the results begin in the page."""
BASE = """
[campaign]
name = "{name}"
seed = 11

[vehicle]
catalogue = "remus100_surge"

[structure]
always = ["X_u", "X_uabsu", "T_nabsn"]

[prior.X_u]
distribution = "normal"
mean = -1.2
sd = 0.4

[prior.X_uabsu]
distribution = "normal"
mean = -3.0
sd = 0.6

[prior.T_nabsn]
distribution = "uniform"
lower = 4.0e-4
upper = 9.0e-4

[sensors.u]
noise = "0.05 m/s"
{sensor}

[design]
control = "n"
duration = "30 s"
active = "20 s"
sample_time = "0.1 s"
amplitude = {{ from = "100 rpm", to = "300 rpm", points = 3 }}
period = {{ from = "2 s", to = "20 s", points = 4 }}

{trials}

[estimation]
{estimation}

{priors}
"""
TAU = '[prior.tau_u]\ndistribution = "log-uniform"\nlower = 0.2\nupper = 5.0'
PROCESS = '[prior.process_u]\ndistribution = "log-uniform"\nlower = 0.002\nupper = 0.1'
LAG = '[prior.lag_u]\ndistribution = "log-uniform"\nlower = 0.1\nupper = 3.0'
BIAS = '[prior.bias_u]\ndistribution = "normal"\nmean = 0.0\nsd = 0.1'
CURRENT = '[prior.current]\ndistribution = "normal"\nmean = 0.0\nsd = 0.2'
SPREAD = '[prior.spread_X_uabsu]\ndistribution = "half-normal"\nlower = 0.0\nscale = 0.5'
SIMULATED = "[truth]\nX_u = -1.21\nX_uabsu = -2.93\nT_nabsn = 6.28e-4"
"""The designed trial; calibration draws truths of its own."""
THREE = """
[import]
fit = ["1", "2", "3"]

[[import.files]]
path = "trial_{run}.csv"
time = { column = "t", unit = "s" }
channels.u = { column = "u", unit = "m/s" }
channels.n = { column = "n", unit = "rpm" }
"""
LIKELIHOODS = {
    "white": ("", "", ""),
    "coloured": ("", 'residuals = "coloured"', TAU),
    "heavy tails": ("", 'residuals = "heavy"', ""),
    "lag": ("lag = true", "", LAG),
    "bias": ('bias = "shared"', "", BIAS),
    "current": ("", 'current = "shared"', CURRENT),
    "free start": ("", 'initial = "estimated"', ""),
    "filter error": ("", 'likelihood = "filter-error"', PROCESS),
    "three trials that differ": ("", 'varying = ["X_uabsu"]', SPREAD),
}
"""Lines under `[sensors.u]` and `[estimation]`, and the priors that these ask for."""


def main() -> None:
    """Run every case and write what was found."""
    seatrial.configure()
    reporter = ConsoleReporter(False)
    with reporter.watching():
        found = {f"{name}, {DEFAULT}": run(name, DEFAULT, reporter) for name in LIKELIHOODS}
        found |= {f"white, {method}": run("white", method, reporter) for method in METHODS if method != DEFAULT}
        found["equation error, refined"] = equation_error_ranks(REPLICATES)
    with own_settings():
        write_text(HERE / "dev" / "calibration.svg", draw_svg(distance_figure(found), "calibration"))
    page = HERE / "dev" / "calibration.md"
    text = page.read_text(encoding="utf-8")
    head = text[: text.index(RESULTS)]
    picture = "![Distance of the rank distributions from the uniform one](calibration.svg)"
    write_text(page, f"{head}{RESULTS}\n\n{picture}\n\n{table(found)}")
    sys.exit(any(ranks.outside() for ranks in found.values()))


def run(name: str, method: str, reporter: ConsoleReporter) -> Calibration:
    """Calibrate one case; results are kept in a campaign folder of its own."""
    sensor, estimation, priors = LIKELIHOODS[name]
    several = "varying" in estimation
    folder = FOLDER / name.replace(" ", "-")
    folder.mkdir(parents=True, exist_ok=True)
    if several:
        write_trials(folder)
    trials = THREE if several else SIMULATED
    text = BASE.format(name=name, sensor=sensor, trials=trials, estimation=estimation, priors=priors)
    write_text(folder / "campaign.toml", text)
    campaign = load_campaign(folder)
    return calibrate(campaign, get_trials(campaign, reporter), REPLICATES, method, reporter)


def write_trials(folder: Path) -> None:
    """Three logs, doublets of 200 rpm with different periods; only their inputs and times are used."""
    time = np.arange(0.0, 30.0, 0.1)
    for label, period in (("1", 6.0), ("2", 10.0), ("3", 14.0)):
        n = 1194.0 + 200.0 * np.where(time % period < period / 2, 1.0, -1.0)
        rows = [f"{t:.1f},{1.29 * x / 1000:.2f},{x:.0f}" for t, x in zip(time, n, strict=True)]
        write_text(folder / f"trial_{label}.csv", "\n".join(["t,u,n", *rows]) + "\n")


def table(found: dict[str, Calibration]) -> str:
    """Coverage of 50 % and 90 % intervals over all quantities, the least p-value, and the verdict."""
    rows = [
        "| case | quantities | 50 % intervals hold | 90 % intervals hold | least p, all quantities together | ranks inside the bands |"
    ]
    rows.append("|---|---|---|---|---|---|")
    for name, ranks in found.items():
        half, most = (ranks.coverage(share) for share in (0.5, 0.9))
        outside = ", ".join(ranks.outside())
        rows.append(
            f"| {name} | {len(ranks.names)} | {half.min():.1%} to {half.max():.1%} | {most.min():.1%} to {most.max():.1%} "
            f"| {ranks.p_values().min():.3f} | {'all' if not outside else f'all but {outside}'} |"
        )
    return "\n".join(rows) + "\n"


def distance_figure(found: Mapping[str, Calibration], columns: int = 4) -> Figure:
    """Draw, for each of several calibrations, the distance of every quantity's distribution from the uniform one.

    Args:
        found: calibrations by title.
        columns: panels side by side.
    """
    rows = -(-len(found) // columns)
    box_width = (WIDTH - 48) / columns - 16
    height = rows * (ROW + 34) + BOTTOM
    figure = Figure(figsize=(WIDTH * POINT, height * POINT), dpi=72)
    for i, (title, one) in enumerate(found.items()):
        x, y = 44 + (i % columns) * (box_width + 16), height - (i // columns + 1) * (ROW + 34) + 10
        axes = style_axes(figure.add_axes((x / WIDTH, y / height, box_width / WIDTH, ROW / height)))
        at, band = np.arange(1, DRAWS + 1), one.distance_band()
        axes.fill_between(at, -band, band, color=BLUE, alpha=BAND, linewidth=0)
        outside = one.outside()
        for name, line in zip(one.names, one.distance(), strict=True):
            axes.plot(at, line, color=ORANGE if name in outside else BLUE, linewidth=0.9)
        axes.set_xlim(0, DRAWS + 1)
        axes.set_ylim(-0.15, 0.15)
        axes.tick_params(labelbottom=i + columns >= len(found), labelleft=i % columns == 0)
        axes.set_title(title.replace(", ", "\n"), fontsize=SMALL, color=INK, pad=3, loc="left")
    figure.text(0.5, 10 / height, "rank of the truth among 99 draws", fontsize=SMALL + 1, color=INK, ha="center")
    return figure


if __name__ == "__main__":
    main()
