"""`seatrial init` by odd options and odd answers: what is written is a campaign, what is refused is written nowhere."""

import contextlib
import io
import json
import re
import shlex
import sys
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

from attacks.outcome import Outcome, Watchman, told

ODD = (
    *("", " ", "0", "-1", "1e308", "1e999", "nan", "inf", "-inf", "1,5", "9" * 400, "\u0661", "\0", "\u00e9", "x y z", "..", "'", '"'),
    *("kg", "parsec", "1 m**9**9**9/s", "5 %", "-5 %", "1e400 kg", "[1]", "{}", "#", "\n", "]\n[truth]\nX_u = 1", "${HOME}", "~"),
    *("X_u", "X_uabsu", "Z_www", "X_udot", "n", "u", "psi", "delta_r", "f_1", "1 rpm", "-4 to -1 kg/m", "0 rpm, 1 rpm to 2 rpm"),
)  # fmt: skip
"""Words that take the place of a part of an option or answer."""


def odd_options(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Begin a campaign by options, or by answers as in a terminal, of which some are odd."""
    from tests.apps.test_init_command import OWN

    said = [shlex.split(OWN), _PUBLISHED][number % 2]
    pairs = [(option, _odd(random, value)) for option, value in zip(said[::2], said[1::2], strict=True)]
    words = [f"{option}={value}" for option, value in pairs if random.random() > 0.03]
    answers = [one for value in _ANSWERS for one in dict.fromkeys((_odd(random, value), value))]
    if asks := number % 5 == 4:
        words = []
    elif number % 3 == 0:
        words.append("--json")
    folder, output = place / "boat", io.StringIO()
    place.mkdir(parents=True)
    what = f"answers {answers}" if asks else shlex.join(words)
    with watchman.on_duty(place) as seen:
        try:
            code, errors = _init(folder, words, answers if asks else None, output)
            found = _judge(folder, code, errors, output.getvalue(), as_json="--json" in words)
        except BaseException as error:
            return Outcome("traceback", f"{what}: {told(error)}")
    return Outcome("escape", f"{what}: {'; '.join(seen)}") if seen else found._replace(line=f"{what}: {found.line}")


_PUBLISHED = shlex.split(
    "--vehicle remus100_hall_anstee --moves u,v,r --seek Y_uv --seek Y_uudelta_r --seek N_uv --seek N_uudelta_r "
    "--speed '1.54 m/s' --control 'delta_r 0 deg, -15 to 15 deg, 20 deg/s' --control 'n 1194 rpm' --sensor 'r 0.3 deg/s, 5 Hz' "
    "--limit 'r -10 to 10 deg/s' --goal 'N_uv 20 %' --duration '60 s' --name turns"
)
_ANSWERS = (
    *("own", "45 kg", "u", "1.5 m/s", "X_udot -1.5", "", "0.1", "X_uabsu -8 to -2 kg/m", "T_nabsn 0.02 to 0.06 N/(rev/s)^2", ""),
    *("X_u -5 to 0", "", "n 1000 rpm, 500 to 1500 rpm, 600 rpm/s", "", "u 0.02 m/s, 5 Hz", "", "u above 0.4 m/s", "", "60 s"),
    *("X_uabsu 5 %", "", "otter"),
)  # fmt: skip
"""What is right in a terminal, in the order of the questions; behind an odd answer comes the right one."""


def _odd(random: Random, value: str) -> str:
    """Return the value of an option; now and then a word, a number or a character of it is another."""
    if random.random() > 0.15:
        return value
    parts = re.split(r"(\s+|,)", value)
    at = random.randrange(len(parts))
    match random.randrange(5):
        case 0:
            return random.choice(ODD)
        case 1 | 2:
            parts[at] = random.choice(ODD)
        case 3:
            del parts[at]
        case _:
            parts[at] = re.sub(
                r"\d+", lambda one: random.choice(("0", "-" + one[0], one[0] * 30, "1e308", "1e-320")), parts[at]
            )
    return "".join(parts)


def _init(folder: Path, words: list[str], answers: list[str] | None, output: io.StringIO) -> tuple[int, str]:
    """Run the command in this process; returns its exit status and what it says on standard error."""
    from seatrial.apps.cli import main
    from seatrial.apps.commands import init

    errors = io.StringIO()
    typed = io.StringIO("\n".join(answers or []))
    arguments: list[Any] = ["seatrial", "init", str(folder), *words]
    with (
        patch.object(sys, "argv", arguments),
        patch.object(sys, "stdin", typed),
        patch.object(init, "_is_terminal", lambda: answers is not None),
        contextlib.redirect_stdout(output),
        contextlib.redirect_stderr(errors),
    ):
        try:
            main()
        except SystemExit as ended:
            return int(ended.code or 0), errors.getvalue()
    return 0, errors.getvalue()


def _judge(folder: Path, code: int, errors: str, output: str, as_json: bool) -> Outcome:
    """Judge what came of it: a campaign that loads, or a refusal with a remedy that leaves nothing."""
    from seatrial.campaign.config.load import load_campaign

    written = (folder / "campaign.toml").exists()
    if as_json:
        document = json.loads(output)
        if document["exit"] != code or (document["error"] is None) != (code == 0):
            return Outcome(
                "unclear", f"exit status {code}, and the document says {document['exit']}, {document['error']}"
            )
    if code == 0:
        load_campaign(folder)
        return Outcome("done", "")
    if written:
        return Outcome("different", f"exit status {code}, and a campaign was written: {errors[-300:]}")
    if code == 1 and errors.endswith("Aborted!\n"):
        return Outcome("refused", "the answers ended before the questions")
    return Outcome("refused" if code == 2 and "remedy:" in errors else "unclear", f"{code} {errors[-300:]}")
