"""A campaign file to begin from: a template, what is said by options, or what is asked in a terminal."""

import shlex
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.apps.answer import current_answer, echo
from seatrial.apps.running import Folder


def _one(metavar: str, meaning: str) -> Any:
    return typer.Option(metavar=metavar, help=meaning)


def _line(meaning: str) -> Any:
    return typer.Option(metavar="LINE", help=f"{meaning} May be given again.")


# Quantities are written as in the file; each line of a list as `seatrial.campaign.config.new_campaign` reads it.
Template = Annotated[
    str | None,
    _one(
        "<remus100|design|steering|log|bollard>",
        "A template: remus100 is simulated; design and steering have no data yet; log (one propeller, surge) and bollard read a CSV log. "
        "With several thrusters: docs/how-to/own_log.md, Two thrusters that push and turn.",
    ),
]
Vehicle = Annotated[
    str | None, _one("NAME", "Published vehicle, see `seatrial vehicle`; for your own vehicle give --mass instead.")
]
Mass = Annotated[str | None, _one("QUANTITY", 'Mass of your own vehicle in air, such as "30 kg".')]
Inertia = Annotated[str | None, _one("THREE", 'Its moments of inertia, if it turns: "0.2, 3.4, 3.4 kg m^2".')]
Moves = Annotated[
    str | None, _one("NAMES", "Velocities of the model, such as u,v,r; if not given, u, or all that are published.")
]
Known = Annotated[list[str] | None, _line('A known coefficient, in SI units: "X_udot -1.0".')]
Deduction = Annotated[
    str | None, _one("SHARE", "Thrust deduction, the share of the thrust that is lost at the stern, such as 0.1.")
]
Seek = Annotated[
    list[str] | None,
    _line(
        'A coefficient to find, with its plausible range: "X_uabsu -4.5 to -1.5 kg/m"; if it is published, the name is enough.',
    ),
]
Optional = Annotated[
    list[str] | None, _line("A coefficient in doubt, written like --seek: the data decide whether the model needs it.")
]
Speed = Annotated[str | None, _one("QUANTITY", 'Speed at which a trial begins, such as "1.5 m/s".')]
Control = Annotated[
    list[str] | None,
    _line(
        'A control: trim, range, rate of change: "n 1200 rpm, 700 to 1600 rpm, 800 rpm/s". The trial moves the first one; for '
        "others the trim is enough.",
    ),
]
Sensor = Annotated[list[str] | None, _line('A sensor: noise of one sample, rate: "u 0.05 m/s, 5 Hz".')]
Limit = Annotated[list[str] | None, _line('A limit of the motion: "u above 0.5 m/s", "distance below 150 m".')]
Duration = Annotated[str | None, _one("TIME", 'Duration of one trial; "60 s" if not given.')]
Goal = Annotated[list[str] | None, _line('How well a coefficient must be known: "X_uabsu 3 %".')]
Log = Annotated[
    Path | None, _one("FILE", "A log of the published vehicle: its columns are guessed, and the campaign imports it.")
]
Name = Annotated[str | None, _one("TEXT", "Name of the campaign, for headings.")]


def init(
    folder: Folder,
    template: Template = None,
    vehicle: Vehicle = None,
    mass: Mass = None,
    inertia: Inertia = None,
    moves: Moves = None,
    known: Known = None,
    thrust_deduction: Deduction = None,
    seek: Seek = None,
    optional: Optional = None,
    speed: Speed = None,
    control: Control = None,
    sensor: Sensor = None,
    limit: Limit = None,
    duration: Duration = None,
    goal: Goal = None,
    log: Log = None,
    name: Name = None,
) -> None:
    """Write a commented campaign file.

    The options describe the vehicle, or name a template. Without options it asks, in a terminal.
    """
    said = {
        **{"vehicle": vehicle, "mass": mass, "inertia": inertia, "moves": moves, "known": known},
        **{"thrust_deduction": thrust_deduction, "seek": seek, "optional": optional, "speed": speed},
        **{"control": control, "sensor": sensor, "limit": limit, "goal": goal, "name": name, "duration": duration},
    }
    given = {option: value for option, value in said.items() if value}
    _check_beside(template, given)
    if log is not None:
        _write_of_log(folder, log, given)
        return
    if template is None and not given and _is_terminal() and not current_answer().as_json:
        answers = _asked()
        if isinstance(answers, str):
            template = answers
        else:
            given = answers
            echo(f"the same command with options:\n  {_command(folder, given)}")
    if given:
        _write_new(folder, given)
    else:
        _write_template(folder, template or "remus100")


