"""Write the page of all findings: `python docs/findings.py` makes docs/findings.md again."""

from pathlib import Path

from seatrial.core.files import write_text
from seatrial.messages.explain import page

PAGE = Path(__file__).with_suffix(".md")

if __name__ == "__main__":
    write_text(PAGE, page())
