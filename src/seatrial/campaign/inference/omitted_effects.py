"""Findings about what a fitted structure leaves out: the effect, the coefficient that hides it or is uncertain by it, and how to add it."""

from collections.abc import Iterable, Mapping, Sequence

from seatrial.core.findings import Finding
from seatrial.estimation.diagnostics.candidate_effects import Effect
from seatrial.estimation.diagnostics.omitted_effects import MIN_LOG_ODDS, MIN_SHIFT, OmittedEffects
from seatrial.estimation.diagnostics.robust_errors import RobustErrors
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.messages.effects import effect_name, effect_names
from seatrial.messages.predictions import pieces_text
from seatrial.selection.structures import Structure

WHITE_ENOUGH = 0.5  # Share of the samples that residuals are worth above which the noise is not blamed first
# What can be done about each kind of effect.
REMEDIES = {
    "force": ("add-force",),
    "command lag": ("actuator-lag", "delay-of-actuators"),
    "delay": ("delay-of-actuators",),
    "command lead": ("measured-command",),
    "thrust loss": ("thrust-loss",),
    "command offset": ("correct-zero",),
    "sensor offset": ("sensor-bias",),
    "start": ("estimated-start",),
}


def left_out(posterior: Posterior, structure: Structure, omitted: OmittedEffects) -> tuple[Finding, ...]:
    """Return the effects that the data ask for and that move a coefficient by more than its standard deviation, the most harmful first.

    Args:
        posterior: of the structure.
        structure: which terms.
        omitted: what it leaves out.
    """
    at = [i for i, name in enumerate(posterior.names) if name in structure.terms and i in posterior.places]
    missing = []
    for one in omitted.found:
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
            missing.append(Finding("effect-missing", "caution", (posterior.names[worst],), values, remedies))
    return tuple(sorted(missing, key=lambda finding: -abs(float(finding.values["shift"]))))  # pyright: ignore[reportArgumentType]


def tried_effects(omitted: OmittedEffects) -> tuple[str, ...]:
    """Return all effects that were looked for, in words."""
    return tuple(effect_name(one.kind, one.of).rstrip(",") for one in omitted.tried)


def causes_of(robust: RobustErrors, wider: Mapping[str, float]) -> dict[str, str]:
    """Return in words what makes most of the ± with model error of each of these parameters, and whether it is only that of the prior."""
    only = "; as far as its prior reaches: nothing narrows it"
    causes = {name: effect_names(_plain(robust.cause(name))) or pieces_text(robust.pieces) for name in wider}
    return {name: causes[name] + only * robust.is_prior(name, sd) for name, sd in wider.items()}


def findings_of(posterior: Posterior, robust: RobustErrors, names: Iterable[str]) -> list[Finding]:
    """Return each cause of a ± with model error: of which of these parameters, and how to get rid of it; the noise comes first.

    As long as residuals are correlated, a missing effect is hardly told from them.
    """
    noise, groups = _better_noise(posterior, robust), {}
    for name in names:
        effects = robust.cause(name)
        remedies = (
            remedies_of(posterior, effects)
            or noise
            or ("compare-runs" if robust.pieces.are_runs else "compare-blocks",)
        )
        is_first = bool(effects and noise) and not any(_is_elsewhere(posterior, one) for one in effects)
        key = (_plain(effects), (*noise, *remedies) if is_first else remedies, is_first)
        groups.setdefault(key, []).append(name)
    findings = [
        Finding(
            "model-error-wide",
            "note",
            tuple(names),
            {"effects": effects, "differ": pieces_text(robust.pieces), "first": is_first},
            remedies,
        )
        for (effects, remedies, is_first), names in groups.items()
    ]
    return sorted(findings, key=lambda one: one.remedies != noise)


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


def _better_noise(posterior: Posterior, robust: RobustErrors) -> tuple[str, ...]:
    """Return which model of the noise to choose where the residuals are correlated; none where they are white, or it is chosen."""
    likelihood = posterior.likelihood
    sensors = likelihood.simulator.sensors if isinstance(likelihood, OutputError) else ()
    kinds = {sensor.noise for sensor in sensors}
    if robust.omitted.worth > WHITE_ENOUGH:
        return ()
    return ("better-noise",) if kinds & {"white", "heavy"} else ("drifting-too",) if "coloured" in kinds else ()


def _is_elsewhere(posterior: Posterior, effect: Effect) -> bool:
    """Whether other structures have this force, so that nothing new is asked for."""
    return effect.kind == "force" and effect.of in {one.text for one in posterior.likelihood.model.coefficients}