def _is_terminal() -> bool:
    return sys.stdin.isatty() and sys.stdout.isatty()


def _check_beside(template: str | None, given: dict[str, Any]) -> None:
    """Refuse a template together with what would change it."""
    from seatrial.core.errors import InputError

    if template is not None and given:
        raise InputError(
            f"--template {template}",
            found="--" + ", --".join(option.replace("_", "-") for option in given) + " beside it",
            expected="a template, or what is known of a vehicle",
            remedy="leave --template out, or edit what it writes",
        )


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


def _write_of_log(folder: Path, log: Path, said: dict[str, Any]) -> None:
    """Write the campaign of a published vehicle and a log of it.

    Raises:
        InputError: no vehicle, or something else beside it than what moves and a name.
    """
    from seatrial.campaign.config.load import check_text
    from seatrial.campaign.config.log_campaign import log_campaign_text
    from seatrial.campaign.config.new_campaign import listed_names
    from seatrial.campaign.config.new_campaign_file import told_by_options
    from seatrial.campaign.config.templates import write_campaign
    from seatrial.core.errors import InputError

    if "vehicle" not in said or (others := sorted({*said} - {"vehicle", "moves", "name"})):
        raise InputError(
            "--log",
            found="no --vehicle beside it" if "vehicle" not in said else "--" + ", --".join(others) + " beside it",
            expected="--vehicle, and --moves or --name at most",
            remedy="for a vehicle of your own take --template log, and the map of `seatrial inspect LOG --map`",
        )
    text = log_campaign_text(
        folder, said["vehicle"], log, tuple(listed_names(said.get("moves", ""))), said.get("name", "")
    )
    with told_by_options(lambda key: "--moves" if key == "vehicle.moves" else f"--log {log}"):
        check_text(folder, text)
    path, answer = write_campaign(folder, text), current_answer()
    answer.say(f"wrote {path}: {said['vehicle']} and its log {log.name}")
    answer.name_file("campaign", path)
    answer.give(template=None)
    answer.say("look at its map and its law of thrust, then:")
    answer.say(f"seatrial import {folder}; seatrial check {folder}; seatrial estimate {folder} --by mode")


def _write_new(folder: Path, said: dict[str, Any]) -> None:
    """Write what was said, once it makes a campaign that can be used."""
    from seatrial.campaign.config.load import check_text
    from seatrial.campaign.config.new_campaign import new_campaign
    from seatrial.campaign.config.new_campaign_file import campaign_text, option_of, told_by_options
    from seatrial.campaign.config.templates import init_campaign
    from seatrial.core.coefficients import CoefficientName

    new = new_campaign(said)
    with told_by_options(partial(option_of, new)):
        check_text(folder, campaign_text(new))
    path, answer = init_campaign(folder, new), current_answer()
    answer.say(f"wrote {path}: {new.name}")
    answer.name_file("campaign", path)
    answer.give(template=None)
    for one in (*new.sought, *new.optional):
        if one.lower:
            unit = one.unit or f"{CoefficientName.parse(one.name).unit} (SI, as no unit was given)"
            answer.say(f"read {one.name}: {one.lower} to {one.upper} {unit}")
    answer.say(f"next, see the priors as speeds: seatrial prior {folder}; then: seatrial design {folder}")


def _command(folder: Path, said: dict[str, Any]) -> str:
    """Return the command that says the same."""
    words = ["seatrial", "init", str(folder)]
    for option, value in said.items():
        for text in [value] if isinstance(value, str) else value:
            words += [f"--{option.replace('_', '-')}", text]
    return shlex.join(words)


# What is asked in a terminal: one line for each question, read at once, and asked again where it cannot be.


