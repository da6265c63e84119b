"""Before the trial: a campaign file, what its priors mean, the most informative trial."""

from typing import Annotated, Any

import typer

from seatrial.apps.running import Exit, Folder, Quiet, finish, with_campaign


def init(
    folder: Folder,
    template: Annotated[
        str, typer.Option(help="Campaign to begin from: remus100 (simulated) or log (a CSV log).")
    ] = "remus100",
) -> None:
    """Write a campaign file to begin from."""
    from seatrial.campaign.templates import init_campaign

    typer.echo(f"wrote {init_campaign(folder, template)}; edit it, then: seatrial run {folder}")


def prior(folder: Folder, quiet: Quiet = False) -> None:
    """Show what the priors mean in metres per second, before any data are used."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.prior_predictive import predict_from_prior
        from seatrial.campaign.prior_words import prior_alarms, prior_cautions, prior_lines
        from seatrial.report.prior_picture import write_prior_picture

        found = predict_from_prior(campaign, watch)
        typer.echo("\n".join(prior_lines(found)))
        typer.echo(f"picture: {write_prior_picture(campaign, found)}")
        return finish(prior_alarms(found), prior_cautions(found))

    with_campaign(folder, quiet, work)


def design(
    folder: Folder,
    free_form: Annotated[
        int, typer.Option(min=0, max=200, help="Also search so many levels one by one, by gradients.")
    ] = 0,
    self_oscillation: Annotated[
        bool,
        typer.Option("--self-oscillation", help="Also choose the self-oscillating test (zigzag) of [design.relay]."),
    ] = False,
    trials: Annotated[
        int, typer.Option(min=0, max=20, help="Also choose so many trials that are worth most together.")
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
            min=0, max=1000, help="Also compute the expected information gain of so many designs, 5 at least."
        ),
    ] = 0,
    quiet: Quiet = False,
) -> None:
    """Find the most informative trial of the families, inside the limits."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.designs import design_first
        from seatrial.campaign.known import known_before
        from seatrial.campaign.store import Store

        designs = design_first(campaign, watch)
        first, *others = designs.lines()
        typer.echo(f"best design: {first}; schedule in {Store(folder).schedule(Store(folder).design)}")
        for line in (*others, *designs.safety, *designs.prediction):
            typer.echo(f"  {line}")
        promised = known_before(campaign, designs.best)
        typer.echo(f"what it would tell about each coefficient of {promised.structure} at the prior means:")
        typer.echo("\n".join(promised.lines()))
        if free_form:
            from seatrial.campaign.free_trial import design_free_trial

            found, schedule = design_free_trial(campaign, free_form, watch)
            typer.echo("\n".join(found.lines()))
            typer.echo(f"schedule: {schedule}")
        if self_oscillation:
            from seatrial.campaign.relay_trial import design_relay_trial
            from seatrial.report.relay_picture import write_relay_picture

            test, schedule = design_relay_trial(campaign, watch)
            typer.echo("\n".join(test.lines()))
            typer.echo(f"schedule as foreseen: {schedule}; picture: {write_relay_picture(campaign, test)}")
        if trials:
            from seatrial.campaign.batch_trial import plan_together

            typer.echo("\n".join(plan_together(campaign, trials, watch).lines()))
        if sensors:
            from seatrial.campaign.sensor_table import sensor_table

            typer.echo("\n".join(sensor_table(campaign, watch).lines()))
        if search:
            from seatrial.campaign.global_trial import search_design

            searched, family, schedule = search_design(campaign, search, watch)
            typer.echo("\n".join(searched.lines(family)))
            typer.echo(f"schedule: {schedule}")
        if compare:
            from seatrial.campaign.measures import compare_measures

            typer.echo("\n".join(compare_measures(campaign, max(compare, 5), watch).lines()))
        return Exit.OK

    with_campaign(folder, quiet, work)
