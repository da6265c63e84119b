"""Findings about what makes a coefficient uncertain or wrong beside the noise, and what to do about it."""

from collections.abc import Iterable, Mapping, Sequence

from seatrial.campaign.config.schema import EstimationTable
from seatrial.core.coefficients import base_name, is_coefficient
from seatrial.core.findings import Finding
from seatrial.estimation.diagnostics.error_budget import (
    MIN_CONTRADICTION,
    MIN_LOG_ODDS,
    MIN_SHIFT,
    MIN_SLOW_RATIO,
    ErrorBudget,
)
from seatrial.estimation.diagnostics.error_sources import Effect, StatedErrors
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.messages.effects import SLOW_RESIDUALS, effect_name, effect_names
from seatrial.selection.structures import Structure

# What can be done about each kind of effect.
REMEDIES = {
    "inertia": ("weigh-vehicle",),
    "scale": ("calibrate-sensor",),
    "force": ("add-force",),
    "command lag": ("actuator-lag", "delay-of-actuators"),
    "delay": ("delay-of-actuators",),
    "clock": ("measured-command",),
    "run force": ("compare-runs",),
    "smooth force": ("wider-structure",),
    "backlash": ("measured-actuator",),
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
    at = [i for i, name in enumerate(budget.names) if base_name(name) in structure.terms]
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
            # A command cannot act before it is given: a negative delay is an error of clocks.
            is_early = one.effect.kind in ("delay", "command lag") and one.size < 0
            remedies = REMEDIES["clock"] if is_early else remedies_of(posterior, [one.effect])
            missing.append(Finding("effect-missing", "caution", (budget.names[worst],), values, remedies))
    return tuple(sorted(missing, key=lambda finding: -abs(float(finding.values["shift"]))))  # pyright: ignore[reportArgumentType]


def tried_effects(budget: ErrorBudget) -> tuple[str, ...]:
    """Return all effects that were looked for, in words."""
    return tuple(effect_name(one.kind, one.of).rstrip(",") for one in budget.tried)


def causes_of(budget: ErrorBudget, within: Mapping[str, float]) -> dict[str, str]:
    """Return in words what adds most to each ± that is not mostly noise, or not white noise, and whether it is only that of the prior.

    Args:
        budget: of the errors.
        within: standard deviation of each parameter within the model.
    """
    only = "; the ± is as wide as the prior: nothing else limits it"
    causes = {name: effect_names(_plain(budget.cause(name)[:1])) for name in _uncertain(budget)}
    return {
        name: (cause or SLOW_RESIDUALS) + only * budget.is_prior(name, within[name]) for name, cause in causes.items()
    }


def stated_errors(table: EstimationTable) -> StatedErrors:
    """Return the standard deviations that a campaign states of what no residual shows."""
    stated = (table.inertia_error, table.scale_error, table.clock_error, table.force_error)
    return StatedErrors(*(0.0 if one == "exact" else one for one in stated))


def findings_of(posterior: Posterior, budget: ErrorBudget) -> list[Finding]:
    """Return what adds most to the ± of which parameters, and how to reduce it."""
    groups: dict[tuple, list[str]] = {}
    for name in _uncertain(budget):
        effects = sorted(budget.cause(name), key=lambda one: (one.kind, one.of))
        remedies = remedies_of(posterior, effects) if effects else ("better-noise",)
        groups.setdefault((_plain(effects), remedies), []).append(name)
    return [
        Finding("main-error", "note", tuple(names), {"effects": effects}, remedies)
        for (effects, remedies), names in groups.items()
    ]


def describes_nothing(budget: ErrorBudget) -> list[Finding]:
    """Return the alarm of a model that leaves most of the motion as slow residuals; none of another."""
    return [] if budget.describes else [Finding("model-describes-nothing", "alarm", (), {}, ("check-inputs",))]


def contradictions(budget: ErrorBudget, stated: StatedErrors) -> list[Finding]:
    """Return which stated inputs the data contradict."""
    result = []
    for effect, (size, sd) in budget.stated.items():
        one = float(getattr(stated, effect.kind))
        if abs(size) > MIN_CONTRADICTION:
            values = {"effects": _plain([effect]), "size": size * one, "sd": sd * one, "stated": one}
            result.append(Finding("input-contradicted", "caution", (), values, REMEDIES[effect.kind]))
    return result


def _uncertain(budget: ErrorBudget) -> list[str]:
    """Return the coefficients whose ± is not mostly noise, or much wider by slow noise; none of a model that describes nothing."""
    if not budget.describes:
        return []
    is_slow = (budget.ratio > MIN_SLOW_RATIO) & bool(budget.slow)
    chosen = (budget.shares[0] < 0.5) | is_slow
    return [name for name, is_chosen in zip(budget.names, chosen, strict=True) if is_chosen and is_coefficient(name)]


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
