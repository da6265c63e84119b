"""Commands before the trial: the motion of the priors, the most informative trial, the plan of all trials and its rehearsal."""

import shlex
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

import typer

from seatrial.cli.answer import Answer, Exit
from seatrial.cli.running import Folder, Quiet, of_campaign, with_campaign


@of_campaign
def prior(campaign: Any, reporter: Any, answer: Answer) -> Exit:
    """Show the speeds that the priors allow, before any data."""
    from seatrial.campaign.prior.cautions import file_cautions
    from seatrial.campaign.workflow.steps import Workflow
    from seatrial.core.signals import signal_unit
    from seatrial.messages.priors import prior_alarms, prior_cautions, prior_lines
    from seatrial.report.figure_files import write_prior_picture

    result = Workflow(campaign, reporter).get("prior")
    answer.say("\n".join(prior_lines(result, campaign.shown)))
    settled = result.settled
    answer.give(
        over=result.over,
        steady_speed=None if settled is None else _quantiles(settled.speed),
        time_constant=None if settled is None else _quantiles(settled.time_constant),
        diverging=float(result.diverged.mean()),
        channels=[
            {
                "channel": one.channel,
                "unit": signal_unit(one.channel),
                "lowest": float(one.bands[0].min()),
                "highest": float(one.bands[-1].max()),
                "measured_inside": one.held,
            }
            for one in result.channels
        ],
        priors=result.believed,
    )
    answer.wrote("picture", write_prior_picture(campaign.folder, campaign.name, result))
    return answer.finish(prior_alarms(result), [*file_cautions(campaign), *prior_cautions(result)])


def _quantiles(values: Any) -> list[float | None]:
    """Return the 5, 50 and 95 % quantiles of the finite values; None three times if there are none."""
    import numpy as np

    there = values[np.isfinite(values)]
    return [float(value) for value in np.quantile(there, (0.05, 0.5, 0.95))] if there.size else [None] * 3


