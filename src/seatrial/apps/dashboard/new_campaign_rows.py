"""The rows of the form of a new campaign: their fields, and the line of `seatrial init` that each of them says."""

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from seatrial.campaign.config.new_campaign import (
    Bound,
    Control,
    Measured,
    NewCampaign,
    Sought,
    read_control,
    read_goal,
    read_known,
    read_limit,
    read_sensor,
    read_sought,
)
from seatrial.core.signals import ANGLES, CONTROLS, RATES, TRACKS

Row = Mapping[str, str]
"""What stands in the fields of a row, by field."""
SIGNALS = (*RATES, *ANGLES)
TERMS = ("X_u", "X_uabsu", "T_nabsn", "X_udot", "Y_v", "Y_vabsv", "N_r", "N_rabsr", "N_uv", "N_ur", "N_uudelta_r")
"""Names that are offered while one types; any other that has a meaning may be typed too."""


def field_of(where: str) -> tuple[str, str]:
    """Return the option of `seatrial init` that an error names, and the name in its row; both empty where it names none.

    Args:
        where: of an `InputError` of a new campaign, such as `--sensor u`.
    """
    match = re.match(r"--([a-z-]+)(?: (\w+))?$", where)
    return (match[1].replace("-", "_"), match[2] or "") if match else ("", "")


class Kind(NamedTuple):
    """A kind of row.

    Attributes:
        option: of `seatrial init`.
        title: above the rows.
        one: what one of them is called.
        note: what to write.
        fields: label and example of each field by its key, the first for the name.
        offered: names that are offered.
        line: what the fields say as a line of the option.
        read: reads such a line.
        rows: of a campaign to begin from.
        least: rows that there have to be.
    """

    option: str
    title: str
    one: str
    note: str
    fields: dict[str, tuple[str, str]]
    offered: tuple[str, ...]
    line: Callable[[Row], str]
    read: Callable[[str, str], Any]
    rows: Callable[[NewCampaign], list[dict[str, str]]]
    least: int = 0

    @property
    def numbers(self) -> tuple[str, ...]:
        """Keys of the fields that hold a number."""
        return tuple(key for key in self.fields if key not in ("name", "unit"))


def kinds(is_published: bool) -> tuple[Kind, ...]:
    """Return the kinds of rows: of a published vehicle the name of a coefficient is enough, and none is fixed by hand."""
    seek = partial(read_sought, is_published=is_published)
    alone = " Without a range, the prior is the published value ± 30 %." if is_published else ""
    ranges = {
        "name": ("coefficient", "X_uabsu"),
        "lower": ("least", "-4.5"),
        "upper": ("largest", "-1.5"),
        "unit": ("unit, or SI", "kg/m"),
    }
    known = Kind(
        "known",
        "Known coefficients",
        "known coefficient",
        "In SI; added mass such as X_udot is below zero.",
        {"name": ("coefficient", "X_udot"), "value": ("value", "-1.0")},
        TERMS,
        lambda row: f"{row['name']} {row['value']}",
        read_known,
        lambda new: [{"name": name, "value": value} for name, value in new.known],
    )
    return (
        *([] if is_published else [known]),
        Kind(
            "seek",
            "Coefficients to find",
            "coefficient",
            f"The range of plausible values.{alone}",
            ranges,
            TERMS,
            _sought_line,
            seek,
            lambda new: [_sought_row(one) for one in new.sought],
            least=1,
        ),
        Kind(
            "optional",
            "Coefficients that may be there",
            "optional coefficient",
            f"The data decide whether the vehicle needs them.{alone}",
            ranges,
            TERMS,
            _sought_line,
            seek,
            lambda new: [_sought_row(one) for one in new.optional],
        ),
        Kind(
            "control",
            "Controls",
            "control",
            "The trial moves the first one: give its trim, range and rate. The others are held at trim.",
            {
                "name": ("control", "n"),
                "trim": ("trim", "1200"),
                "lower": ("least", "700"),
                "upper": ("largest", "1600"),
                "unit": ("unit", "rpm"),
                "rate": ("rate, per s", "800"),
            },
            CONTROLS,
            _control_line,
            read_control,
            lambda new: [_control_row(one) for one in new.controls],
            least=1,
        ),
        Kind(
            "sensor",
            "Sensors",
            "sensor",
            "The standard deviation of one sample, and the rate. Without a rate there is a sample in each step of 0.1 s.",
            {
                "name": ("signal", "u"),
                "noise": ("noise", "0.05"),
                "unit": ("unit", "m/s"),
                "rate": ("rate [Hz]", "5"),
            },
            SIGNALS,
            lambda row: f"{row['name']} {row['noise']} {row['unit']}" + (f", {row['rate']} Hz" if row["rate"] else ""),
            read_sensor,
            lambda new: [_sensor_row(one) for one in new.sensors],
            least=1,
        ),
        Kind(
            "limit",
            "Limits of the motion",
            "limit",
            "Signals, or the distance and the advance of the vehicle. An empty field is no limit.",
            {
                "name": ("signal", "u"),
                "lower": ("at least", "0.5"),
                "upper": ("at most", ""),
                "unit": ("unit", "m/s"),
            },
            (*SIGNALS, *TRACKS),
            _limit_line,
            read_limit,
            lambda new: [_limit_row(one) for one in new.limits],
        ),
        Kind(
            "goal",
            "Goal",
            "goal",
            "How well a coefficient has to be known: a share in %, or a standard deviation in its unit.",
            {"name": ("coefficient", "X_uabsu"), "amount": ("to within", "3"), "unit": ("unit", "%")},
            TERMS,
            lambda row: f"{row['name']} {row['amount']} {row['unit']}",
            read_goal,
            lambda new: [{"name": name, **_parted("amount", amount)} for name, amount in new.goal],
        ),
    )


def _range(row: Row) -> str:
    there = row["lower"] or row["upper"]
    return f"{row['lower']} to {row['upper']} {row['unit']}".strip() if there else ""


def _parted(key: str, amount: str) -> dict[str, str]:
    number, _, unit = amount.partition(" ")
    return {key: number, "unit": unit}


def _sought_line(row: Row) -> str:
    return f"{row['name']} {_range(row)}".strip()


def _sought_row(one: Sought) -> dict[str, str]:
    return {"name": one.name, "lower": one.lower, "upper": one.upper, "unit": one.unit}


def _control_line(row: Row) -> str:
    pieces = [f"{row['name']} {row['trim']} {row['unit']}".strip(), _range(row)]
    pieces += [f"{row['rate']} {row['unit']}/s"] if row["rate"] else []
    return ", ".join(piece for piece in pieces if piece)


def _control_row(one: Control) -> dict[str, str]:
    ends = {key: getattr(one, key).partition(" ")[0] for key in ("lower", "upper", "rate")}
    return {"name": one.name, **_parted("trim", one.trim), **ends}


def _sensor_row(one: Measured) -> dict[str, str]:
    return {"name": one.name, **_parted("noise", one.noise), "rate": one.rate.removesuffix(" Hz")}


def _limit_line(row: Row) -> str:
    if row["lower"] and row["upper"]:
        return f"{row['name']} {_range(row)}"
    word = "above" if row["lower"] else "below"
    return f"{row['name']} {word} {row['lower'] or row['upper']} {row['unit']}"


def _limit_row(one: Bound) -> dict[str, str]:
    unit = (one.lower or one.upper).partition(" ")[2]
    return {"name": one.name, "unit": unit, **{key: getattr(one, key).partition(" ")[0] for key in ("lower", "upper")}}
