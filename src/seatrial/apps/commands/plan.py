"""Before the trial: a campaign file, what its priors mean, the most informative trial."""

from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

import typer

from seatrial.apps.running import Answer, Exit, Folder, Quiet, with_campaign


def init(
    folder: Folder,
    template: Annotated[
        str,
        typer.Option(
            help="Campaign to begin from: remus100 (simulated), design or steering (no data yet), log (a CSV log)."
        ),
    ] = "remus100",
) -> None:
    """Write a campaign file to begin from."""
    from seatrial.campaign.config.templates import TEMPLATES, init_campaign

    path = init_campaign(folder, template)
    typer.echo(f"wrote {path}: {TEMPLATES[template]}")
    typer.echo(f"edit it, then: seatrial {'run' if template in ('remus100', 'log') else 'design'} {folder}")
    for name, meaning in TEMPLATES.items():
        if name != template:
            typer.echo(f"instead, --template {name}: {meaning}")


def prior(context: typer.Context, folder: Folder, quiet: Quiet = False) -> None:
    """Show what the priors mean in metres per second, before any data are used."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.prior.summary import prior_alarms, prior_cautions, prior_lines
        from seatrial.campaign.workflow.steps import Workflow
        from seatrial.report.figure_files import write_prior_picture

        found = Workflow(campaign, reporter).get("prior")
        answer.say("\n".join(prior_lines(found)))
        answer.say(f"picture: {write_prior_picture(campaign.folder, campaign.name, found)}")
        return answer.finish(prior_alarms(found), prior_cautions(found))

    with_campaign(folder, quiet, work, context)


def design(
    context: typer.Context,
    folder: Folder,
    free_form: Annotated[
        int,
        typer.Option(
            min=0,
            max=200,
            help="Also make a schedule of no fixed shape: so many levels of equal length, each sought by itself, for example 24.",
        ),
    ] = 0,
    self_oscillation: Annotated[
        bool,
        typer.Option("--self-oscillation", help="Also choose the self-oscillating test (zigzag) of [design.relay]."),
    ] = False,
    trials: Annotated[
        int,
        typer.Option(
            min=0,
            max=20,
            help="Also choose a batch of so many different trials that tell most together, for example 3.",
        ),
    ] = 0,
    sensors: Annotated[
        bool, typer.Option("--sensors", help="Also weigh the best design with other rates and noises of each sensor.")
    ] = False,
    search: Annotated[
        int,
        typer.Option(
            min=0, max=100_000, help="Also search between the points of the grid, by CMA-ES over so many designs."
        ),
    ] = 0,
    compare: Annotated[
        int,
        typer.Option(
            min=0,
            max=1000,
            help="Also check the ranking: simulate the expected information gain of so many designs (5 or more), for example 12.",
        ),
    ] = 0,
    quiet: Quiet = False,
) -> None:
    """Find the most informative trial of the families, inside the limits."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.store.stored_result import Store
        from seatrial.campaign.workflow.steps import Workflow

        _check_options(campaign, free_form, self_oscillation, trials, search, compare)
        settings = {"levels": free_form, "together": trials, "budget": search, "designs": max(compare, 5)}
        flow = Workflow(campaign, reporter, **settings)
        designs = flow.get("design")
        first, *others = designs.lines()
        answer.say(f"best design: {first}; schedule in {Store(folder).schedule(Store(folder).design)}")
        for line in (*others, *designs.safety, *designs.prediction):
            answer.say(f"  {line}")
        promised = flow.get("promised")
        answer.say(f"what it would tell about each coefficient of {promised.structure} at the prior means:")
        answer.say("\n".join(promised.lines()))
        options = {
            _free_form: free_form,
            _self_oscillation: self_oscillation,
            _together: trials,
            _sensors: sensors,
            _searched: search,
            _compared: compare,
        }
        _each(answer, [partial(option, flow) for option, wanted in options.items() if wanted])
        if not campaign.has_records:
            answer.say(f"after the trial its log goes on with this campaign: `seatrial check {folder}` says how")
        return Exit.OK

    with_campaign(folder, quiet, work, context)


def _check_options(
    campaign: Any, free_form: int, self_oscillation: bool, trials: int, search: int, compare: int
) -> None:
    """Look for what each option needs before any work."""
    from seatrial.campaign.design.evaluate import check_whole_trials
    from seatrial.campaign.design.free_form import check_free_trial
    from seatrial.campaign.design.global_search import check_search
    from seatrial.campaign.design.relay import check_relay

    if free_form:
        check_free_trial(campaign)
    if self_oscillation:
        check_relay(campaign)
    if trials:
        check_whole_trials(campaign, "--trials")
    if search:
        check_search(campaign, search)
    if compare:
        check_whole_trials(campaign, "--compare", joules=True)


def _each(answer: Answer, options: list[Callable[[], list[str]]]) -> None:
    """Print what each option finds; one that fails does not keep the others from running, and ends the command after them."""
    from seatrial.apps.console import fail
    from seatrial.core.errors import SeatrialError

    failed = []
    for option in options:
        try:
            answer.say("\n".join(option()))
        except SeatrialError as error:
            failed.append(error)
    for error in failed[:-1]:
        fail(str(error))
    if failed:
        raise failed[-1]


def _free_form(flow: Any) -> list[str]:
    found, schedule = flow.get("free_form")
    return [*found.lines(), f"schedule: {schedule}"]


def _self_oscillation(flow: Any) -> list[str]:
    from seatrial.report.figure_files import write_relay_picture

    test, schedule = flow.get("relay")
    return [*test.lines(), f"schedule as foreseen: {schedule}; picture: {write_relay_picture(flow.campaign, test)}"]


def _together(flow: Any) -> list[str]:
    return flow.get("batch").lines()


def _sensors(flow: Any) -> list[str]:
    return flow.get("sensors").lines()


def _searched(flow: Any) -> list[str]:
    from seatrial.campaign.design.global_search import search_lines

    found, family, schedule = flow.get("searched")
    return [*search_lines(found, family), f"schedule: {schedule}"]


def _compared(flow: Any) -> list[str]:
    return flow.get("measures").lines()
