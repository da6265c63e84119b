"""The command line: `seatrial init | prior | design | simulate | import | estimate | select | tuning | report | run | paper`."""

import os
import signal
import sys
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from seatrial import __version__
from seatrial.core.errors import InputError, NumericalError, SeatrialError


class Exit(IntEnum):
    """Exit codes of every command."""

    OK = 0
    BUG = 1
    BAD_INPUT = 2
    ALARMS = 3
    NUMERICAL = 4
    INTERRUPTED = 130


app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Identify the dynamics of underwater vehicles: design a trial, estimate the coefficients, select the terms the data support, "
    "say what to run next.",
    epilog="Exit codes: 0 done; 2 something in the input cannot be used (the message says what and how to mend it); 3 done, but a health "
    "check failed (see the report); 4 the computation failed; 130 interrupted (run again to resume).",
)
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the campaign.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Only results and errors.")]


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        typer.echo(f"seatrial {__version__}")
        raise typer.Exit


@app.command()
def init(
    folder: Folder,
    template: Annotated[
        str, typer.Option(help="Campaign to begin from: remus100 (simulated) or log (a CSV log).")
    ] = "remus100",
) -> None:
    """Write a campaign file to begin from."""
    from seatrial.campaign.templates import init_campaign

    typer.echo(f"wrote {init_campaign(folder, template)}; edit it, then: seatrial run {folder}")


@app.command()
def prior(folder: Folder, quiet: Quiet = False) -> None:
    """Show what the priors mean in metres per second, before any data are used."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.prior_predictive import predict_from_prior
        from seatrial.campaign.prior_words import prior_alarms, prior_cautions, prior_lines
        from seatrial.report.prior_picture import write_prior_picture

        found = predict_from_prior(campaign, watch)
        typer.echo("\n".join(prior_lines(found)))
        typer.echo(f"picture: {write_prior_picture(campaign, found)}")
        return _finish(prior_alarms(found), prior_cautions(found))

    _with_campaign(folder, quiet, work)


@app.command()
def design(folder: Folder, quiet: Quiet = False) -> None:
    """Find the most informative trial of the family, inside the limits."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.designs import design_first
        from seatrial.campaign.shown import shown_unit
        from seatrial.campaign.store import Store

        sweep = design_first(campaign, watch)
        row, column = sweep.best
        factor, unit = shown_unit(sweep.family.control)
        typer.echo(
            f"best doublet: amplitude {sweep.amplitude[row] * factor:.4g} {unit}, period {sweep.period[column]:.4g} s, "
            f"entropy reduction {sweep.gain[row, column]:.2f} nat; schedule in {Store(folder).schedule(Store(folder).design)}"
        )
        return Exit.OK

    _with_campaign(folder, quiet, work)


@app.command()
def simulate(folder: Folder, quiet: Quiet = False) -> None:
    """Run the designed trial on the simulated vehicle."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.trials import simulate_trial

        return _say_trials(simulate_trial(campaign, watch))

    _with_campaign(folder, quiet, work)


@app.command(name="import")
def import_logs(folder: Folder, quiet: Quiet = False) -> None:
    """Read real logs into records, by the campaign's channel map."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.trials import import_trials

        return _say_trials(import_trials(campaign, watch))

    _with_campaign(folder, quiet, work)


@app.command()
def estimate(folder: Folder, quiet: Quiet = False) -> None:
    """Estimate the coefficients of every candidate structure."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.estimate import estimate_all
        from seatrial.campaign.trials import get_trials

        estimates = estimate_all(campaign, get_trials(campaign, watch), watch)
        for item in estimates:
            typer.echo(f"{item.structure.label}")
            for name in item.names:
                row = item.data.sel(parameter=name)
                typer.echo(
                    f"  {name:<16} {float(row['mean']):>12.5g} ± {float(row['sd']):<10.3g} {row['unit'].values!s}"
                )
        return _finish(
            [text for item in estimates for text in item.alarms],
            [text for item in estimates[:1] for text in item.cautions],
        )

    _with_campaign(folder, quiet, work)


@app.command()
def select(folder: Folder, quiet: Quiet = False) -> None:
    """Decide which terms the data support."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.choose import select_structure
        from seatrial.campaign.trials import get_trials

        selection = select_structure(campaign, get_trials(campaign, watch), watch)
        for structure, evidence, probability in zip(
            selection.structures, selection.evidences, selection.probability, strict=True
        ):
            value = f"log evidence {evidence.log_value:.2f} ± {evidence.std_error:.2f}"
            typer.echo(f"{structure.label}  {value}  probability {probability:.3f}  {' '.join(structure.terms)}")
        for verdict in selection.verdicts:
            typer.echo(verdict)
        return _finish(list(selection.alarms), [])

    _with_campaign(folder, quiet, work)


