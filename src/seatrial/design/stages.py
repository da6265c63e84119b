"""The stages in which the coefficients of a whole vehicle are sought: which axes together, and which before which.

An axis needs another if one of its regressors has the velocity of the other: Y_uv needs the speed u. Axes that need each other in a circle,
such as sway and yaw by Y_ur and N_uv, are sought together (the strongly connected components of the graph of needs); of stages that need
nothing more, the one with the fewest unknowns comes first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import SPEEDS

AXIS_ORDER = "XNYZMK"
"""Axes in the order of how easily they are excited, where nothing else decides."""
PROPELLER_AXES = {"T": "X", "Q": "K"}
"""Axis on which the thrust and the torque of a propeller act."""


@dataclass(frozen=True)
class Stage:
    """Coefficients that are sought together.

    Attributes:
        axes: on which they act.
        sought: their names, in the order of the vehicle.
        moves: velocities along these axes.
        given: other velocities that their regressors need.
        before: numbers, from 0, of the earlier stages that it needs.
    """

    axes: str
    sought: tuple[str, ...]
    moves: tuple[str, ...]
    given: tuple[str, ...]
    before: tuple[int, ...] = ()


def find_stages(names: Sequence[str], asked: Sequence[str]) -> tuple[Stage, ...]:
    """Return the stages of some coefficients, in the order in which they are run.

    Args:
        names: every coefficient that is sought.
        asked: those that have a goal. Axes without one are sought only with axes that need them.
    """
    terms: dict[str, list[CoefficientName]] = {axis: [] for axis in AXIS_ORDER}
    for term in map(CoefficientName.parse, names):
        terms[PROPELLER_AXES.get(term.axis, term.axis)].append(term)
    used = [axis for axis in AXIS_ORDER if terms[axis]]
    needs = {
        axis: {other for other in used if any(SPEEDS[other] in term.signals for term in terms[axis])} for axis in used
    }
    for through in used:
        for axis in used:
            if through in needs[axis]:
                needs[axis] |= needs[through]
    wanted = [axis for axis in used if any(term.text in asked for term in terms[axis])]
    stages: list[Stage] = []
    while missing := [axis for axis in wanted if not any(axis in stage.axes for stage in stages)]:
        done = {axis for stage in stages for axis in stage.axes}
        groups = [_group(axis, needs, wanted) - done for axis in missing]
        ready = [group for group in groups if not any(needs[axis] & set(wanted) - done - group for axis in group)]
        axes = min(ready, key=lambda group: sum(len(terms[axis]) for axis in group))
        stages.append(_stage([axis for axis in AXIS_ORDER if axis in axes], terms, names, needs, stages))
    return tuple(stages)


def _group(axis: str, needs: dict[str, set[str]], wanted: Sequence[str]) -> set[str]:
    """Return an axis with those that it needs and that need it, and those it needs that nobody asked about."""
    return {axis} | {other for other in needs[axis] if axis in needs[other] or other not in wanted}


def _stage(
    axes: Sequence[str],
    terms: dict[str, list[CoefficientName]],
    names: Sequence[str],
    needs: dict[str, set[str]],
    earlier: Sequence[Stage],
) -> Stage:
    own = {term.text for axis in axes for term in terms[axis]}
    moves = tuple(speed for axis, speed in SPEEDS.items() if axis in axes)
    signals = {signal for axis in axes for term in terms[axis] for signal in term.signals}
    given = tuple(speed for speed in SPEEDS.values() if speed in signals and speed not in moves)
    needed = {other for axis in axes for other in needs[axis]}
    before = tuple(number for number, stage in enumerate(earlier) if needed & set(stage.axes))
    return Stage("".join(axes), tuple(name for name in names if name in own), moves, given, before)
