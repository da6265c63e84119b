"""Information on each parameter, and on several together, in words; without JAX."""

from seatrial.core.display_units import Shown, listed, measured, percent
from seatrial.core.findings import Message
from seatrial.core.result_table import aligned
from seatrial.estimation.diagnostics.known import Direction, Known, KnownParameter
from seatrial.messages.render import sentence

VAIN = 10.0  # Standard deviation divided by the value above which no percentage is shown
BY_ITSELF = "each parameter is known separately"


def known_lines(known: Known, shown: Shown) -> list[str]:
    """Return a table, its values in the units in which they are `shown`, the combinations known best and least, and the verdict."""
    before = known.stage == "before"
    rows = [
        (
            item.name,
            *([measured(factor * item.value, factor * item.sd, unit)] if before else []),
            known_to(item),
            percent(item.left),
            f"{item.correlation:+.3f} with {item.partner}" if item.partner else "-",
        )
        for item in known.parameters
        for factor, unit in [shown(item.name, item.unit)]
    ]
    heads = ("", *(["expected"] if before else []), "known to", "posterior sd / prior sd", "strongest correlation")
    lines = aligned((heads, *rows), left=(0, -1))
    if len(known.directions) > 1:
        best, least = (", ".join(f"{name} {size}" for name, size in parts_of(known.directions[at])) for at in (0, -1))
        lines.append(f"best-determined direction (1 sd): {best}")
        lines.append(f"least-determined direction (1 sd): {least}")
    # The verdict is about what the data separate: its numbers are those of the noise.
    alone = "by noise only: " if known.verdict and not before else ""
    lines += [*(alone + line for line in verdict_of(known)), *map(sentence, known.speed_pairs), *known.symmetry]
    return [f"  {line}" for line in lines]


def verdict_of(known: Known) -> tuple[str, ...]:
    """Return the verdict; if there is none, that each parameter is known, and which have a ± above half of their value."""
    if known.verdict:
        return known.verdict
    if known.stage == "before" or not known.unsure:
        return (BY_ITSELF,)
    return (f"{BY_ITSELF}, but the ± of {listed(known.unsure)} exceeds half of the value",)


def known_cautions(known: Known) -> list[Message]:
    """Return the parameters that are hardly or not known separately; empty if each is known."""
    return [*(verdict_of(known) if known.verdict or known.unsure else ()), *known.speed_pairs]


def known_to(item: KnownParameter) -> str:
    """Return the relative standard deviation in words."""
    return "not at all" if item.relative >= VAIN else percent(item.relative)


def parts_of(direction: Direction) -> tuple[tuple[str, str], ...]:
    """Return each parameter of a direction with its change in words: `X_u`, `+25 %`."""
    return tuple(
        (name, f"{100 * move:{'+.0f' if abs(move) >= 0.1 else '+.2g'}} %" if share else f"{move:+.2g} prior sd")
        for (name, move), share in zip(direction.moves, direction.relative, strict=True)
    )
