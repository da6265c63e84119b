"""Write reference/campaign_file.md, every key of a campaign file, from the schema that reads it: `python docs/campaign_keys.py`."""

from pathlib import Path

from generate import campaign_file

if __name__ == "__main__":
    (Path(__file__).parent / "reference" / "campaign_file.md").write_text(campaign_file.page(), encoding="utf-8")
