"""Calibrate error models, samplers and vehicles by simulated records: `python docs/calibration.py`.

About an hour of processor time; an interrupted run resumes. Writes the numbers in docs/dev/calibration.json, and from these
docs/dev/calibration.svg and the table in docs/dev/calibration.md; `--redraw` writes only what is made from the numbers.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import study_numbers
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

sys.path.append(str(Path(__file__).parents[1]))

from benchmarks import closed_loop

HERE = Path(__file__).parent
FOLDER = HERE.parent / "outputs" / "calibration"
REPLICATES, VEHICLES = 400, 200
"""Records of a case, and vehicles in closed loop."""
WIDTH, ROW, BOTTOM = 640.0, 84.0, 40.0
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
DISTURBANCE = """
[prior.disturbance_X]
distribution = "log-uniform"
lower = 0.1
upper = 5.0

[prior.disturbance_time_X]
distribution = "log-uniform"
lower = 0.2
upper = 20.0
"""
SPREAD = '[prior.spread_X_uabsu]\ndistribution = "half-normal"\nlower = 0.0\nscale = 0.5'
SIMULATED = "[truth]\nX_u = -1.21\nX_uabsu = -2.93\nT_nabsn = 6.28e-4"
"""The designed trial; calibration draws truths of its own."""
IMPORTED = """
[[import.files]]
path = "trial_{run}.csv"
time = { column = "t", unit = "s" }
"""
"""Logs, of which only inputs and times are used."""
THREE = f"""
[import]
fit = ["1", "2", "3"]
{IMPORTED}
channels.u = {{ column = "u", unit = "m/s" }}
channels.n = {{ column = "n", unit = "rpm" }}
"""
SURGE = {
    "white": ("", "", ""),
    "coloured": ("", 'residuals = "coloured"', TAU),
    "heavy tails": ("", 'residuals = "heavy"', ""),
    "lag": ("lag = true", "", LAG),
    "bias": ('bias = "shared"', "", BIAS),
    "current": ("", 'current = "shared"', CURRENT),
    "free start": ("", 'initial = "estimated"', ""),
    "filter error": ("", 'likelihood = "filter-error"', PROCESS),
    "three trials that differ": ("", 'varying = ["X_uabsu"]', SPREAD),
    "drifting": ("", 'residuals = "drifting"', ""),
    "force disturbance": ("", 'likelihood = "filter-error"', DISTURBANCE),
}
"""Of the surge trial: lines under `[sensors.u]` and `[estimation]`, and the priors that these ask for."""
MEASURED = """
channels.u = { column = "u", unit = "m/s" }
channels.v = { column = "v", unit = "m/s" }
channels.r = { column = "r", unit = "rad/s" }
"""
SENSORS = """
[sensors]
u = { noise = "0.02 m/s" }
v = { noise = "0.02 m/s" }
r = { noise = "0.004 rad/s" }
"""
THREE_AXES = f"""
[campaign]
name = "three axes"
seed = 11

[vehicle]
catalogue = "remus100_hall_anstee"
moves = ["u", "v", "r"]
published_prior_sd = "20 %"
trim = {{ u = "1.5 m/s" }}

[structure]
always = ["X_uabsu", "T_nabsn", "Y_uv", "Y_uudelta_r", "N_uv", "N_ur", "N_uudelta_r"]

[prior.N_ur]
distribution = "normal"
mean = -6.0
sd = 1.0

[import]
fit = ["1"]
{IMPORTED}{MEASURED}
channels.n = {{ column = "n", unit = "rpm" }}
channels.delta_r = {{ column = "delta_r", unit = "deg" }}
{SENSORS}
"""
THRUSTERS = f"""
[campaign]
name = "thrusters with gains and a lag"
seed = 11

[vehicle]
catalogue = "bluerov2_heavy"
moves = ["u", "v", "r"]
published_prior_sd = "20 %"
trim = {{ u = "0 m/s" }}

[vehicle.thrust_laws.stated]
polynomial = [0.0, 1.0]
lag = "0.2 s"

