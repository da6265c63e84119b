"""A first campaign file from a template, a published vehicle, its log, or answers in a terminal."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from seatrial.cli.answer import current_answer, echo
from seatrial.cli.running import Folder

Template = Annotated[
    str | None,
    typer.Option(
        metavar="<remus100|design|steering|log|bollard>",
        help="Template. remus100 is simulated; design and steering have no data yet; log (one propeller, surge) and bollard read a "
        "CSV log. For several thrusters see docs/how-to/own_log.md, Two thrusters that push and turn.",
    ),
]
Vehicle = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Published vehicle, see `seatrial vehicle`; for another vehicle use --template."),
]
Log = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Log of the vehicle, your own if --vehicle is not given; its columns are guessed, and the campaign imports it.",
    ),
]
Shape = Annotated[
    str | None,
    typer.Option(
        metavar="WORDS",
        help="Shape and mass of your vehicle, from which priors follow: 'box, length 0.46 m, beam 0.34 m, height 0.25 m, mass 11.5 kg'. "
        "Forms are torpedo, ellipsoid, box (an open frame) and an STL file. A round hull has a diameter. See docs/how-to/priors.md.",
    ),
]


def init(
    folder: Folder, template: Template = None, vehicle: Vehicle = None, log: Log = None, shape: Shape = None
) -> None:
    """Write a commented campaign file.

    Without options it asks for each value of a template, if run in a terminal; otherwise it writes the template remus100.
    """
    from seatrial.core.errors import InputError

    if template is not None and (vehicle is not None or log is not None):
        raise InputError(
            f"--template {template}",
            found="--vehicle or --log too",
            expected="a template, or a published vehicle",
            remedy="leave --template out, or edit the file that it writes",
        )
    if shape is not None:
        if template is not None or vehicle is not None or log is not None:
            remedy = "leave the others out. To use the priors with a log, copy their tables into its campaign"
            raise InputError(
                "--shape", found="--template, --vehicle or --log too", expected="a shape alone", remedy=remedy
            )
        _write_of_shape(folder, shape)
    elif vehicle is not None or log is not None:
        _write_of_vehicle(folder, vehicle or "", log)
    elif template is None and _is_terminal() and not current_answer().as_json:
        _ask_all(folder)
    else:
        _write_template(folder, template or "remus100")


def _is_terminal() -> bool:
    return sys.stdin.isatty() and sys.stdout.isatty()


def _write_template(folder: Path, template: str) -> None:
    from seatrial.campaign.config.templates import TEMPLATES, init_campaign

    path, answer = init_campaign(folder, template), current_answer()
    answer.say(f"wrote {path}: {TEMPLATES[template]}")
    answer.name_file("campaign", path)
    answer.give(template=template)
    answer.say(f"edit it, then: seatrial {'run' if template in ('remus100', 'log', 'bollard') else 'design'} {folder}")
    for other, meaning in TEMPLATES.items():
        if other != template:
            answer.say(f"instead, --template {other}: {meaning}")


def _write_of_vehicle(folder: Path, vehicle: str, log: Path | None) -> None:
    from seatrial.campaign.config.load import check_text
    from seatrial.campaign.config.vehicle_campaign import vehicle_campaign_text

    text = vehicle_campaign_text(folder, vehicle, log)
    check_text(folder, text)
    if log is None:
        following = f"correct its trim and sensors, then: seatrial prior {folder}; seatrial design {folder}"
        _write(folder, text, vehicle, following)
    else:
        following = f"seatrial import {folder}; seatrial check {folder}; seatrial estimate {folder} --by mode"
        _write(
            folder,
            text,
            f"{vehicle or 'your vehicle'} and its log {log.name}",
            f"check its map and its {'law of thrust' if vehicle else 'mass and priors'}, then: {following}",
        )


def _write_of_shape(folder: Path, shape: str) -> None:
    from seatrial.campaign.config.load import check_text
    from seatrial.campaign.config.shape_campaign import shape_campaign_text, shape_of_text

    priors = shape_of_text(shape)
    text = shape_campaign_text(shape, priors)
    check_text(folder, text)
    current_answer().say(repr(priors))
    _write(folder, text, shape, f"correct forces and sensors, then: seatrial prior {folder}; seatrial design {folder}")


def _write(folder: Path, text: str, subject: str, following: str) -> None:
    from seatrial.campaign.config.templates import write_campaign

    path, answer = write_campaign(folder, text), current_answer()
    answer.say(f"wrote {path}: {subject}")
    answer.name_file("campaign", path)
    answer.give(template=None)
    answer.say(following)


# In a terminal: one line for each question, read at once, and asked again if it cannot be read.


def _ask_all(folder: Path) -> None:
    """Ask for the source of a campaign, then for the values of its template."""
    from seatrial.campaign.config.templates import TEMPLATES, template_text
    from seatrial.core.argument_checks import check_choice
    from seatrial.vehicles.catalogue import vehicle_names

    echo("Begin with a published vehicle, your own vehicle, or a template. You can change every answer in the file.")
    echo("  published: " + ", ".join(vehicle_names()))
    echo("  templates: " + "; ".join(f"{name}, {meaning}" for name, meaning in TEMPLATES.items()))
    names, question = (*vehicle_names(), *TEMPLATES, "own"), "vehicle, template or own"
    first = _ask_until(question, "own", lambda answer: check_choice(answer, names, question))
    if first in TEMPLATES:
        _write_template(folder, first)
    elif first != "own":
        log = typer.prompt("a log of it, or an empty line", default="", show_default=False).strip()
        _write_of_vehicle(folder, first, Path(log) if log else None)
    else:
        echo("Each value is an example: press Enter to keep it.")
        text = _checked(folder, _ask(template_text("design")))
        following = f"next: seatrial prior {folder} shows the speeds of the priors; then: seatrial design {folder}"
        _write(folder, text, "your own vehicle", following)


def _ask(text: str) -> str:
    """Ask for every value of a campaign file; an answer may add or remove questions, such as the answer for the terms."""
    from seatrial.cli.questions import questions

    asked: set[str] = set()
    while following := next((one.key for one in questions(text) if one.key not in asked), None):
        asked.add(following)
        text = _ask_value(text, following)
    return text


def _ask_value(text: str, key: str) -> str:
    """Ask for one value until the answer can be read."""
    from seatrial.cli.questions import answered, questions

    question = next(one for one in questions(text) if one.key == key)
    return _ask_until(f"{key}, {question.meaning}", question.value, lambda answer: answered(text, {key: answer}))


def _checked(folder: Path, text: str) -> str:
    """Check the whole file, and ask again for the value that an error names.

    Raises:
        InputError: an error that names none of the values.
    """
    from seatrial.campaign.config.load import check_text
    from seatrial.cli.questions import key_at, questions
    from seatrial.core.errors import InputError

    while True:
        try:
            check_text(folder, text)
        except InputError as error:
            key = key_at(error.where, [one.key for one in questions(text)])
            if key is None:
                raise
            echo(f"{key}: {error.sentence()}")
            text = _ask_value(text, key)
        else:
            return text


def _ask_until(question: str, default: str, read: Callable[[str], str]) -> str:
    """Ask until an answer can be read, and return the result of `read`."""
    from seatrial.core.errors import InputError

    while True:
        try:
            return read(typer.prompt(question, default=default).strip())
        except InputError as error:
            echo(f"  {error.sentence()}")
