"""The trial's records: simulated, or read from logs."""

from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial.cli.running import Answer, Exit, Folder, Quiet, with_campaign


def simulate(
    context: typer.Context,
    folder: Folder,
    design: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Also run another design, by the name of its schedule: next, free_form, self_oscillation, searched, "
            "proposed, batch (all its trials) or batch_2 (one of them).",
        ),
    ] = None,
    schedule: Annotated[
        Path | None,
        typer.Option(
            metavar="CSV",
            help="Also run your own sequence: a table with time_s and a column for each control, such as n_rpm.",
        ),
    ] = None,
    label: Annotated[
        str | None,
        typer.Option(
            help="Name of the new record, for example second; if not given, that of its design or of its file."
        ),
    ] = None,
    alone: Annotated[
        bool, typer.Option("--only", help="Set earlier simulated trials aside, and run only this one.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Simulate the best design, and further trials if asked.

    An added trial stays: later commands also fit its record.
    """

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.data.import_logs import simulate_trials
        from seatrial.campaign.data.simulate import ask_for

        ask_for(campaign, design, schedule, label, alone, reporter)
        return _say_trials(answer, simulate_trials(campaign, reporter), campaign)

    with_campaign(
        folder, quiet, work, context if (design, schedule, label, alone) == (None, None, None, False) else None
    )


def import_logs(
    context: typer.Context,
    folder: Folder,
    run: Annotated[
        str | None, typer.Option(help="With --start or --end: only this run; all runs if not given.")
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help='Start of the run, such as "5 s", counted from the beginning of the record; written to campaign.toml.',
        ),
    ] = None,
    end: Annotated[str | None, typer.Option(metavar="TIME", help="End of the run, counted in the same way.")] = None,
    accelerations: Annotated[
        str | None,
        typer.Option(
            metavar="CHANNELS",
            help="Channels to smooth and differentiate, such as u,r; writes values and rates, each with its sd.",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Read logs into records, by the channel map of the campaign."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.data.import_logs import import_trials
        from seatrial.core.errors import InputError

        if start is not None or end is not None:
            return _say_trials(answer, _trim(campaign, run, start, end, reporter, answer), campaign, accelerations)
        if run is not None:
            raise InputError(
                "--run", found=run, expected="--start or --end with it", remedy="give one, or leave it out"
            )
        return _say_trials(answer, import_trials(campaign, reporter), campaign, accelerations)

    with_campaign(folder, quiet, work, context if start is None and end is None else None)


def _trim(campaign: Any, run: str | None, start: str | None, end: str | None, reporter: Any, answer: Answer) -> Any:
    """Import with other ends of the runs, and write these to the campaign file if the import succeeds."""
    from seatrial.campaign.config.load import check_text
    from seatrial.campaign.data.import_logs import available_of, import_trials
    from seatrial.campaign.data.no_record import no_record
    from seatrial.cli.campaign_text import read_file, with_trim, write_file
    from seatrial.core.errors import InputError
    from seatrial.core.units import quantity
    from seatrial.logs.cut_record import is_beyond

    if not campaign.has_records:
        raise no_record(campaign)
    if campaign.imports is None:
        raise InputError("--start, --end", found="a simulated vehicle", expected="[import]", remedy="leave them out")
    given = [(option, text) for option, text in (("--start", start), ("--end", end)) if text is not None]
    seconds = [quantity(text, "s", option) for option, text in given]
    if min(seconds) < 0:
        raise InputError(
            "--start, --end",
            found=f"{min(seconds):g} s",
            expected="0 s or more",
            remedy="count from the beginning of the record",
        )
    if len(seconds) == 2 and not seconds[0] < seconds[1]:
        raise InputError(
            "--start, --end", found=f"{start} to {end}", expected="a start before the end", remedy="swap them"
        )
    seen = read_file(campaign.folder)
    text = with_trim(campaign.folder, seen, run, start, end)
    trials = import_trials(check_text(campaign.folder, text), reporter)
    others = () if run is not None else tuple(campaign.imports.trim)
    lengths = {one: length for one, length in available_of(trials).items() if run in (None, one) and one not in others}
    short = {one: length for one, length in lengths.items() if end is not None and is_beyond(seconds[-1], length)}
    runs = ", ".join(f"run {one} at {length:.6g} s" for one, length in short.items())
    if short and len(short) == len(lengths):
        raise InputError(
            "--end",
            found=f"{end}, and the files end before it: {runs}",
            expected="an end inside the run",
            remedy="give an earlier end, counted from the start of the overlap of the files",
        )
    write_file(campaign.folder, text, seen)
    if short:
        answer.caution(f"the files of some runs end before --end, so these runs end there: {runs}")
    for own in others:
        answer.caution(f"run {own} has a separate start and end; --run {own} changes them")
    return trials


def _say_trials(answer: Answer, trials: Any, campaign: Any, accelerations: str | None = None) -> Exit:
    from seatrial.campaign.data.record_cautions import record_cautions, unused_channels

    answer.caution(
        *(
            one
            for record in (*trials.fit, *trials.predict)
            for one in unused_channels(campaign.channels, campaign.model(campaign.full), record)
        )
    )
    for record in (*trials.fit, *trials.predict):
        channels = f"{', '.join(record.controls)} -> {', '.join(record.measured)}"
        answer.say(f"record {record.label}: {record.time.size} samples over {record.time[-1]:.1f} s; {channels}")
        if followed := record.provenance.options.get("followed"):
            answer.say(f"  followed {followed}")
        answer.caution(*record_cautions(record))
    answer.give(
        records=[
            {
                "label": record.label,
                "held_back": held_back,
                "samples": record.time.size,
                "duration": record.time[-1],
                "controls": record.controls,
                "measured": record.measured,
            }
            for held_back, records in ((False, trials.fit), (True, trials.predict))
            for record in records
        ]
    )
    if accelerations is not None:
        _smooth(answer, campaign, trials, accelerations)
    return Exit.OK


def _smooth(answer: Answer, campaign: Any, trials: Any, channels: str) -> None:
    """Smooth channels of every record, write them with their rates, and print the results."""
    from seatrial.campaign.data.accelerations import check_names, smooth_channels, write_accelerations
    from seatrial.report.figure_files import write_accelerations_picture

    records = (*trials.fit, *trials.predict)
    names = list(dict.fromkeys(name.strip() for name in channels.split(",")))
    for record in records:
        check_names(record, names, "--accelerations")
    for record in records:
        result = smooth_channels(campaign.noise, record, names)
        for channel in result:
            answer.say(f"record {record.label}, {channel.line}")
        folder = campaign.folder
        paths = (write_accelerations(folder, record, result), write_accelerations_picture(folder, record, result))
        answer.say(f"  written: {', '.join(map(str, paths))}")