@app.command()
def tuning(folder: Folder, quiet: Quiet = False) -> None:
    """Check the tuning of the filter along each fitted record, and say which of P, Q and R to change."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.estimate import estimate_all
        from seatrial.campaign.trials import get_trials
        from seatrial.campaign.tuning import WHERE, check_filter

        trials = get_trials(campaign, watch)
        checks = check_filter(campaign, estimate_all(campaign, trials, watch)[0], trials)
        for check in checks:
            typer.echo(f"record {check.record.label}")
            typer.echo("\n".join(check.lines()))
        typer.echo(WHERE)
        return Exit.OK if all(check.tuned for check in checks) else Exit.ALARMS

    _with_campaign(folder, quiet, work)


@app.command()
def calibrate(
    folder: Folder,
    replicates: Annotated[
        int, typer.Option(min=20, max=100_000, help="How many truths are drawn and found again.")
    ] = 400,
    method: Annotated[
        str,
        typer.Option(help="adaptive-metropolis, metropolis, de-metropolis, nuts or tempered-smc."),
    ] = "adaptive-metropolis",
    quiet: Quiet = False,
) -> None:
    """Check that stated uncertainty is right: truths from the priors, data from them, and their ranks in the posteriors."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.calibrate import calibrate as run_calibration
        from seatrial.campaign.trials import get_trials
        from seatrial.report.calibration_picture import write_calibration_picture

        found = run_calibration(campaign, get_trials(campaign, watch), replicates, method, watch)
        typer.echo("\n".join(found.lines()))
        typer.echo(f"picture: {write_calibration_picture(campaign, found)}")
        return Exit.ALARMS if found.calibration.outside() else Exit.OK

    _with_campaign(folder, quiet, work)


@app.command()
def report(folder: Folder, quiet: Quiet = False) -> None:
    """Write report.html from the results; whatever is missing is computed first."""
    _with_campaign(folder, quiet, _run_and_report)


@app.command()
def run(folder: Folder, quiet: Quiet = False) -> None:
    """Run the whole loop, resuming where it stopped, and write report.html."""
    _with_campaign(folder, quiet, _run_and_report)


@app.command()
def paper(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="[DIR]", help="Folder of results; if not given, paper-A, paper-A-quick and so on."),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Items to reproduce, such as table-3,figure-6; all if not given. An unknown one lists them."),
    ] = None,
    reading: Annotated[
        str, typer.Option(help="How the paper's unprinted units are read: A (rev/s) or B (rad/s).")
    ] = "A",
    vehicle: Annotated[
        Path | None, typer.Option(help="TOML file of another surge vehicle to make the same study of.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Smaller samples: a look in one to two minutes.")] = False,
    quiet: Quiet = False,
) -> None:
    """Reproduce, check and judge every table, figure and claim of the paper seatrial starts from."""

    def work(watch: Any) -> Exit:
        from seatrial.campaign.paper.registry import chosen_items
        from seatrial.campaign.paper.run import check_folder, choose_vehicle, run_paper
        from seatrial.campaign.paper.study import FULL, QUICK
        from seatrial.report.paper.cards import verdict_words
        from seatrial.report.paper.page import write_paper

        chosen = choose_vehicle(reading, vehicle)
        items = chosen_items(only or [], chosen.is_paper)
        place = folder or Path("-".join(["paper", chosen.name, *(["quick"] if quick else [])]))
        check_folder(place, chosen)
        study, judged = run_paper(place, chosen, QUICK if quick else FULL, items, watch)
        width = max(len(item.key) for item in judged)
        for item in judged:
            verdict = verdict_words(item.verdict, chosen)
            typer.echo(f"{item.key:<{width}}  {verdict}" + (f", because {item.because}" if item.because else ""))
        if quick:
            typer.echo("smaller samples (--quick): Monte Carlo errors are several times those of the full study")
        typer.echo(f"report: {write_paper(study, judged)}")
        return Exit.OK

    _watched(quiet, work)


