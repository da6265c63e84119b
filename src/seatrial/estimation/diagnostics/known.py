"""What is known of each parameter, and of several together, before or after the data: as it is stored and printed, without JAX."""

from dataclasses import dataclass

from seatrial.core.coefficients import CoefficientName, Factor, is_coefficient
from seatrial.core.findings import Finding

UNSURE = (
    0.5  # Share of a coefficient that its ± may be for it to be called known: `VAGUE` of `messages/identifiability.py`
)
SPEED = Factor("u")


@dataclass(frozen=True)
class ErrorShares:
    """Shares of the variance of a value: of noise, stated inputs, differences between runs, effects that the model may lack, and
    differences between models in an average over them."""

    noise: float = 1.0
    stated: float = 0.0
    runs: float = 0.0
    model: float = 0.0
    terms: float = 0.0


@dataclass(frozen=True)
class KnownParameter:
    """One parameter: its value, how well it is known, and its strongest correlation.

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
    """A joint change of several parameters that equals one standard error of the data, without priors.

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
    """State of knowledge, before or after the data.

    Attributes:
        stage: `before` or `after`.
        structure: label of the structure.
        parameters: one by one.
        directions: together, the best known first; empty if the model has no derivatives.
        verdict: sentences that name well-known combinations of unknown coefficients, and a trial that would separate them.
        symmetry: sentences that name sides of the vehicle without a difference in the data.
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

    @property
    def speed_pairs(self) -> list[Finding]:
        """Return pairs of coefficients that differ by a factor u alone, as N_v and N_uv, where the one without it is not known."""
        terms = {CoefficientName.parse(one.name): one for one in self.parameters if is_coefficient(one.name)}
        scaled = {(term.axis, frozenset(term.factors) - {SPEED}): term for term in terms if SPEED in term.factors}
        return [
            Finding(
                "speeds-not-separated",
                "caution",
                (one.name, terms[scaled[term.axis, frozenset(term.factors)]].name),
                {"relative": one.relative},
                ("keep-speed-scaled",),
            )
            for term, one in terms.items()
            if self.stage == "after"
            and one.is_unsure
            and term.factors
            and (term.axis, frozenset(term.factors)) in scaled
        ]
