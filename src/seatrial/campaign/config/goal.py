"""What a campaign is for: how well each coefficient is to be known, and whether the structure is to be decided."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from seatrial.campaign.config.schema import GoalTable
from seatrial.core.errors import InputError, nearest
from seatrial.core.units import quantity


@dataclass(frozen=True)
class Goal:
    """What ends a campaign.

    Attributes:
        shares: standard deviation wanted of a coefficient, as a share of its value.
        sds: standard deviation wanted, SI.
        decided: whether one structure is to hold 95 % of the probability.
        trials: most trials to run; where nothing else is asked for, the goal is met once these are run.
    """

    shares: Mapping[str, float]
    sds: Mapping[str, float]
    decided: bool
    trials: int

    @property
    def only_trials(self) -> bool:
        """Whether nothing is asked for but a number of trials: all of them are run then."""
        return not (self.shares or self.sds or self.decided)

    def unmet(self, known: Mapping[str, tuple[float, float]]) -> dict[str, float]:
        """Coefficients not yet known well enough, each with its standard deviation over the one wanted.

        Args:
            known: name to mean and standard deviation, SI; a coefficient that is missing here is not in the structure.
        """
        wanted = {name: share * abs(known[name][0]) for name, share in self.shares.items() if name in known}
        wanted |= {name: sd for name, sd in self.sds.items() if name in known}
        return {name: known[name][1] / sd for name, sd in wanted.items() if known[name][1] > sd}


def read_goal(table: GoalTable, units: Mapping[str, str], where: str) -> Goal:
    """Read a goal.

    Args:
        table: as written.
        units: SI unit of each coefficient that may be named.
        where: names the table, for errors.

    Raises:
        InputError: another coefficient, or a standard deviation that is not positive.
    """
    shares, sds = {}, {}
    for name, written in table.sd.items():
        if name not in units:
            raise InputError(
                f"{where}.sd.{name}",
                found=f'"{name}"',
                expected="one of " + ", ".join(units),
                remedy=nearest(name, units),
            )
        relative = isinstance(written, str) and written.rstrip().endswith("%")
        value = _percentage(written) if relative else written
        if isinstance(value, str):
            value = quantity(value, units[name], f"{where}.sd.{name}")
        if not 0 < value < inf:
            raise InputError(
                f"{where}.sd.{name}",
                found=f"{written}",
                expected=f'a positive standard deviation in {units[name]}, or a percentage such as "10 %"',
                remedy="say how well the controller or the simulator needs to know it",
            )
        (shares if relative else sds)[name] = value
    return Goal(shares, sds, table.decided, table.trials)


def _percentage(written: str) -> float:
    try:
        return float(written.rstrip().removesuffix("%")) / 100
    except ValueError:
        return -1.0
