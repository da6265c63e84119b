"""Campaign files, damaged: each is understood or refused."""

from functools import cache
from pathlib import Path
from random import Random

from attacks.damage import damaged, damaged_toml
from attacks.outcome import Outcome, Watchman, judged

ROOT = Path(__file__).parents[2]


def damaged_campaign(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Damage one campaign file and check it."""
    from seatrial.campaign.config.load import load_campaign

    name, text = originals()[number % len(originals())]
    data = (
        damaged(random, text.encode())
        if random.random() < 0.1
        else damaged_toml(random, text).encode("utf-8", "replace")
    )
    place.mkdir(parents=True)
    (place / "campaign.toml").write_bytes(data)
    found = judged(lambda: load_campaign(place), watchman, place)
    return found._replace(line=f"{name}: {found.line}")


@cache
def originals() -> list[tuple[str, str]]:
    """Return campaign files: templates, examples and those of the tests."""
    from tests.campaign.small import SMALL
    from tests.campaign.yaw_campaign import CAMPAIGN

    templates = ROOT / "src" / "seatrial" / "campaign" / "config" / "templates"
    files = [*sorted(templates.glob("*.toml")), *sorted((ROOT / "examples").glob("*/campaign.toml"))]
    texts = [(str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")) for path in files]
    priors = '[prior.Y_v]\ndistribution = "half-normal"\nupper = 0.0\nscale = 1.0\n' + "".join(
        f'[prior.{name}]\ndistribution = "normal"\nmean = 0.0\nsd = 1.0\n'
        for name in ("Y_ur", "Y_udelta_r", "N_r", "N_udelta_r", "N_uv", "N_rabsr")
    )
    return [*texts, ("small", SMALL), ("yaw", CAMPAIGN.format(priors=priors))]
