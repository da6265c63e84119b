"""Write the pages of the reference that are kept in the repository, for who reads it without building: `python docs/kept_reference.py`."""

from pathlib import Path

from generate.reference import PAGES

KEPT = ("reference/campaign_file", "reference/command_line", "reference/coefficients", "dev/json")
"""Every key of a campaign file, from the schema that reads it; every key of what `--json` prints."""

if __name__ == "__main__":
    for name in KEPT:
        (Path(__file__).parent / f"{name}.md").write_text(PAGES[name](), encoding="utf-8")