[structure]
always = ["X_u", "X_uabsu", "Y_vabsv", "N_rabsr"]

[prior]
gain_f_1 = {{ distribution = "normal", mean = 1.0, sd = 0.2 }}
gain_f_2 = {{ distribution = "normal", mean = 1.0, sd = 0.2 }}
gain_f_3 = {{ distribution = "normal", mean = 1.0, sd = 0.2 }}
gain_f_4 = {{ distribution = "normal", mean = 1.0, sd = 0.2 }}
lag_f = {{ distribution = "log-normal", median = 0.2, factor = 1.5 }}

[import]
fit = ["1"]
{IMPORTED}{MEASURED}
channels.f_1 = {{ column = "f_1", unit = "command" }}
channels.f_2 = {{ column = "f_2", unit = "command" }}
channels.f_3 = {{ column = "f_3", unit = "command" }}
channels.f_4 = {{ column = "f_4", unit = "command" }}
{SENSORS}
"""
WHOLE = {"three axes": THREE_AXES, "thrusters with gains and a lag": THRUSTERS}
"""Campaigns of other vehicles."""
LOOPS = {"rov": "BlueROV2, output error", "remus": "REMUS 100, filter error"}
"""Vehicles in closed loop."""
TIME = np.arange(0.0, 30.0, 0.1)


def main() -> None:
    """Run every case that is not done yet, and write numbers, table and picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--redraw", action="store_true", help="only write table and picture again from the numbers")
    if not parser.parse_args().redraw:
        seatrial.configure()
        study_numbers.keep("calibration", results())
    found = study_numbers.kept("calibration")
    with own_settings():
        write_text(HERE / "dev" / "calibration.svg", draw_svg(distance_figure(calibrations(found)), "calibration"))
    study_numbers.show("calibration", tables(found))


def results() -> dict:
    """Return the numbers of each case by its name; those of other vehicles, which are the newest, are made first."""
    reporter = ConsoleReporter(False)
    with reporter.watching():
        found = {name: run(name, DEFAULT, reporter) for name in [*WHOLE, *reversed(SURGE)]}
        ordered = {f"{name}, {DEFAULT}": found[name] for name in [*SURGE, *WHOLE]}
        others = {f"white, {method}": run("white", method, reporter) for method in METHODS if method != DEFAULT}
    every = {**ordered, **others, "equation error, refined": equation_error_ranks(REPLICATES)}
    loops = {name: closed_loop.coverage(name, VEHICLES) for name in LOOPS}
    return {"cases": {name: numbers(ranks) for name, ranks in every.items()}, "closed loop": loops}


def run(name: str, method: str, reporter: ConsoleReporter) -> Calibration:
    """Calibrate one case; results are kept in a campaign folder of its own."""
    folder = FOLDER / name.replace(" ", "-")
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "campaign.toml", campaign_text(name))
    for label, columns in logs(name).items():
        rows = [",".join(f"{x:g}" for x in row) for row in zip(*columns.values(), strict=True)]
        write_text(folder / f"trial_{label}.csv", "\n".join([",".join(columns), *rows]) + "\n")
    campaign = load_campaign(folder)
    return calibrate(campaign, get_trials(campaign, reporter), REPLICATES, method, reporter)


def campaign_text(name: str) -> str:
    """Return the campaign file of a case."""
    if name in WHOLE:
        return WHOLE[name]
    sensor, estimation, priors = SURGE[name]
    trials = THREE if "varying" in estimation else SIMULATED
    return BASE.format(name=name, sensor=sensor, trials=trials, estimation=estimation, priors=priors)


