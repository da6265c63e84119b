"""Live streams, damaged: text that grows and is replaced, and MAVLink datagrams; each is followed or refused, and kept byte by byte."""

import json
import socket
from functools import cache
from math import sin
from pathlib import Path
from random import Random
from typing import Any

from attacks.damage import damaged, damaged_table
from attacks.outcome import Outcome, Watchman, judged

STREAMS = ("columns by their names", "columns of [import]", "sums in other axes", "mavlink")
ROWS = 120


def damaged_stream(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Follow one damaged stream to its end, then import what was kept of it."""
    from seatrial.campaign.config.load import load_campaign

    name = STREAMS[number % len(STREAMS)]
    place.mkdir(parents=True)
    (place / "campaign.toml").write_text(_campaigns()[name], encoding="utf-8")
    pieces = _datagrams(random) if name == "mavlink" else _text(name, random)

    def work() -> None:
        campaign = load_campaign(place)
        if name == "mavlink":
            _follow_datagrams(campaign, pieces)
        else:
            _follow_text(campaign, place / "growing.csv", pieces, random)
        _import_kept(place)

    found = judged(work, watchman, place)
    return found._replace(line=f"{name}: {found.line}")


@cache
def _campaigns() -> dict[str, str]:
    """Return the campaign of each stream."""
    from tests.campaign.small import NO_X_U, SMALL
    from tests.campaign.test_live import IMPORT

    text = SMALL
    for old, new in NO_X_U:
        text = text.replace(old, new)
    head, _, rest = text.partition("[truth]")
    plain = head + '[goal]\nsd = { X_uabsu = 0.3, T_nabsn = "5 %" }\n' + rest[rest.index("[estimation]") :]
    plain = plain.replace("chains", 'initial = "measured"\nchains', 1)
    sums = IMPORT.replace('column = "speed"', "sum = \"0.5 speed + 0.5 'speed'\"").replace(
        "[[import.files]]", '[[import.files]]\naxes = "ENU"'
    )
    messages = '[import]\nfit = ["1"]\n' + "".join(
        f'[[import.files]]\npath = "{{run}}.tlog"\ntable = "{table}"\nchannels.{name} = {{ column = "{column}", unit = "{unit}" }}\n'
        for table, name, column, unit in (("RPM", "n", "rpm1", "rpm"), ("VFR_HUD", "u", "groundspeed", "m/s"))
    )
    return dict(zip(STREAMS, (plain, plain + IMPORT, plain + sums, plain + messages), strict=True))


def _text(name: str, random: Random) -> list[bytes]:
    """Return a table of text, damaged, in the pieces in which it comes."""
    by_names = name == STREAMS[0]
    rows = ["time,n,u,remark" if by_names else "stamp,prop,speed,remark"]
    for k in range(ROWS):
        turns, speed = 1000 + 200 * (k % 40 > 20), 1.5 + 0.1 * sin(0.2 * k)
        rows.append(
            f"{0.2 * k:.1f},{turns / 9.55:.3f},{speed:.4f},ok"
            if by_names
            else f"{200 * k},{turns},{0.5 - speed:.4f},ok"
        )
    text = "\n".join(rows) + "\n"
    data = (
        damaged_table(random, text).encode("utf-8", "replace")
        if random.random() < 0.7
        else damaged(random, text.encode())
    )
    cuts = sorted(random.randrange(len(data) + 1) for _ in range(random.choice((0, 1, 3, 10))))
    return [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]


def _follow_text(campaign: Any, path: Path, pieces: list[bytes], random: Random) -> None:
    """Write a file piece by piece, now and then as another one, and follow it."""
    from seatrial.campaign.live.sources import open_source

    path.write_bytes(pieces[0])
    session, came = _session(campaign, str(path), ".received.csv"), b""
    stream = open_source(str(path), session.channels.tables)
    try:
        for k, piece in enumerate(pieces):
            if k and random.random() < 0.03:
                path.unlink()
                piece = random.choice((pieces[0], b"")) + piece
            if k:
                with path.open("ab") as more:
                    more.write(piece)
            while (part := stream.read(0.0)) is not None and part.raw:
                came += part.raw
                _take(session, part)
    finally:
        stream.close()
        _close(session, came)


def _datagrams(random: Random) -> list[bytes]:
    """Return MAVLink datagrams, one in six of them damaged."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    link, found = dialect.MAVLink(None, srcSystem=1, srcComponent=1), []
    for k in range(ROWS):
        speed, turns = 1.5 + 0.1 * sin(0.2 * k), 1000.0 + 200 * (k % 40 > 20)
        odd = random.choice((0.0, -1e30, float("nan"), float("inf"), 3e38)) if random.random() < 0.03 else None
        for message in (
            link.heartbeat_encode(12, 3, 0, 0, 0),
            link.rpm_encode(turns if odd is None else odd, 0.0),
            link.vfr_hud_encode(0.0, speed if odd is None else odd, 0, 0, 0.0, 0.0),
        ):
            data = message.pack(link, force_mavlink1=random.random() < 0.5)
            found.append(damaged(random, data) if random.random() < 1 / 6 else data)
    return found


def _follow_datagrams(campaign: Any, pieces: list[bytes]) -> None:
    from seatrial.campaign.live.sources import MavlinkUdp

    session = _session(campaign, "udp", ".tlog")
    session.channels.check_messages()
    stream = MavlinkUdp("127.0.0.1", 0, {"RPM", "VFR_HUD"})
    came = b""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for piece in pieces:
                sender.sendto(piece, stream.socket.getsockname())
                if (part := stream.read(0.2)) is not None:
                    came += part.raw
                    _take(session, part)
    finally:
        stream.close()
        _close(session, came)


def _session(campaign: Any, name: str, suffix: str) -> Any:
    from seatrial.campaign.live.session import Session
    from seatrial.campaign.live.session_files import Kept

    session = Session(campaign, name)
    session.kept = Kept(campaign, suffix, (*session.controls, *session.measured))
    return session


def _take(session: Any, piece: Any) -> None:
    """Take a piece; what is told has to be JSON and lines."""
    for look in session.take(piece):
        json.dumps(look.as_json(), allow_nan=False)
        if not look.lines():
            raise AssertionError("a look without a line")
    session.notes.take()


def _close(session: Any, came: bytes) -> None:
    """Close what is kept, which has to be what came."""
    session.kept.close()
    if Path(session.kept.raw.name).read_bytes() != came:
        raise AssertionError("what came is not what was kept")


def _import_kept(place: Path) -> None:
    """Import the samples that were kept as the campaign would."""
    from seatrial.campaign.config.load import check_text, load_campaign
    from seatrial.campaign.data.import_logs import get_trials
    from seatrial.campaign.live.session_files import import_lines, sessions

    campaign = load_campaign(place)
    (run,) = sessions(place)
    text = campaign.text.partition("[import]")[0] + import_lines(
        campaign.imports, campaign.model(campaign.full), campaign.channels, run
    )
    (place / "campaign.toml").write_text(text, encoding="utf-8")
    check_text(place, text)
    get_trials(load_campaign(place))
