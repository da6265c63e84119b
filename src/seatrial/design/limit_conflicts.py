"""Why no design is allowed: what each limit excludes, which two cannot be kept together, and by how much the gentlest misses.

A miss is told in the limit's own unit: were its bound that much wider, one design would keep it beside the others with the
probability and confidence asked for.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from seatrial.core.errors import InputError, SeatrialError
from seatrial.design.safety import CONFIDENCE, Safety

MAX_PAIRS = 3  # Conflicting pairs that are told, most telling first
# How the remedy ends that widens limits
GENTLER_REMEDY = "; or try gentler or shorter designs (design.amplitude, design.duration)"


class Ways(NamedTuple):
    """Which limits may give way so that one design is allowed: a sentence with places for widths, and these, in the limits' own units."""

    template: str
    widths: tuple[float, ...]

    def __str__(self) -> str:
        """Return the sentence."""
        return self.template.format(*(f"{width:.3g}" for width in self.widths))


class NoDesignAllowed(InputError):
    """No design keeps all limits; `ways` say which of them would have to give way."""

    def __init__(self, where: str, *, found: str, expected: str, ways: Ways):
        self.ways = ways
        super().__init__(where, found=found, expected=expected, remedy=f"{ways}{GENTLER_REMEDY}")

    def __reduce__(self) -> tuple[Callable[[], InputError], tuple[()]]:
        """Return how it travels between processes."""
        return partial(type(self), self.where, found=self.found, expected=self.expected, ways=self.ways), ()


def check_some_allowed(safety: Safety) -> None:
    """Check that a design is allowed.

    Raises:
        InputError: none is; how many each limit excludes, which pairs conflict, and by how much the gentlest design misses.
    """
    if safety.allowed.any():
        return
    count, kept = len(safety.allowed), safety.held.sum(1) >= safety.needed
    lost = safety.diverged > safety.draws - safety.needed
    results = [
        f"no design of {count}: each would have to hold in {safety.needed} of {safety.draws} draws",
        *(f"{limit.words} excludes {count - alone}" for limit, alone in zip(safety.limits, kept.sum(0), strict=True)),
    ]
    if safety.diverged.any():
        results.append(f"the motion of {lost.sum()} designs diverges too often, which breaks every limit")
    misses, ways = _misses(safety, kept)
    summary = "; ".join([*results, *misses])
    expected = (
        f"at least one design that keeps all limits with probability {safety.probability:g} (confidence {CONFIDENCE:g})"
    )
    if lost.all():
        remedy = "narrow the priors or choose gentler designs: no limit can be kept if the motion diverges"
        raise InputError("safety limits", found=summary, expected=expected, remedy=remedy)
    raise NoDesignAllowed("safety limits", found=summary, expected=expected, ways=ways)


def remedy_of_any(errors: Iterable[SeatrialError]) -> str:
    """Return one remedy of several errors of which any will do: of those that differ in widths alone the one that widens least."""
    least: dict[str, tuple[float, str]] = {}
    gentler = ""
    for error in errors:
        if isinstance(error, NoDesignAllowed):
            kind, one = error.ways.template, (max(error.ways.widths, default=0.0), str(error.ways))
            gentler = GENTLER_REMEDY
        else:
            kind = error.remedy if isinstance(error, InputError) else "narrow the priors"
            one = 0.0, kind
        least[kind] = min(least.get(kind, one), one, key=lambda way: way[0])
    return "; or ".join(words for _, words in least.values()) + gentler


def conflicting_pairs(safety: Safety) -> list[tuple[int, int]]:
    """Return the pairs of limits of which each alone leaves designs, together none; those that leave most alone first."""
    held = safety.held
    alone = (held.sum(1) >= safety.needed).sum(0)
    pairs = [
        (i, j)
        for i, j in combinations(range(len(safety.limits)), 2)
        if alone[i] and alone[j] and not ((held[..., i] & held[..., j]).sum(1) >= safety.needed).any()
    ]
    return sorted(pairs, key=lambda pair: -min(alone[pair[0]], alone[pair[1]]))


def least_miss(safety: Safety, limit: int, beside: tuple[int, ...] = ()) -> tuple[float, int]:
    """Return how much wider a bound would have to be for one design to keep it, and others beside it, and which design that is.

    Args:
        safety: what was judged.
        limit: index of the limit that gives way.
        beside: indices of the limits that do not.

    Returns:
        The miss, SI, infinite if no width would do, and the index of the design.
    """
    margin = safety.room_left(safety.held[..., list(beside)].all(2))[:, limit]
    return float(-margin.max()), int(margin.argmax())


def _misses(safety: Safety, kept: np.ndarray) -> tuple[list[str], Ways]:
    """Misses and a remedy: of limits that exclude every design; else of pairs; else of each limit beside all others."""
    limits, everyone = safety.limits, range(len(safety.limits))
    hopeless = [i for i in everyone if not kept[:, i].any()]
    if hopeless:
        sentences = [f"{limits[i].words} {_miss(safety, i, ())}" for i in hopeless]
        return sentences, _joined(" and ", [_widen(safety, i, ()) for i in hopeless])
    pairs = conflicting_pairs(safety)[:MAX_PAIRS]
    if pairs:
        sentences = [
            f"{limits[i].words} and {limits[j].words} conflict: separately they leave {kept[:, i].sum()} and {kept[:, j].sum()} "
            f"designs, together none. If the first is kept, the second {_miss(safety, j, (i,))}; if the second is kept, the first "
            f"{_miss(safety, i, (j,))}"
            for i, j in pairs
        ]
        ways = [_joined(" or ", [_widen(safety, j, (i,)), _widen(safety, i, (j,))]) for i, j in pairs]
        return sentences, _joined("; and ", ways)
    best = int(safety.joint_share.argmax())
    others = {i: tuple(j for j in everyone if j != i) for i in everyone}
    sentences = [
        f"every two limits leave designs, but all together none: at best they hold in {safety.held[best].all(1).sum()} draws, "
        f"of {safety.name(best)}",
        *(f"with all others {limits[i].words} {_miss(safety, i, others[i])}" for i in everyone),
    ]
    return sentences, _joined(" or ", [_widen(safety, i, others[i]) for i in everyone])


def _joined(between: str, ways: Sequence[Ways]) -> Ways:
    return Ways(between.join(one.template for one in ways), tuple(width for one in ways for width in one.widths))


def _miss(safety: Safety, limit: int, beside: tuple[int, ...]) -> str:
    width, design = least_miss(safety, limit, beside)
    if not np.isfinite(width):
        return "cannot be kept at any width"
    factor, unit = safety.limits[limit].shown
    return f"is missed by {width * factor:.3g} {unit} by {safety.name(design)}, the gentlest"


def _widen(safety: Safety, limit: int, beside: tuple[int, ...]) -> Ways:
    width, _ = least_miss(safety, limit, beside)
    if not np.isfinite(width):
        return Ways(f"give up {safety.limits[limit].words}", ())
    factor, unit = safety.limits[limit].shown
    return Ways(f"widen {safety.limits[limit].words} by {{}} {unit} or more", (width * factor,))
