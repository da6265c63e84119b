"""Time stamps of a text, kept exactly: whole numbers of a unit's decimal part, 1669909203.330 as 1669909203330 and 3."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

LARGEST_STAMP = 2.0**62
_FEW = 9
"""Decimals up to which floats are tried: nanoseconds."""
_ROUNDING = 2.0**-52
_CLEAR = 1e-3
"""Rounding of the largest stamp, in units of its last decimal, up to which its digits are beyond doubt."""
_DECIMAL = re.compile(r"\s*([-+]?)(\d*)(?:\.(\d*))?\s*", re.ASCII)


class Stamps(NamedTuple):
    """Stamps times 10^decimals, int64; the text itself, where a number does not fit."""

    values: np.ndarray
    decimals: int


def short_stamps(values: Float[np.ndarray, " n"]) -> Stamps | None:
    """Stamps of so few digits that floats hold them, to a rounding of each; None where only the text can tell."""
    largest = float(np.abs(values).max(initial=0.0))
    for decimals in range(_FEW + 1):
        if largest * 10.0**decimals * _ROUNDING > _CLEAR:
            return None
        scaled = values * 10.0**decimals
        whole = np.rint(scaled)
        if (np.abs(scaled - whole) <= 2.0 * _ROUNDING * np.abs(scaled)).all():
            return Stamps(whole.astype(np.int64), decimals)
    return None


def decimal_stamps(texts: Sequence[str]) -> Stamps:
    """Read decimal numbers without rounding."""
    matches = [_DECIMAL.fullmatch(text) for text in texts]
    decimals = max((len(match[3] or "") for match in matches if match), default=0)
    whole = [int(f"{match[1]}{match[2]}{(match[3] or '').ljust(decimals, '0')}") for match in matches if match]
    if len(whole) < len(texts) or max(map(abs, whole), default=0) >= LARGEST_STAMP:
        return Stamps(np.array(texts, object), 0)
    return Stamps(np.array(whole, np.int64), decimals)


def joined_stamps(parts: Sequence[Stamps]) -> tuple[np.ndarray, int]:
    """Stamps of several pieces on the finest of their decimals."""
    finest = max((part.decimals for part in parts), default=0)
    wide = [part for part in parts if part.values.dtype.kind == "i"]
    largest = max(
        (int(np.abs(part.values).max(initial=0)) * 10 ** (finest - part.decimals) for part in wide), default=0
    )
    if len(wide) == len(parts) and largest < LARGEST_STAMP and finest <= 18:
        scaled = [part.values * 10 ** (finest - part.decimals) for part in parts]
        return np.concatenate(scaled) if scaled else np.empty(0, np.int64), finest
    texts = [text for part in parts for text in _texts(part)]
    return np.array(texts, object), 0


def _texts(part: Stamps) -> list[str]:
    if part.values.dtype.kind == "O":
        return part.values.tolist()
    return [f"{value}e-{part.decimals}" for value in part.values.tolist()]
