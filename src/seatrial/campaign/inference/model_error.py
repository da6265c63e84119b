"""Findings about what a fitted structure leaves out: the effect, the coefficient that hides it or is uncertain by it, and how to add it."""

from collections.abc import Iterable, Mapping, Sequence

from seatrial.core.findings import Finding
from seatrial.estimation.diagnostics.error_budget import MIN_LOG_ODDS, MIN_SHIFT, ErrorBudget
from seatrial.estimation.diagnostics.error_sources import Effect
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.messages.effects import SLOW_RESIDUALS, effect_name, effect_names
from seatrial.selection.structures import Structure

# What can be done about each kind of effect.
REMEDIES = {
    "force": ("add-force",),
    "command lag": ("actuator-lag", "delay-of-actuators"),
    "delay": ("delay-of-actuators",),
    "clock": ("measured-command",),
    "run force": ("compare-runs",),
    "smooth force": ("wider-structure",),
    "thrust loss": ("thrust-loss",),
    "command offset": ("correct-zero",),
    "sensor offset": ("sensor-bias",),
    "start": ("estimated-start",),
}


def left_out(posterior: Posterior, structure: Structure, budget: ErrorBudget) -> tuple[Finding, ...]:
    """Return the effects that the data ask for and that move a coefficient by more than its standard deviation, the most harmful first.

    Args:
        posterior: of the structure.
        structure: which terms.
        budget: of its errors.
    """
    at = [i for i, name in enumerate(budget.names) if name in structure.terms]
    missing = []
    for one in budget.omitted:
        worst = max(at, key=lambda i: abs(one.shift[i]))
        if abs(one.shift[worst]) > MIN_SHIFT and one.log_odds > MIN_LOG_ODDS:
            values = {
                "effects": _plain([one.effect]),
                "alike": _plain(one.alike),
                "size": float(one.size),
                "sd": float(one.sd),
                "unit": one.effect.unit,
                "shift": float(one.shift[worst]),
            }
            remedies = remedies_of(posterior, [one.effect])
            missing.append(Finding("effect-missing", "caution", (budget.names[worst],), values, remedies))
    return tuple(sorted(missing, key=lambda finding: -abs(float(finding.values["shift"]))))  # pyright: ignore[reportArgumentType]


def tried_effects(budget: ErrorBudget) -> tuple[str, ...]:
    """Return all effects that were looked for, in words."""
    return tuple(effect_name(one.kind, one.of).rstrip(",") for one in budget.tried)


def causes_of(budget: ErrorBudget, wider: Mapping[str, float]) -> dict[str, str]:
    """Return in words what makes most of the ± with model error of each of these parameters, and whether it is only that of the prior."""
    only = "; as far as its prior reaches: nothing narrows it"
    causes = {name: effect_names(_plain(budget.cause(name))) or SLOW_RESIDUALS for name in wider}
    return {name: causes[name] + only * budget.is_prior(name, sd) for name, sd in wider.items()}


def findings_of(posterior: Posterior, budget: ErrorBudget, names: Iterable[str]) -> list[Finding]:
    """Return each cause of a ± with model error: of which of these parameters, and how to get rid of it."""
    groups: dict[tuple, list[str]] = {}
    for name in names:
        effects = budget.cause(name)
        remedies = (
            remedies_of(posterior, effects) if effects else ("better-noise",) if budget.slow else ("compare-blocks",)
        )
        groups.setdefault((_plain(effects), remedies), []).append(name)
    return [
        Finding("model-error-wide", "note", tuple(names), {"effects": effects}, remedies)
        for (effects, remedies), names in groups.items()
    ]


def remedies_of(posterior: Posterior, effects: Sequence[Effect]) -> tuple[str, ...]:
    """Return what can be done about some effects, each thing once; a body has actuators, whose lag can be stated."""
    ways = ["see-selection"] if any(_is_elsewhere(posterior, one) for one in effects) else []
    is_body = not posterior.likelihood.model.per_unit_mass
    for one in effects:
        if not _is_elsewhere(posterior, one):
            ways += [way for way in REMEDIES[one.kind] if is_body or way != "actuator-lag"]
    return tuple(dict.fromkeys(ways))


def _plain(effects: Iterable[Effect]) -> tuple[tuple[str, str], ...]:
    return tuple((one.kind, one.of) for one in effects)


def _is_elsewhere(posterior: Posterior, effect: Effect) -> bool:
    """Whether other structures have this force, so that nothing new is asked for."""
    return effect.kind == "force" and effect.of in {one.text for one in posterior.likelihood.model.coefficients}
