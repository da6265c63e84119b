"""What a fitted structure leaves out, in words: the effect, which coefficient hides it or is uncertain by it, and how to add it."""

from collections.abc import Iterable, Mapping, Sequence

from seatrial.campaign.store.estimates import LeftOut, ModelErrorFinding
from seatrial.estimation.diagnostics.candidate_effects import Effect
from seatrial.estimation.diagnostics.omitted_effects import Omitted, OmittedEffects
from seatrial.estimation.diagnostics.robust_errors import RobustErrors
from seatrial.estimation.posterior.output_error import OutputError
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.prediction.fit_verdict import either
from seatrial.estimation.prediction.remedies import delay_prior, listed
from seatrial.selection.structures import Structure

MATTERS, SURE = 1.0, 3.0
"""Shift of a coefficient, in standard deviations, and log odds from which a missing effect is told: 20 to 1, strong evidence (Kass and
Raftery, Journal of the American Statistical Association 90, 1995)."""
WHITE_ENOUGH = 0.5
"""Share of the samples that residuals are worth above which the noise is not blamed first."""


def left_out(posterior: Posterior, structure: Structure, omitted: OmittedEffects) -> tuple[LeftOut, ...]:
    """Return the effects that the data ask for and that move a coefficient by more than its standard deviation, the most harmful first.

    Args:
        posterior: of the structure.
        structure: which terms.
        omitted: what it leaves out.
    """
    at = [i for i, name in enumerate(posterior.names) if name in structure.terms and i in posterior.places]
    missing = []
    for effect in omitted.found:
        worst = max(at, key=lambda i: abs(effect.shift[i]))
        if abs(effect.shift[worst]) > MATTERS and effect.log_odds > SURE:
            words, remedy = _words(posterior, effect)
            missing.append(LeftOut(words, remedy, posterior.names[worst], float(effect.shift[worst])))
    return tuple(sorted(missing, key=lambda one: -abs(one.by)))


def tried_effects(omitted: OmittedEffects) -> tuple[str, ...]:
    """Return all effects that were looked for, in words."""
    return tuple(_name(one).rstrip(",") for one in omitted.tried)


def causes_of(robust: RobustErrors, wider: Mapping[str, float]) -> dict[str, str]:
    """Return in words what makes most of the ± with model error of each of these parameters, and whether it is only that of the prior."""
    only = "; as far as its prior reaches: nothing narrows it"
    return {name: _cause(robust, name) + only * robust.is_prior(name, sd) for name, sd in wider.items()}


def _cause(robust: RobustErrors, name: str) -> str:
    effects = robust.cause(name)
    return either([_name(one).rstrip(",") for one in effects]) if effects else robust.pieces.differ


def findings_of(posterior: Posterior, robust: RobustErrors, names: Iterable[str]) -> list[ModelErrorFinding]:
    """Return each cause of a ± with model error: of which of these parameters, and how to get rid of it; the noise comes first.

    As long as residuals are correlated, a missing effect is hardly told from them.
    """
    noise, found = _better_noise(posterior, robust), {}
    for name in names:
        words, effects = _cause(robust, name), robust.cause(name)
        remedy = _remedy(posterior, effects) or noise or _of_pieces(robust)
        if effects and noise and not any(_is_elsewhere(posterior, one) for one in effects):
            remedy = f"first {noise}; if it stays, {remedy}"
        found.setdefault((words, remedy), []).append(name)
    findings = [ModelErrorFinding(tuple(names), *of, is_noise=of[1] == noise) for of, names in found.items()]
    return sorted(findings, key=lambda one: not one.is_noise)


