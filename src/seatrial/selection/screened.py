"""Outcome of a screening as a result, without JAX."""

from dataclasses import dataclass

from seatrial.core.dataset import Dataset


@dataclass(frozen=True, eq=False)
class Screened:
    """Outcome of a screening, as it is stored.

    Attributes:
        data: `inclusion`, `inclusion_by_unit_information`, `mean`, `within`, `between`, `bias`, `fit` and `fit_sd` by `term`, the
            optional ones first; `member`, `probability` and `log_evidence` by `model`; `inclusion_at`, `mean_at` and
            `log_bayes_factor` along `scale`, the factor on prior standard deviations.
    """

    data: Dataset

    @property
    def optional(self) -> list[str]:
        """Terms whose presence the data decide."""
        return [
            str(term)
            for term, kept in zip(self.data["term"].values, self.data["always"].values, strict=True)
            if not kept
        ]

    def terms(self, rank: int) -> tuple[str, ...]:
        """Terms of one of the best structures."""
        member = self.data["member"].values[rank]
        return tuple(str(term) for term, there in zip(self.data["term"].values, member, strict=True) if there)

    @property
    def cautions(self) -> list[str]:
        """What keeps the screening from being relied on."""
        return [text for text in (self.data.attrs[key] for key in ("rows", "noise", "sampling", "left_out")) if text]
