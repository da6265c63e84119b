"""Results of profile likelihoods: how far the data alone allow each parameter to go."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import computed_field

from seatrial.core.result_table import text_html
from seatrial.core.serialise import AS_LIST

# Fall of the log-likelihood at the ends of a 95 % interval: half the 95 % point of chi-square with one degree of
# freedom.
DROP = 1.92


@dataclass(frozen=True, eq=False)
class Profile:
    """Profile likelihood of one parameter, SI.

    Attributes:
        name: parameter.
        unit: its SI unit.
        label: printed (LaTeX).
        best: its maximum-likelihood value.
        values: points, ascending, in its unit.
        drop: fall of the profile log-likelihood from its maximum at each of them, >= 0.
        others: parameter values, all of them, at each point, shape (n, d).
        lower: lower end of the 95 % interval; -inf if the interval is open.
        upper: upper end; inf if it is open.
        bounds: ends of the prior, or six of its standard deviations from its mean.
    """

    name: str
    unit: str
    label: str
    best: float
    values: Annotated[Float[np.ndarray, " n"], AS_LIST]
    drop: Annotated[Float[np.ndarray, " n"], AS_LIST]
    others: Annotated[Float[np.ndarray, "n d"], AS_LIST]
    lower: float
    upper: float
    bounds: tuple[float, float]

    def __repr__(self) -> str:
        """Print the interval."""
        return self.line

    _repr_html_ = text_html

    @computed_field
    @property
    def kind(self) -> str:
        """`closed`, `open below`, `open above` or `flat`."""
        below, above = np.isinf(self.lower), np.isinf(self.upper)
        return "flat" if below and above else "open below" if below else "open above" if above else "closed"

    @property
    def line(self) -> str:
        """The interval in words."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.kind == "closed":
            return f"{self.name}: 95 % interval {self.lower:.4g} to {self.upper:.4g}{unit} by profile likelihood"
        low, high = self.bounds
        if self.kind == "flat":
            return (
                f"{self.name}: the profile likelihood is flat and excludes no value from {low:.4g} to {high:.4g}{unit}; fix it, or run a "
                f"trial that excites it"
            )
        end, inside = (
            (f"below {self.upper:.4g}", low) if self.kind == "open below" else (f"above {self.lower:.4g}", high)
        )
        return (
            f"{self.name} is known on one side only, {end}{unit}: the profile likelihood does not fall by {DROP} as far as "
            f"{inside:.4g}, the end of its prior"
        )


@dataclass(frozen=True, eq=False)
class Profiles:
    """Profile likelihoods of parameters of one structure.

    Attributes:
        structure: its label.
        terms: of the structure.
        profiles: one for each parameter.
    """

    structure: str
    terms: tuple[str, ...]
    profiles: tuple[Profile, ...]

    def lines(self) -> list[str]:
        """Name the structure, and say each interval in words."""
        return [
            f"structure {self.structure}, with every term: {' '.join(self.terms)}",
            *(one.line for one in self.profiles),
        ]

    @property
    def open(self) -> list[str]:
        """Parameters that the data do not bound to both sides."""
        return [profile.name for profile in self.profiles if profile.kind != "closed"]
