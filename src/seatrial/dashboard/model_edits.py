"""Edits of a campaign file by the form of the model: the noise of the residuals, the terms, and the priors that both need."""

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import NamedTuple

from seatrial.cli.campaign_text import CAMPAIGN
from seatrial.cli.toml_edit import comment_out, set_key
from seatrial.core.errors import InputError


class Range(NamedTuple):
    """A new prior: the name of its parameter, its ends and their unit as they were typed, and its distribution."""

    name: str
    lower: str
    upper: str
    unit: str
    distribution: str = "uniform"


def with_noise(folder: Path, text: str, residuals: Mapping[str, str]) -> str:
    """Text of a campaign file with other kinds of noise.

    Args:
        folder: of the campaign.
        text: of the file.
        residuals: kind by the sensor that states one, that of all others under the empty name; empty for one that states none.

    Raises:
        InputError: a key that cannot be edited.
    """
    for sensor, kind in residuals.items():
        table = f"sensors.{sensor}" if sensor else "estimation"
        text = set_key(text, table, "residuals", kind or None, str(folder / CAMPAIGN))
    return text


def with_sizes(folder: Path, text: str, sizes: Mapping[str, str]) -> str:
    """Text of a campaign file with other sizes of the chains, as they were typed, by key of `[estimation]`.

    Raises:
        InputError: no whole number, or a key that cannot be edited.
    """
    for key, typed in sizes.items():
        if not (typed.isascii() and typed.isdigit()):
            raise InputError(
                f"key estimation.{key}",
                found=f'"{typed}"',
                expected="a whole number",
                remedy="a multiple of 100, such as 1000",
            )
        text = set_key(text, "estimation", key, int(typed), str(folder / CAMPAIGN))
    return text


def with_terms(folder: Path, text: str, always: Sequence[str], optional: Sequence[str]) -> str:
    """Text of a campaign file with other terms that are always there, and others that may be; errors as `with_noise`."""
    for key, terms in (("always", always), ("optional", optional)):
        text = set_key(text, "structure", key, list(terms), str(folder / CAMPAIGN))
    return text


def with_priors(folder: Path, text: str, new: Iterable[Range], idle: Iterable[str]) -> str:
    """Text of a campaign file with further priors; those that nothing uses any more become comments.

    Args:
        folder: of the campaign.
        text: of the file.
        new: priors that it lacks.
        idle: names of those that nothing uses.

    Raises:
        InputError: an end that is no number, or a key that cannot be edited.
    """
    for name in idle:
        text = comment_out(text, f"prior.{name}")
    for one in new:
        table, where = f"prior.{one.name}", str(folder / CAMPAIGN)
        text = set_key(text, table, "distribution", one.distribution, where)
        for key in ("lower", "upper"):
            text = set_key(text, table, key, number(getattr(one, key), f"{table}.{key}"), where)
        text = set_key(text, table, "unit", one.unit.strip() or None, where)
    return text


def number(text: str, place: str) -> float:
    """Read a number as it was typed.

    Raises:
        InputError: none.
    """
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        found = f'"{text}"' if text.strip() else "nothing"
        raise InputError(
            place, found=found, expected="a number, such as -1.5", remedy="the unit has a field of its own"
        )
    return value
