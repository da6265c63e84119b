"""Pages of the catalogue: an entry for `seatrial explain CODE`, and the list of all."""

from dataclasses import replace

from seatrial.messages.catalogue import ENTRIES, REMEDIES, SUBJECTS, entry_of
from seatrial.messages.entry import filled_in
from seatrial.messages.render import sentence

_PLACES = {"command": "Command line", "python": "Python", "page": "Dashboard"}


def explanation(code: str, heading: str = "#") -> str:
    """Return the page of one code, as Markdown that also reads well on a terminal.

    Raises:
        InputError: no such code.
    """
    entry = entry_of(code)
    example = entry.example
    limits = next(file.thresholds() for file in SUBJECTS.values() if code in file.ENTRIES)
    lines = [
        f"{heading} {code}",
        "",
        f"**{entry.title}.** {entry.meaning}",
        "",
        f"Decided: {filled_in(entry.decided, example.subject, limits)}",
        "",
        f"Example ({example.level}): {sentence(replace(example, remedies=()))}.",
    ]
    for name in entry.remedies or example.remedies:
        lines.append("")
        places = _PLACES if REMEDIES[name].python or REMEDIES[name].page else {"command": "Everywhere"}
        for form, place in places.items():
            if form == "command" or getattr(REMEDIES[name], form):
                lines.append(f"- {place}: {filled_in(REMEDIES[name].of(form), example.subject, example.values)}.")
    return "\n".join(lines) + "\n"


def listing() -> str:
    """Return every code with its title, one a line."""
    width = max(map(len, ENTRIES))
    return "\n".join(f"{code:<{width}}  {entry.title}" for code, entry in ENTRIES.items())
