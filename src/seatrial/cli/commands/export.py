"""Vehicles out to simulators, and trials out to vehicles."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.cli.answer import Answer, Exit, current_answer
from seatrial.cli.running import Quiet, watched

_TARGETS = "<gz|stonefish|fossen|casadi|fmu|mjcf|holoocean|json|csv|control|draws|mavlink|ros2|mcap>"
_TRIALS = "csv, json, mavlink, ros2 or mcap"
_OPTIONS = {
    "count": "--draws",
    "engine": "--engine",
    "density": "--density",
    "speeds": "--speeds",
}  # By those of an exporter


def export(
    what: Annotated[
        str, typer.Argument(metavar="DIR|VEHICLE", help="Folder of a finished campaign, or a vehicle of the catalogue.")
    ],
    to: Annotated[
        str | None, typer.Option("--to", metavar=_TARGETS, help=f"Simulator or file format; with --trial {_TRIALS}.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FOLDER", help="Folder of the files; DIR/export/<target> if not given."),
    ] = None,
    trial: Annotated[
        bool, typer.Option("--trial", help="Export the trial to run next instead of the vehicle.")
    ] = False,
    structure: Annotated[str | None, typer.Option(help="Structure instead of the chosen one, such as M-1.")] = None,
    configuration: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Configuration of the vehicle, if coefficients differ between several."),
    ] = None,
    rest: Annotated[
        str | None,
        typer.Option(
            "--fill-from", metavar="VEHICLE", help="Take unmodelled coefficients from this published vehicle."
        ),
    ] = None,
    schedule: Annotated[
        str | None, typer.Option(help="With --trial: another schedule of results/, such as design.")
    ] = None,
    engine: Annotated[
        str | None,
        typer.Option(metavar="<dart|other>", help="With --to gz: dart, or other for an engine without added mass."),
    ] = None,
    density: Annotated[
        str | None,
        typer.Option(metavar="QUANTITY", help='Density of the water, for simulators; "1025 kg/m^3" if not given.'),
    ] = None,
    speeds: Annotated[
        str | None,
        typer.Option(
            metavar="LIST", help='With --to control: speeds ahead, such as "0.5, 1 m/s"; about trim if not given.'
        ),
    ] = None,
    draws: Annotated[
        int | None,
        typer.Option(metavar="N", help="With --to control or draws: draws of the posterior; 256 if not given."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Export the vehicle to a simulator, or the next trial.

    Every file lists unsupported terms and their effect on the motion.
    """

    def work(reporter: Any) -> Exit:
        from seatrial.core.units import quantity

        folder = Path(what)
        if trial:
            vehicle = {"structure": structure, "configuration": configuration, "fill_from": rest}
            _only("--trial", **vehicle, engine=engine, density=density, speeds=speeds, draws=draws)
            return _trial(folder, to, out, schedule)
        _only("a vehicle, without --trial", schedule=schedule)
        water = None if density is None else quantity(density, "kg/m^3", "--density")
        ahead = None if speeds is None else _speeds(speeds)
        options = {"engine": engine, "density": water, "count": draws, "speeds": ahead}
        return _vehicle(what, to, out, {"structure": structure, "rest": rest, "configuration": configuration}, options)

    watched(quiet, work)


def _vehicle(
    what: str, to: str | None, out: Path | None, chosen: dict[str, str | None], options: dict[str, Any]
) -> Exit:
    from seatrial.core.errors import InputError
    from seatrial.export.from_campaign import export_to
    from seatrial.export.write import exporter_names, make_exporter

    if to is None:
        raise InputError(
            "--to", found="nothing", expected="one of " + ", ".join(exporter_names()), remedy="for example `--to gz`"
        )
    is_folder = Path(what).exists()
    if not is_folder:
        named = {"fill_from" if name == "rest" else name: value for name, value in chosen.items()}
        _only("a published vehicle", **named)
    here = Path(what) / "export" if is_folder else Path("export") / what
    own = here / make_exporter(to, _OPTIONS, **options).name
    folder = out or own
    # What is lost is printed before anything is written.
    statement, paths = export_to(
        what,
        to,
        folder,
        announce=lambda statement: current_answer().say("\n".join(statement.lines)),
        **chosen,
        **options,
    )
    _name_files(paths).give(target=statement.target, estimated=statement.estimated, loss=statement.loss)
    return Exit.ALARMS if statement.provenance.cautions else Exit.OK


def _speeds(text: str) -> tuple[float, ...]:
    """Read speeds, m/s, each once: a unit for each, or behind the last for all.

    Raises:
        InputError: a comma between digits, which may be a decimal one, or what is no speed.
    """
    from seatrial.core.errors import InputError
    from seatrial.core.units import quantity

    if re.search(r"\d,\d", text):
        raise InputError(
            "--speeds",
            found=f'"{text}", where a comma stands between digits',
            expected='speeds such as "0.5, 1.5 m/s"',
            remedy="separate speeds by spaces, or by commas with a space, and write 1.5 with a decimal point",
        )
    *others, last = re.split(r",\s*|\s+(?=[-+.\d])", text.strip(" ,"))
    unit = last.lstrip("-+.0123456789")
    each = (one if re.search("[a-z]", one) else one + (unit or " m/s") for one in (*others, last))
    ahead = tuple(dict.fromkeys(quantity(one, "m/s", "--speeds") for one in each))
    if not unit or min(ahead) < 0:
        remedy = f'write "{text.strip().replace("-", "")}{"" if unit else " m/s"}"'
        raise InputError(
            "--speeds", found=f'"{text}"', expected="speeds ahead, 0 m/s or more, with a unit", remedy=remedy
        )
    return ahead


def _trial(folder: Path, to: str | None, out: Path | None, schedule: str | None) -> Exit:
    from seatrial.core.errors import InputError
    from seatrial.export.trials.trial import read_trial
    from seatrial.export.trials.write import write_plain, write_trial

    if not folder.exists():
        raise InputError(
            "--trial",
            found=f'"{folder}", which is no folder',
            expected="the folder of a campaign with a next trial",
            remedy="name it; a vehicle of the catalogue has no trials",
        )
    trial = read_trial(folder, schedule)
    place = out or folder / "export" / "trial"
    paths, without = write_plain(trial, place) if to is None else (write_trial(trial, place, (to,)), "")
    current_answer().say("\n".join(trial.lines))
    answer = _name_files(paths)
    answer.give(trial=trial.manoeuvre, control=trial.control)
    if without:
        answer.say(f"no script for MAVLink: {without}")
    return Exit.ALARMS if trial.caution else Exit.OK


def _name_files(paths: Sequence[Path]) -> Answer:
    """Print the files of an export."""
    answer = current_answer()
    for path in paths:
        answer.say(f"wrote: {path}")
        answer.name_file(path.name, path)
    return answer


def _only(place: str, **options: Any) -> None:
    """Refuse options without a meaning here."""
    from seatrial.core.errors import InputError

    for name, value in options.items():
        if value is not None:
            option = f"--{name.replace('_', '-')}"
            raise InputError(
                option, found=f"{value}, together with {place}", expected="nothing", remedy=f"leave {option} out"
            )
