"""The catalogue of messages: every code and remedy by name. To add a code, add an entry to the file of its subject."""

from collections.abc import Mapping
from types import MappingProxyType, ModuleType

from seatrial.core.errors import InputError, nearest
from seatrial.messages import chains, effects, filters, fits, posterior, records, selection
from seatrial.messages.entry import Entry, Remedy

SUBJECTS: Mapping[str, ModuleType] = {
    "Records": records,
    "Fits": fits,
    "Posterior": posterior,
    "Selection": selection,
    "Chains": chains,
    "Effects": effects,
    "Filters": filters,
}
"""Files of entries by the heading under which their codes stand."""
ENTRIES: Mapping[str, Entry] = MappingProxyType(
    {code: entry for subject in SUBJECTS.values() for code, entry in subject.ENTRIES.items()}
)
REMEDIES: Mapping[str, Remedy] = MappingProxyType(
    {name: remedy for subject in SUBJECTS.values() for name, remedy in subject.REMEDIES.items()}
)


def entry_of(code: str, where: str = "code") -> Entry:
    """Return the entry of a code.

    Raises:
        InputError: no such code; the remedy names the nearest one.
    """
    if code not in ENTRIES:
        raise InputError(
            where,
            found=f'unknown code "{code}"',
            expected="a code of the catalogue of messages",
            remedy=nearest(code, ENTRIES, "`seatrial explain` lists the codes"),
        )
    return ENTRIES[code]
