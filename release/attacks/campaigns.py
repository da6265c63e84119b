"""Campaign files, damaged, with the schedules, tables and logs that they name: each is understood or refused."""

from collections.abc import Callable, Mapping
from functools import cache
from math import sin, sqrt
from pathlib import Path
from random import Random
from types import MappingProxyType
from typing import NamedTuple

from attacks.damage import damaged, damaged_table, damaged_toml
from attacks.outcome import Outcome, Watchman, judged

ROOT = Path(__file__).parents[2]
ROWS = 60


class Original(NamedTuple):
    """A campaign that is right: its name, its text, and the files beside it."""

    name: str
    text: str
    beside: Mapping[str, str] = MappingProxyType({})


def damaged_campaign(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Damage a campaign file, or a file that it names, then check it and import what it names."""
    from seatrial.campaign.config.load import load_campaign
    from seatrial.campaign.data.import_logs import get_trials

    name, text, beside = originals()[number % len(originals())]
    place.mkdir(parents=True)
    for file, content in beside.items():
        (place / file).write_text(content, encoding="utf-8")
    if beside and random.random() < 0.4:
        victim = random.choice(sorted(beside))
        data = damaged_table(random, beside[victim]).encode("utf-8", "replace")
        (place / victim).write_bytes(damaged(random, data) if random.random() < 0.2 else data)
        data = text.encode()
    elif random.random() < 0.1:
        victim, data = "campaign.toml", damaged(random, text.encode())
    else:
        victim, data = "campaign.toml", damaged_toml(random, text).encode("utf-8", "replace")
    (place / "campaign.toml").write_bytes(data)

    def work() -> None:
        campaign = load_campaign(place)
        if beside and campaign.imports is not None:
            get_trials(campaign)

    found = judged(work, watchman, place)
    return found._replace(line=f"{name}, {victim}: {found.line}")


@cache
def originals() -> list[Original]:
    """Return campaigns: templates, examples, those of the tests, and those that name files of their own."""
    from tests.campaign.small import SMALL
    from tests.campaign.yaw_campaign import CAMPAIGN

    templates = ROOT / "src" / "seatrial" / "campaign" / "config" / "templates"
    files = [*sorted(templates.glob("*.toml")), *sorted((ROOT / "examples").glob("*/campaign.toml"))]
    found = [Original(str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")) for path in files]
    priors = '[prior.Y_v]\ndistribution = "half-normal"\nupper = 0.0\nscale = 1.0\n' + "".join(
        f'[prior.{name}]\ndistribution = "normal"\nmean = 0.0\nsd = 1.0\n'
        for name in ("Y_ur", "Y_udelta_r", "N_r", "N_udelta_r", "N_uv", "N_rabsr")
    )
    return [*found, Original("small", SMALL), Original("yaw", CAMPAIGN.format(priors=priors)), *_with_files()]


def _with_files() -> list[Original]:
    """Return campaigns of thrusters and mounts, of the attitude, and of schedules, with logs of plain waves."""
    from tests.campaign import test_attitude, test_evaluate_schedule, test_thrusters
    from tests.campaign.small import SMALL

    polynomial = test_thrusters.CAMPAIGN.replace("[sensors.u]", test_thrusters.MOUNTED, 1)
    curve = polynomial.replace("polynomial = [0.0, 0.08]\nneutral = 1500", 'curve = "thrust.csv"')
    curve = curve.replace('{ column = "v",', '{ sum = "0.5 v + 0.5 * v",')
    assert "[mounts.dvl]" in polynomial
    assert curve.count("thrust.csv") == curve.count("sum = ") == 1
    pushed = _table(
        "t,pwm[0],pwm[1],pwm[2],u,v,r,psi", lambda w: [1500 + 200 * x for x in w[:3]] + w[3:6] + [0.1 * w[6]]
    )
    turned = _table(
        "t,tau_K,tau_M,tau_N,p,q,r,q_w,q_x,q_y,q_z",
        lambda w: [*w[:6], sqrt(0.97), 0.1 * w[6] / abs(w[6]), 0.1, 0.1],
    )
    own = SMALL.replace(*test_evaluate_schedule.OWN)
    head, _, rest = SMALL.partition("[truth]")
    sent = head + rest[rest.index("[estimation]") :] + test_evaluate_schedule.IMPORT
    mine = test_evaluate_schedule.MINE
    followed = "time,n,u\n" + "".join(
        f"{0.5 * k:g},{_held(mine, 0.5 * k - 7.0):g},{1.5 + 0.1 * sin(0.4 * k):.4f}\n" for k in range(100)
    )
    return [
        Original("thrusters by a polynomial, and mounts", polynomial, {"log.csv": pushed}),
        Original(
            "thrusters by a table, and sums", curve, {"log.csv": pushed, "thrust.csv": "pwm,N\n1000,-40\n2000,40\n"}
        ),
        Original("attitude", test_attitude.CAMPAIGN, {"log.csv": turned}),
        Original("a schedule of one's own", own, {"mine.csv": mine}),
        Original("a commanded schedule", sent, {"sent_1.csv": mine, "log_1.csv": followed}),
    ]


def _table(header: str, row: Callable[[list[float]], list[float]]) -> str:
    """Return a log every 0.1 s, each row made of waves of other periods."""
    lines = [header]
    for k in range(ROWS):
        cells = row([sin(0.3 * k / (1 + place) + place + 0.5) for place in range(7)])
        lines.append(",".join(f"{cell:.6g}" for cell in (0.1 * k, *cells)))
    return "\n".join(lines) + "\n"


def _held(schedule: str, time: float) -> float:
    """Return the value that a schedule holds at a time, its first before it."""
    rows = [tuple(map(float, line.split(","))) for line in schedule.split()[1:]]
    return next((value for begin, value in reversed(rows) if begin <= time), rows[0][1])