def _better_noise(posterior: Posterior, robust: RobustErrors) -> str:
    """Return which model of the noise to choose where the residuals are correlated; empty where they are white, or it is chosen."""
    likelihood = posterior.likelihood
    sensors = likelihood.simulator.sensors if isinstance(likelihood, OutputError) else ()
    kinds = {sensor.noise for sensor in sensors}
    if robust.omitted.worth > WHITE_ENOUGH:
        return ""
    if kinds & {"white", "heavy"}:
        return 'set estimation.residuals = "coloured", or "drifting" if there is white noise too, with priors: the residuals are correlated'
    if "coloured" in kinds:
        return 'set estimation.residuals = "drifting", with priors: there is white noise on slow residuals'
    return ""


def _of_pieces(robust: RobustErrors) -> str:
    """Return what helps where runs, or blocks of time, differ by more than the noise says."""
    if robust.pieces.are_runs:
        return "look for what changed between the runs, or let a coefficient vary by estimation.varying"
    return "look for what changed during the run, or fit more runs"


def _words(posterior: Posterior, found: Omitted) -> tuple[str, str]:
    """Name and size of an effect with what looks alike, and how to add it."""
    words = f"{_name(found.effect)} of about {found.size:.2g} ± {found.sd:.1g} {found.effect.unit}".rstrip()
    if found.alike:
        words += f" (or {' or '.join(_name(one).rstrip(',') for one in found.alike)}: the data cannot separate them)"
    return words, _remedy(posterior, [found.effect])


def _is_elsewhere(posterior: Posterior, effect: Effect) -> bool:
    """Whether other structures have this force, so that nothing new is asked for."""
    return effect.kind == "force" and effect.of in {one.text for one in posterior.likelihood.model.coefficients}


def _remedy(posterior: Posterior, effects: Sequence[Effect]) -> str:
    """Return what can be done about some effects, each thing once."""
    elsewhere = [one.of for one in effects if _is_elsewhere(posterior, one)]
    ways = (
        [f"other structures have {listed(elsewhere)}: `seatrial select` gives their probabilities"] if elsewhere else []
    )
    leads = [one.of for one in effects if one.kind == "command lead"]
    is_body = not posterior.likelihood.model.per_unit_mass
    ways += [way for one in effects if not _is_elsewhere(posterior, one) for way in _ways(one, leads, is_body)]
    return "; or ".join(dict.fromkeys(ways))


def _ways(effect: Effect, leads: Sequence[str], is_body: bool) -> tuple[str, ...]:
    """Return what can be done about an effect; of leads of several commands in one sentence, and of lags where a body has actuators."""
    of, delay = effect.of, f"give `delay` a prior, [prior.delay] with {delay_prior()}"
    match effect.kind:
        case "force":
            return (f"add {of} to structure.optional, with a prior",)
        case "command lag":
            stated = f'if [vehicle] has `moves`, add [vehicle.actuators.{of}] with its lag, for example lag = "0.3 s"'
            return (stated, delay) if is_body else (delay,)
        case "delay":
            return (delay,)
        case "command lead":
            line = f'if {either(leads)} was measured and this is half its sampling time, write between = "line" for its channel in [import]'
            return (f"{line}; else correct `shift` of its file",)
        case "thrust loss":
            terms = "T_un for a propeller, T_f and T_uabsf for thrusters, X_utau_X for a force"
            return (f"add the loss of thrust to structure.optional, with a prior: {terms}",)
        case "command offset":
            return (f"check the zero of {of}; `offset` of its channel in [import] corrects it",)
        case "sensor offset":
            return (f'set sensors.{of}.bias = "own" or estimation.current = "own", with a prior',)
        case "start":
            return ('set estimation.initial = "estimated"',)


def _name(effect: Effect) -> str:
    return {
        "force": f"a force {effect.of}",
        "command lag": f"a lag of the actuator of {effect.of}",
        "delay": "a delay of the actuators",
        "thrust loss": "a thrust that falls with the speed, by a share",
        "command offset": f"an offset of the command {effect.of}",
        "command lead": f"a command {effect.of} that acts before its stamps, by a lead",
        "sensor offset": f"an offset of {effect.of}, a bias of the sensor or a current,",
        "start": f"a start of {effect.of} that differs from the assumed one, by an error",
    }[effect.kind]