def _run_and_report(campaign: Any, watch: Any) -> Exit:
    from seatrial.campaign.loop import run_loop
    from seatrial.report.page import write_report

    outcome = run_loop(campaign, watch)
    summary = outcome.summary
    for row in summary["coefficients"]:
        typer.echo(f"  {row['name']:<16} {row['mean']:>12.5g} ± {row['sd']:<10.3g} {row['unit']}")
    for fit in summary["fits"]:
        if fit["held_back"]:
            typer.echo(
                f"  held-back run {fit['record']}: {fit['explained']:.0%} of the variance of {fit['channel']} explained"
            )
    for verdict in summary["verdicts"]:
        typer.echo(verdict)
    typer.echo(f"next: {summary['next_trial']['words']}")
    typer.echo(f"report: {write_report(outcome)}")
    return _finish(summary["alarms"], summary["cautions"])


def _say_trials(trials: Any) -> Exit:
    from seatrial.campaign.record_checks import record_cautions

    for record in (*trials.fit, *trials.predict):
        channels = f"{', '.join(record.controls)} -> {', '.join(record.measured)}"
        typer.echo(f"record {record.label}: {record.time.size} samples over {record.time[-1]:.1f} s; {channels}")
        for text in record_cautions(record):
            typer.echo(f"caution: {text}", err=True)
    return Exit.OK


def _finish(alarms: list[str], cautions: list[str]) -> Exit:
    for text in cautions:
        typer.echo(f"caution: {text}", err=True)
    for text in alarms:
        typer.echo(f"alarm: {text}", err=True)
    return Exit.ALARMS if alarms else Exit.OK


def _with_campaign(folder: Path, quiet: bool, work: Callable[[Any, Any], Exit]) -> None:
    from seatrial.campaign.load import load_campaign

    _watched(quiet, lambda watch: work(load_campaign(folder), watch))


def _watched(quiet: bool, work: Callable[[Any], Exit]) -> None:
    from seatrial.apps.console import ConsoleWatch

    watch = ConsoleWatch(quiet)
    signal.signal(signal.SIGINT, lambda *_: _stop(watch))
    with watch.watching():
        code = work(watch)
    if code is not Exit.OK:
        raise typer.Exit(int(code))


def _stop(watch: Any) -> None:
    """End at once: results are whole or absent and long work has checkpoints, so there is nothing to wait for."""
    from seatrial.core.files import discard_unfinished

    watch.bars.stop()
    discard_unfinished()
    watch.console.print("interrupted; run the same command again to resume")
    os._exit(Exit.INTERRUPTED)


def main() -> None:
    """Run the command line; errors meant for the user are printed without a traceback."""
    from seatrial.apps.console import fail

    try:
        app()
    except InputError as error:
        fail(str(error))
        sys.exit(Exit.BAD_INPUT)
    except NumericalError as error:
        fail(str(error))
        sys.exit(Exit.NUMERICAL)
    except SeatrialError as error:
        fail(str(error))
        sys.exit(Exit.BUG)
    except OSError as error:
        fail(str(_as_input_error(error)))
        sys.exit(Exit.BAD_INPUT)


def _as_input_error(error: OSError) -> InputError:
    return InputError(
        str(error.filename2 or error.filename or "file system"),
        found=error.strerror or str(error),
        expected="a place where files can be read and written",
        remedy="check the path, its permissions and the space left",
    )