def _asked() -> dict[str, Any] | str:
    """Ask for what a campaign needs; returns it as options have it, or the name of a template."""
    from seatrial.campaign.config import new_campaign as parts
    from seatrial.campaign.config.new_campaign_file import SURGE
    from seatrial.campaign.config.templates import TEMPLATES
    from seatrial.vehicles.catalogue import vehicle_names

    published = vehicle_names()
    echo(
        "Begin with a published vehicle, your own vehicle, or a template. You can change every answer later in the file."
    )
    echo("  published: " + ", ".join(published))
    echo("  templates: " + "; ".join(f"{name}, {meaning}" for name, meaning in TEMPLATES.items()))
    first = _ask("vehicle, template or own", _one_of((*published, *TEMPLATES, "own")), "own")
    if first in TEMPLATES:
        return first
    said: dict[str, Any] = {} if first == "own" else {"vehicle": first}
    if first == "own":
        said["mass"] = _ask("mass in air, such as 30 kg", _quantity_text("kg"))
    if not first.endswith(SURGE):
        said["moves"] = _ask(
            "velocities of the model, of u v w p q r", _text_of(parts.read_moves), "u" if first == "own" else "u,v,r"
        )
        said["speed"] = _ask("speed at which a trial begins, such as 1.5 m/s", _quantity_text("m/s"))
    if first == "own":
        if set(said["moves"]) & set("pqr"):
            said["inertia"] = _ask(
                "inertia about its three axes, such as 0.2, 3.4, 3.4 kg m^2", _text_of(parts.read_inertia)
            )
        said["known"] = _several('known coefficients, such as "X_udot -1.0"', parts.read_known)
        said["thrust_deduction"] = _ask(
            "thrust deduction, the share of the thrust that is lost at the stern", _quantity_text("1"), "0"
        )
    else:
        _say_published(first, said.get("moves", "u"))
    range_of = 'such as "X_uabsu -4.5 to -1.5 kg/m"' + (", or a published name alone" if first != "own" else "")
    sought = partial(parts.read_sought, is_published=first != "own")
    said["seek"] = _several(f"coefficients to find, {range_of}", sought, least=1)
    said["optional"] = _several("coefficients in doubt, which the data keep or drop", sought)
    example = "n 1200 rpm, 700 to 1600 rpm, 800 rpm/s"
    said["control"] = _several(
        f'controls, first the one that moves: trim, range, rate; "{example}"', parts.read_control, 1
    )
    said["sensor"] = _several('sensors: noise of one sample, rate; "u 0.05 m/s, 5 Hz"', parts.read_sensor, 1)
    said["limit"] = _several('limits of the motion, such as "u above 0.5 m/s"', parts.read_limit)
    said["duration"] = _ask("duration of a trial", _quantity_text("s"), "60 s")
    names = [line.split()[0] for line in (*said["seek"], *said["optional"])]
    goal = partial(parts.read_goal, among=names)
    said["goal"] = _several('how well coefficients must be known, such as "X_uabsu 3 %"', goal)
    said["name"] = _ask("name of the campaign", _one_text, "first trial")
    return {option: value for option, value in said.items() if value and value != "0"}


def _say_published(name: str, moves: str) -> None:
    """Print what is published of a vehicle in some motions."""
    from seatrial.campaign.config.new_campaign import listed_names
    from seatrial.vehicles.catalogue import load_surge, load_vehicle, surge_names

    if name in surge_names():
        known: Iterable[str] = load_surge(name).coefficients
    else:
        known = load_vehicle(name).terms(tuple(listed_names(moves)))
    echo("  published: " + " ".join(known))


def _ask(question: str, read: Callable[[str, str], str], default: str = "") -> str:
    """Ask until the answer can be read."""
    from seatrial.core.errors import InputError

    while True:
        text = typer.prompt(question, default=default, show_default=bool(default)).strip()
        try:
            return read(text, question)
        except InputError as error:
            echo(f"  {error.sentence()}")


def _several(question: str, read: Callable[[str, str], Any], least: int = 0) -> list[str]:
    """Ask for one line after another until an empty one."""
    echo(f"{question}; an empty line ends")

    def kept(text: str, place: str) -> str:
        if text or len(found) < least:
            read(text, place)
        return text

    found: list[str] = []
    while text := _ask(f"  {len(found) + 1}", kept):
        found.append(text)
    return found


def _one_of(names: Iterable[str]) -> Callable[[str, str], str]:
    from seatrial.core.argument_checks import check_choice

    return lambda text, place: check_choice(text, tuple(names), place)


def _text_of(read: Callable[[str, str], Any]) -> Callable[[str, str], str]:
    """Return what keeps an answer as it was written, once it can be read."""
    return lambda text, place: (read(text, place), text)[1]


def _quantity_text(unit: str) -> Callable[[str, str], str]:
    from seatrial.core.units import quantity

    return lambda text, place: (quantity(text, unit, place), text)[1]


def _one_text(text: str, place: str) -> str:
    from seatrial.core.errors import InputError

    if not text:
        raise InputError(place, found="nothing", expected="an answer", remedy="Ctrl-C leaves everything as it is")
    return text
