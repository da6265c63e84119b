"""Write the page of all findings: `python docs/findings.py` makes docs/dev/findings.md again."""

from pathlib import Path

from seatrial.core.files import write_text
from seatrial.messages.explain import page

PAGE = Path(__file__).parent / "dev" / "findings.md"

if __name__ == "__main__":
    write_text(PAGE, page())
