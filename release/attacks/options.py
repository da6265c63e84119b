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
from seatrial.campaign.config.templates import template_text
from seatrial.cli.questions import questions

ODD = (
    *("", " ", "0", "-1", "1e308", "1e999", "nan", "inf", "-inf", "1,5", "9" * 400, "\u0661", "\0", "\u00e9", "x y z", "..", "'", '"'),
    *("kg", "parsec", "1 m**9**9**9/s", "5 %", "-5 %", "1e400 kg", "[1]", "{}", "#", "\n", "]\n[truth]\nX_u = 1", "${HOME}", "~"),
    *("X_u", "X_uabsu", "Z_www", "X_udot", "n", "u", "psi", "delta_r", "f_1", "1 rpm", "-4 to -1 kg/m", "0 rpm, 1 rpm to 2 rpm"),
)  # fmt: skip
"""Words that take the place of a part of an option or answer."""


def odd_options(number: int, random: Random, place: Path, watchman: Watchman) -> Outcome:
    """Begin a campaign by options, or by answers as in a terminal, of which some are odd."""
    keys = [one for one in questions(template_text("design")) if random.random() < 0.9]
    answers = [
        "own",
        *(one for question in keys for one in dict.fromkeys((_odd(random, question.value), question.value))),
    ]
    words = [f"{option}={_odd(random, value)}" for option, value in _OPTIONS if random.random() < 0.6]
    if asks := number % 5 < 3:
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


_OPTIONS = (("--template", "design"), ("--vehicle", "remus100_hall_anstee"), ("--log", "dive.csv"))


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
    from seatrial.__main__ import main
    from seatrial.cli.commands import init

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
