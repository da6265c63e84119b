"""What a fitted structure leaves out, in words: the effect, which coefficient hides it, and how to add it."""

from seatrial.campaign.store.estimates import LeftOut
from seatrial.estimation.omitted_effects import Omitted, OmittedEffects
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
    """Name and size of an effect, and how to add it."""
    effect, of = found.effect, found.effect.of
    size = f"{found.size:.2g} ± {found.sd:.1g} {effect.unit}".rstrip()
    match effect.kind:
        case "force":
            others = of in {one.text for one in posterior.likelihood.model.coefficients}
            remedy = "other structures have it" if others else f"add {of} to structure.optional, with a prior"
            return f"a force {of} of about {size}", remedy
        case "command lag":
            words = f"a lag of the actuator of {of} of about {size}"
            return words, f"state it in [vehicle.actuators.{of}], or give `delay` a prior, [prior.delay]"
        case "delay":
            return f"a delay of the actuators of about {size}", "give `delay` a prior, [prior.delay]"
        case "command offset":
            words = f"an offset of the command {of} of about {size}"
            return words, f"check the zero of {of}; `offset` in [import.map.{of}] corrects it"
        case "sensor offset":
            words = f"an offset of {of}, a bias of the sensor or a current, of about {size}"
            return words, f'set sensors.{of}.bias = "own" or estimation.current = "own", with a prior'
        case "start":
            words = f"a start that differs from what is assumed in {of} by about {size}"
            return words, 'set estimation.initial = "estimated"'