def logs(name: str) -> dict[str, dict[str, np.ndarray]]:
    """Return the columns of each log of a case, by its label: square waves of different periods, and any motion."""
    moving = {"t": TIME, "u": 1.5 + 0.1 * np.sin(TIME), "v": 0.1 * np.sin(TIME), "r": 0.1 * np.sin(TIME)}
    if name == "three axes":
        return {"1": moving | {"n": 1194.0 + 200.0 * square(12.0), "delta_r": 6.0 * square(7.0)}}
    if name == "thrusters with gains and a lag":
        return {"1": moving | {f"f_{i}": 8.0 * square(period) for i, period in enumerate((5.0, 7.0, 9.0, 11.0), 1)}}
    if name == "three trials that differ":
        return {label: three_log(period) for label, period in (("1", 6.0), ("2", 10.0), ("3", 14.0))}
    return {}


def three_log(period: float) -> dict[str, np.ndarray]:
    """Return a log of surge."""
    n = 1194.0 + 200.0 * square(period)
    return {"t": TIME, "u": 1.29e-3 * n, "n": n}


def square(period: float) -> np.ndarray:
    """Return 1 and -1 in turn."""
    return np.where(TIME % period < period / 2, 1.0, -1.0)


def numbers(ranks: Calibration) -> dict:
    """Return what is kept of a case; of each quantity how many replicates have rank 0, 1, ..., 99."""
    counts = [" ".join(map(str, np.bincount(column, minlength=DRAWS + 1))) for column in ranks.ranks.T]
    return {
        "replicates": len(ranks.ranks),
        "refused": round(ranks.refused, 4),
        "poorly mixed": int(ranks.poor().sum()) if len(ranks.health) else 0,
        "coverage of 50 %": dict(zip(ranks.names, ranks.coverage(0.5).tolist(), strict=True)),
        "coverage of 90 %": dict(zip(ranks.names, ranks.coverage(0.9).tolist(), strict=True)),
        "least p": float(ranks.p_values().min()),
        "outside": list(ranks.outside()),
        "ranks": dict(zip(ranks.names, counts, strict=True)),
    }


def calibrations(found: dict) -> dict[str, Calibration]:
    """Return the ranks of each case, in rising order for each quantity."""
    return {
        name: Calibration(
            tuple(one["ranks"]),
            np.array([np.repeat(np.arange(DRAWS + 1), [*map(int, line.split())]) for line in one["ranks"].values()]).T,
        )
        for name, one in found["cases"].items()
    }


def tables(found: dict) -> str:
    """Return picture and table of the page: coverage over all quantities of a case, the least p-value, and the verdict."""
    heads = "| case | quantities | coverage of 50 % intervals | coverage of 90 % intervals | "
    heads += "least p, all quantities together | ranks inside the bands |"
    rows = []
    for name, one in found["cases"].items():
        half, most = (one[f"coverage of {share} %"].values() for share in (50, 90))
        outside = ", ".join(one["outside"])
        rows.append(
            f"| {name} | {len(half)} | {min(half):.1%} to {max(half):.1%} | {min(most):.1%} to {max(most):.1%} "
            f"| {one['least p']:.3f} | {f'all but {outside}' if outside else 'all'} |"
        )
    picture = "![Distance of the rank distributions from the uniform one](calibration.svg)"
    first = f"{picture}\n\n{heads}\n|---|---|---|---|---|---|\n" + "\n".join(rows)
    return f"{first}\n\n## In closed loop\n\n{loop_table(found['closed loop'])}"


def loop_table(found: dict) -> str:
    """Return the table of the vehicles under their autopilots, and the shares that right intervals have in 99 % of cases."""
    text = "| vehicle | trials | coefficient | coverage of 90 % intervals | range if they are right | "
    text += "± divided by value, mean |\n|---|---|---|---|---|---|\n"
    for name, one in found.items():
        low, high = (f"{count / one['vehicles']:.1%}" for count in one["right"])
        for strategy, coefficients in one["inside and sd"].items():
            for coefficient, (count, share) in coefficients.items():
                held = f"{count / one['vehicles']:.1%} of {one['vehicles']} | {low} to {high}"
                text += f"| {LOOPS[name]} | {strategy} | {coefficient} | {held} | {share:.1%} |\n"
    return text


def distance_figure(found: dict[str, Calibration], columns: int = 4) -> Figure:
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
