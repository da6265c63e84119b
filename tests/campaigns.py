"""Text of campaign files from parts: what most tests vary is a prior, a sensor or a column, each one line here."""

from pathlib import Path

MEASURED = '[estimation]\ninitial = "measured"'


def joined(*parts: str) -> str:
    """Return the text of a campaign file from tables, a blank line between two."""
    return "\n" + "\n\n".join(part.strip("\n") for part in parts) + "\n"


def uniform(lower: float, upper: float) -> str:
    """Return the keys of a uniform prior."""
    return f'distribution = "uniform"\nlower = {lower}\nupper = {upper}'


def log_uniform(lower: float, upper: float) -> str:
    """Return the keys of a log-uniform prior."""
    return f'distribution = "log-uniform"\nlower = {lower}\nupper = {upper}'


def normal(mean: float, sd: float) -> str:
    """Return the keys of a normal prior."""
    return f'distribution = "normal"\nmean = {mean}\nsd = {sd}'


def priors(**keys: str) -> str:
    """Return `[prior.NAME]` of each unknown."""
    return "\n\n".join(f"[prior.{name}]\n{text}" for name, text in keys.items())


def sensors(**noise: str) -> str:
    """Return `[sensors.CHANNEL]` with its standard deviation."""
    return "\n\n".join(f'[sensors.{channel}]\nnoise = "{sd}"' for channel, sd in noise.items())


def small_design(control: str, lower: str, upper: str) -> str:
    """Return `[design]` of half a minute and four candidates."""
    return f"""[design]
control = "{control}"
duration = "30 s"
active = "20 s"
sample_time = "0.1 s"
amplitude = {{ from = "{lower}", to = "{upper}", points = 2 }}
period = {{ from = "4 s", to = "8 s", points = 2 }}"""


def import_log(run: str, path: str, **columns: tuple[str, str]) -> str:
    """Return `[import]` of one run from a log whose time is `t` in seconds: a column and its unit for each channel."""
    channels = (
        f'channels.{name} = {{ column = "{column}", unit = "{unit}" }}' for name, (column, unit) in columns.items()
    )
    head = f'[import]\nfit = ["{run}"]\n\n[[import.files]]\npath = "{path}"\ntime = {{ column = "t", unit = "s" }}'
    return "\n".join((head, *channels))


def write_campaign(folder: Path, text: str, *changes: tuple[str, str], count: int = -1) -> Path:
    """Write a campaign file into a folder, made if needed; of each pair the first text, which must be there, becomes the second."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, count)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(text)
    return folder
