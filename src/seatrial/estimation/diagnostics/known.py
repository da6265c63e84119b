"""What is known of each parameter, and of several together, before or after the data: as it is stored and printed, without JAX."""

from dataclasses import dataclass

from seatrial.core.coefficients import is_coefficient

UNSURE = (
    0.5  # Share of a coefficient that its ± may be for it to be called known: `VAGUE` of `messages/identifiability.py`
)


@dataclass(frozen=True)
class ErrorShares:
    """Shares of the variance of a value: of noise, stated inputs, differences between runs, and effects that the model may lack."""

    noise: float = 1.0
    stated: float = 0.0
    runs: float = 0.0
    model: float = 0.0


@dataclass(frozen=True)
class KnownParameter:
    """One parameter: its value, what is known of it, and what it is confused with.

    Attributes:
        name: parameter.
        unit: SI unit.
        value: prior mean before the data, posterior mode after.
        sd: its standard deviation, expected before the data.
        relative: `sd` over the size of the value.
        left: `sd` over the prior's.
        partner: the parameter it is most strongly correlated with; empty if it is the only one.
        correlation: with that one.
    """

    name: str
    unit: str
    value: float
    sd: float
    relative: float
    left: float
    partner: str
    correlation: float

    @property
    def is_unsure(self) -> bool:
        """Whether little more than the sign of a coefficient is known."""
        return is_coefficient(self.name) and self.sd > UNSURE * abs(self.value)


@dataclass(frozen=True)
class Direction:
    """A change of several parameters at once that the data alone know to one standard error.

    Attributes:
        sd: length of the change, 1 / sqrt(eigenvalue).
        moves: parameters and their changes, the largest first: shares of the value, or of the prior's standard deviation.
        relative: of each, whether it is a share of the value.
    """

    sd: float
    moves: tuple[tuple[str, float], ...]
    relative: tuple[bool, ...]


@dataclass(frozen=True)
class Known:
    """What is known, before or after the data.

    Attributes:
        stage: `before` or `after`.
        structure: label of the structure.
        parameters: one by one.
        directions: together, what is known best first; empty where the model has no derivatives.
        verdict: sentences that name what is known although its parts are not, and what would separate them.
        symmetry: sentences on which sides of the vehicle the data find alike.
    """

    stage: str
    structure: str
    parameters: tuple[KnownParameter, ...]
    directions: tuple[Direction, ...]
    verdict: tuple[str, ...]
    symmetry: tuple[str, ...] = ()

    @property
    def unsure(self) -> list[str]:
        """Coefficients of which little more than the sign is known."""
        return [item.name for item in self.parameters if item.is_unsure]
