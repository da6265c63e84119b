"""Write the tables of "Which trial should I run?": `python docs/trial_guide.py FOLDER` designs trials there and keeps what it finds."""

import sys
from pathlib import Path

import numpy as np
import xarray as xr

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.design.searches import sensor_table
from seatrial.campaign.design.sweep import design_first
from seatrial.core.dataset_file import open_dataset
from seatrial.core.files import write_text
from seatrial.messages.designs import sensor_lines

DOCS = Path(__file__).parent
PAGE = DOCS / "dev" / "trial_tables.md"
AXES = {"surge": "n", "yaw": "delta_r", "pitch": "delta_s"}


def main() -> None:
    """Design, and write every table."""
    parts = [
        "# Tables of the guide to trials",
        "",
        "`python docs/trial_guide.py FOLDER` writes this page from the campaigns in `docs/trial_guide/`.",
        "",
    ]
    for axis, control in AXES.items():
        folder = Path(sys.argv[1]) / axis
        folder.mkdir(parents=True, exist_ok=True)
        text = (DOCS / "trial_guide" / f"{axis}.toml").read_text(encoding="utf-8")
        write_text(folder / "campaign.toml", text)
        campaign = load_campaign(folder)
        design_first(campaign)
        found = open_dataset(folder / "results" / "design.nc").to_xarray()
        parts += [f"## {axis.capitalize()}: shapes of {control}", "", *shapes(found), ""]
        if axis == "surge":
            parts += ["## Surge: size of the change from trim", "", *amplitudes(found), ""]
        if axis != "pitch":
            parts += [
                f"## {axis.capitalize()}: sensors",
                "",
                "```text",
                *sensor_lines(sensor_table(campaign)),
                "```",
                "",
            ]
    write_text(PAGE, "\n".join(parts))


def shapes(found: xr.Dataset) -> list[str]:
    """The best of each shape: settings, information, and what is left of the prior's standard deviation."""
    names = [str(name) for name in found["coefficient"].values]
    lines = [f"| shape | change from trim | period | information, nat | {' | '.join(f'`{name}`' for name in names)} |"]
    lines.append("|---" * (4 + len(names)) + "|")
    ranked = sorted(found["family"].values, key=lambda kind: -float(found["worth"].sel(family=kind).max()))
    for kind in ranked:
        one = found.sel(family=kind)
        best = one["worth"].argmax(dim=("amplitude", "period"))
        at = one.isel(best)
        left = (at["final_sd"] / at["sd_before"]).values
        cells = " | ".join(f"{100 * share:.1f} %" for share in left)
        size = _change(float(at["amplitude"]), str(found.attrs["control"]))
        lines.append(f"| {kind} | {size} | {float(at['period']):g} s | {float(at['worth']):.2f} | {cells} |")
    return [
        *lines,
        "",
        "The last columns give the standard deviation after the trial, as a share of that of the prior.",
    ]


def amplitudes(found: xr.Dataset) -> list[str]:
    """The best repeated doublet of each amplitude."""
    one = found.sel(family="repeated-doublet")
    lines = [
        "| change from trim | period | information, nat | sd of `X_u`, kg/s | sd of `X_uabsu`, kg/m |",
        "|---|---|---|---|---|",
    ]
    for amplitude in one["amplitude"].values:
        row = one.sel(amplitude=amplitude)
        if not np.isfinite(row["worth"].values).any():
            continue
        at = row.isel(period=int(row["worth"].argmax("period")))
        sds = [float(at["final_sd"].sel(coefficient=name)) for name in ("X_u", "X_uabsu")]
        lines.append(
            f"| {_change(float(amplitude), 'n')} | {float(at['period']):g} s | {float(at['worth']):.2f} | {sds[0]:.3f} | {sds[1]:.3f} |"
        )
    return lines


def _change(amplitude: float, control: str) -> str:
    return f"{amplitude * 30 / np.pi:.0f} rpm" if control == "n" else f"{np.degrees(amplitude):.0f}°"


if __name__ == "__main__":
    main()
