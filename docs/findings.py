"""Write the page of all findings: `python docs/findings.py` makes docs/dev/findings.md again."""

from pathlib import Path

from seatrial.core.files import write_text
from seatrial.messages.catalogue import SUBJECTS
from seatrial.messages.explain import explanation

PAGE = Path(__file__).parent / "dev" / "findings.md"


def page() -> str:
    """Return the page of all codes."""
    parts = [
        "# Findings\n",
        "Each message about a result has a code. `seatrial explain CODE` prints its entry; `--json` lists codes under `findings`.\n"
        'If you know of a caution or alarm, `[checks] accept = ["CODE"]` in the campaign file shortens it to one line.\n',
    ]
    for subject, file in SUBJECTS.items():
        parts += [f"## {subject}\n", *(explanation(code, heading="###") for code in file.ENTRIES)]
    return "\n".join(parts)


if __name__ == "__main__":
    write_text(PAGE, page())