def design(
    context: typer.Context,
    folder: Folder,
    free_form: Annotated[
        int,
        typer.Option(
            min=0,
            max=200,
            help="Also design a schedule without a fixed shape, with this many levels of equal length, for example 24.",
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
            help="Also choose this many different trials with the most information together, for example 3.",
        ),
    ] = 0,
    sensors: Annotated[
        bool,
        typer.Option("--sensors", help="Also compare the best design under other rates and noises of each sensor."),
    ] = False,
    search: Annotated[
        int,
        typer.Option(
            min=0, max=100_000, help="Also search between the points of the grid, by CMA-ES over this many designs."
        ),
    ] = 0,
    compare: Annotated[
        int,
        typer.Option(
            min=0,
            max=1000,
            help="Also check the ranking: simulate the expected information of this many designs (5 or more), for example 12.",
        ),
    ] = 0,
    quiet: Quiet = False,
) -> None:
    """Find the most informative trial inside the limits."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.data.simulate import own_lines
        from seatrial.campaign.prior.cautions import file_cautions
        from seatrial.campaign.store.stored_result import Store
        from seatrial.campaign.workflow.steps import Workflow
        from seatrial.messages.known import known_lines

        _check_options(campaign, free_form, self_oscillation, trials, search, compare)
        settings = {"levels": free_form, "together": trials, "budget": search, "designs": max(compare, 5)}
        flow = Workflow(campaign, reporter, **settings)
        designs = flow.get("design")
        first, *others = designs.lines()
        answer.say(f"best design: {first}; schedule in {Store(folder).schedule(Store(folder).design)}")
        for line in (*others, *filter(None, [designs.at_edge]), *designs.safety, *designs.prediction):
            answer.say(f"  {line}")
        promised = flow.get("promised")
        answer.say(f"expected precision of each coefficient of {promised.structure} at the prior means:")
        answer.say("\n".join(known_lines(promised, campaign.shown)))
        own = flow.get("own")
        if own is not None:
            answer.say("\n".join((*own.lines(campaign.shown), *own_lines(campaign, campaign.own_schedule))))
        best = list(map(designs.design, designs.sweeps))
        answer.give(designs=best, refused=designs.refused, coefficients=promised.parameters)
        answer.name_file("schedule", Store(folder).schedule(Store(folder).design))
        options = {
            _free_form: free_form,
            _self_oscillation: self_oscillation,
            _together: trials,
            _sensors: sensors,
            _searched: search,
            _compared: compare,
        }
        _each(answer, [partial(option, flow, answer) for option, wanted in options.items() if wanted])
        if not campaign.has_records:
            answer.say(
                f"after the trial, add its log to this campaign: `seatrial check {shlex.quote(str(folder))}` explains how"
            )
        return answer.finish([] if own is None else own.alarms, file_cautions(campaign))

    with_campaign(folder, quiet, work, context)


def plan(
    context: typer.Context,
    folder: Folder,
    vehicles: Annotated[
        int,
        typer.Option(
            min=0,
            max=10_000,
            help="Rehearse instead: count the simulated trials that the goal takes, for this many vehicles (2 or more) drawn from the "
            "priors, for example 20.",
        ),
    ] = 0,
    quiet: Quiet = False,
) -> None:
    """Plan all trials of a campaign within time and battery.

    It prints their order, the chance of meeting the goals, and the trial to drop first. After a trial it plans the rest from the posterior
    mode. With --vehicles it simulates trials of each vehicle until the goal is met: new designs, one design repeated, and random steps.
    """

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.workflow.steps import Workflow
        from seatrial.campaign.workflow.whole_run import timed

        if not vehicles:
            from seatrial.messages.designs import plan_lines

            with timed(Workflow(campaign), reporter, "plan"):
                trials = Workflow(campaign, reporter, so_far=_so_far(campaign, reporter)).get("plan")
            answer.say("\n".join(plan_lines(trials)))
            answer.give_result(trials)
            return answer.finish([], [])
        from seatrial.report.figure_files import write_rehearsal_picture

        flow = Workflow(campaign, reporter, vehicles=vehicles)
        with timed(flow, reporter, "rehearsal", of=str(vehicles)):
            rehearsal = flow.get("rehearsal")
        answer.say("\n".join(rehearsal.lines()))
        strategies = [
            {
                "name": name,
                "trials": rehearsal.trials_of(name).value,
                "trials_error": rehearsal.trials_of(name).error,
                "share_met": rehearsal.share_met(name)[0],
                "median_sd": rehearsal.median_sd(name),
            }
            for name in rehearsal.strategies
        ]
        size = {key: getattr(rehearsal, key) for key in ("vehicles", "most", "coefficients")}
        answer.give(**size, strategies=strategies)
        answer.wrote("picture", write_rehearsal_picture(campaign, rehearsal))
        return answer.finish(rehearsal.alarms(), [])

    with_campaign(folder, quiet, work, context)


def _so_far(campaign: Any, reporter: Any) -> Any:
    """Return the information of the records, by the mode; None if there are none yet."""
    from seatrial.campaign.design.plan import SoFar
    from seatrial.campaign.inference.quick_estimates import best_mode, posterior_modes
    from seatrial.campaign.workflow.steps import Workflow

    flow = Workflow(campaign, reporter)
    if campaign.imports is None and flow.state("trials") != "current":
        return None
    trials = flow.get("trials")
    candidates = flow.get("candidates")
    first = best_mode(posterior_modes(candidates, trials, reporter))
    return SoFar(first.drawn, trials.fit)


def _check_options(
    campaign: Any, free_form: int, self_oscillation: bool, trials: int, search: int, compare: int
) -> None:
    """Check the requirements of each option before any work."""
    from seatrial.campaign.design.problem import design_problem
    from seatrial.campaign.design.searches import relay_search
    from seatrial.design.batch import BatchSearch
    from seatrial.design.free_form import FreeFormSearch
    from seatrial.design.global_search import GlobalSearch
    from seatrial.design.measures import MeasureSearch

    problem = design_problem(campaign)
    for wanted, kind in (
        (free_form, FreeFormSearch),
        (trials, BatchSearch),
        (search, GlobalSearch),
        (compare, MeasureSearch),
    ):
        if wanted:
            kind(wanted).check(problem)
    if self_oscillation:
        relay_search(campaign)


def _each(answer: Answer, options: list[Callable[[], list[str]]]) -> None:
    """Print the results of each option; if one fails, the others run, and the command fails after them."""
    from seatrial.cli.console import fail
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


def _free_form(flow: Any, answer: Answer) -> list[str]:
    result, schedule = flow.get("free_form")
    answer.give(free_form=result)
    answer.name_file("free-form schedule", schedule)
    return [*result.lines(), f"schedule: {schedule}"]


def _self_oscillation(flow: Any, answer: Answer) -> list[str]:
    from seatrial.report.figure_files import write_relay_picture

    test, schedule = flow.get("relay")
    answer.give(self_oscillation=test)
    answer.name_file("self-oscillation schedule", schedule)
    return [*test.lines(), f"expected schedule: {schedule}; picture: {write_relay_picture(flow.campaign, test)}"]


def _together(flow: Any, answer: Answer) -> list[str]:
    from seatrial.messages.designs import batch_lines

    result = flow.get("batch")
    answer.give(batch=result)
    return batch_lines(result)


def _sensors(flow: Any, answer: Answer) -> list[str]:
    from seatrial.messages.designs import sensor_lines

    result = flow.get("sensors")
    answer.give(sensors=result)
    return sensor_lines(result)


def _searched(flow: Any, answer: Answer) -> list[str]:
    from seatrial.messages.designs import search_lines

    result, family, schedule = flow.get("searched")
    answer.give(searched=result)
    answer.name_file("searched schedule", schedule)
    return [*search_lines(result, family), f"schedule: {schedule}"]


def _compared(flow: Any, answer: Answer) -> list[str]:
    result = flow.get("measures")
    answer.give(rankings=result.agreements)
    return result.lines()
