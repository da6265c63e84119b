"""What a fitted structure leaves out, in words: the effect, which coefficient hides it, and how to add it."""

from seatrial.campaign.store.estimates import LeftOut
from seatrial.estimation.omitted_effects import Effect, Omitted, OmittedEffects
from seatrial.estimation.posterior import Posterior
from seatrial.selection.structures import Structure

MATTERS, SURE = 1.0, 3.0
"""Shift of a coefficient, in standard deviations, and log odds from which a missing effect is told: 20 to 1, strong evidence (Kass and
Raftery, Journal of the American Statistical Association 90, 1995)."""


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


def _words(posterior: Posterior, found: Omitted) -> tuple[str, str]:
    """Name and size of an effect with what looks alike, and how to add it."""
    words = f"{_name(found.effect)} of about {found.size:.2g} ± {found.sd:.1g} {found.effect.unit}".rstrip()
    if found.alike:
        words += f" (or {' or '.join(map(_name, found.alike))}: the data cannot separate them)"
    of = found.effect.of
    match found.effect.kind:
        case "force":
            others = of in {one.text for one in posterior.likelihood.model.coefficients}
            return words, "other structures have it" if others else f"add {of} to structure.optional, with a prior"
        case "command lag":
            return words, f"state it in [vehicle.actuators.{of}], or give `delay` a prior, [prior.delay]"
        case "delay":
            return words, "give `delay` a prior, [prior.delay]"
        case "command lead":
            line = f'if {of} was measured and this is half its sampling time, write between = "line" for its channel in [import]'
            return words, f"{line}; else correct `shift` of its file"
        case "command offset":
            return words, f"check the zero of {of}; `offset` of its channel in [import] corrects it"
        case "sensor offset":
            return words, f'set sensors.{of}.bias = "own" or estimation.current = "own", with a prior'
        case "start":
            return words, 'set estimation.initial = "estimated"'


def _name(effect: Effect) -> str:
    return {
        "force": f"a force {effect.of}",
        "command lag": f"a lag of the actuator of {effect.of}",
        "delay": "a delay of the actuators",
        "command offset": f"an offset of the command {effect.of}",
        "command lead": f"a command {effect.of} that acts before its stamps, by a lead",
        "sensor offset": f"an offset of {effect.of}, a bias of the sensor or a current,",
        "start": f"a start of {effect.of} that differs from the assumed one, by an error",
    }[effect.kind]
