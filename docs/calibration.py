"""Calibrate every likelihood with the default sampler, and every sampler with white noise: `python docs/calibration.py`.

About 25 minutes on two cores; an interrupted run resumes. Writes docs/calibration.svg and the table in docs/calibration.md.
"""

import sys
from pathlib import Path

import seatrial  # noqa: F401  (settings of the engine come before JAX)
from seatrial.apps.console import ConsoleWatch
from seatrial.campaign.calibrate import Calibrated, calibrate
from seatrial.campaign.load import load_campaign
from seatrial.campaign.trials import get_trials
from seatrial.core.files import write_text
from seatrial.report.figures.calibration import distance_figure
from seatrial.report.figures.style import own_settings
from seatrial.report.svg import draw_svg

HERE = Path(__file__).parent
FOLDER = HERE.parent / "outputs" / "calibration"
REPLICATES = 400
RESULTS = "<!-- results -->"
"""Where the results begin in the page."""
DEFAULT = "adaptive-metropolis"
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

[truth]
X_u = -1.21
X_uabsu = -2.93
T_nabsn = 6.28e-4

[estimation]
{estimation}

{priors}
"""
TAU = '[prior.tau_u]\ndistribution = "log-uniform"\nlower = 0.2\nupper = 5.0'
PROCESS = '[prior.process_u]\ndistribution = "log-uniform"\nlower = 0.002\nupper = 0.1'
LAG = '[prior.lag_u]\ndistribution = "log-uniform"\nlower = 0.1\nupper = 3.0'
BIAS = '[prior.bias_u]\ndistribution = "normal"\nmean = 0.0\nsd = 0.1'
CURRENT = '[prior.current]\ndistribution = "normal"\nmean = 0.0\nsd = 0.2'
LIKELIHOODS = {
    "white": ("", "", ""),
    "coloured": ("", 'residuals = "coloured"', TAU),
    "heavy tails": ("", 'residuals = "heavy"', ""),
    "lag": ("lag = true", "", LAG),
    "bias": ('bias = "shared"', "", BIAS),
    "current": ("", 'current = "shared"', CURRENT),
    "free start": ("", 'initial = "estimated"', ""),
    "filter error": ("", 'likelihood = "filter-error"', PROCESS),
}
"""Lines under `[sensors.u]` and `[estimation]`, and the priors that these ask for."""
SAMPLERS = ("metropolis", "de-metropolis", "nuts", "tempered-smc")


def main() -> None:
    """Run every case and write what was found."""
    watch = ConsoleWatch(False)
    with watch.watching():
        found = {f"{name}, {DEFAULT}": run(name, DEFAULT, watch) for name in LIKELIHOODS}
        found |= {f"white, {method}": run("white", method, watch) for method in SAMPLERS}
    with own_settings():
        figure = distance_figure({name: one.calibration for name, one in found.items()})
        write_text(HERE / "calibration.svg", draw_svg(figure, "calibration"))
    page = HERE / "calibration.md"
    text = page.read_text(encoding="utf-8")
    head = text[: text.index(RESULTS)]
    picture = "![Distance of the rank distributions from the uniform one](calibration.svg)"
    write_text(page, f"{head}{RESULTS}\n\n{picture}\n\n{table(found)}")
    sys.exit(any(one.calibration.outside() for one in found.values()))


def run(name: str, method: str, watch: ConsoleWatch) -> Calibrated:
    """Calibrate one case; results are kept in a campaign folder of its own."""
    sensor, estimation, priors = LIKELIHOODS[name]
    folder = FOLDER / name.replace(" ", "-")
    folder.mkdir(parents=True, exist_ok=True)
    text = BASE.format(name=name, sensor=sensor, estimation=estimation, priors=priors)
    write_text(folder / "campaign.toml", text)
    campaign = load_campaign(folder)
    return calibrate(campaign, get_trials(campaign, watch), REPLICATES, method, watch)


def table(found: dict[str, Calibrated]) -> str:
    """Coverage of 50 % and 90 % intervals over all quantities, the least p-value, and the verdict."""
    rows = [
        "| case | quantities | 50 % intervals hold | 90 % intervals hold | least p of a histogram | ranks inside the 99 % band |"
    ]
    rows.append("|---|---|---|---|---|---|")
    for name, one in found.items():
        ranks = one.calibration
        half, most = (ranks.coverage(share) for share in (0.5, 0.9))
        outside = ", ".join(ranks.outside())
        rows.append(
            f"| {name} | {len(ranks.names)} | {half.min():.1%} to {half.max():.1%} | {most.min():.1%} to {most.max():.1%} "
            f"| {ranks.p_values().min():.3f} | {'all' if not outside else f'all but {outside}'} |"
        )
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    main()
