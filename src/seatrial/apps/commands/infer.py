"""What the records say: coefficients, how well each is known, and the terms they support."""

from enum import StrEnum
from typing import Annotated, Any

import typer

from seatrial.apps.running import Exit, Folder, Quiet, finish, with_campaign


class By(StrEnum):
    """Ways to estimate."""

    CHAINS = "chains"
    MODE = "mode"
    EQUATION_ERROR = "equation-error"


def estimate(
    folder: Folder,
    by: Annotated[
        By,
        typer.Option(
            help="chains draw the whole posterior; mode and equation-error give first answers in about a second, which are not kept."
        ),
    ] = By.CHAINS,
    window: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help='With equation-error: smooth the speed over so long, such as "2 s", instead of using the channel udot.',
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Estimate the coefficients of every candidate structure."""

    def work(campaign: Any, watch: Any) -> Exit:
        _refuse_window(by, window)
        seconds = _seconds(window, "--window")
        return _by_chains(campaign, watch) if by is By.CHAINS else _first_answers(campaign, watch, by, seconds)

    with_campaign(folder, quiet, work)


def profile(
    folder: Folder,
    parameter: Annotated[
        list[str] | None, typer.Option(help="Parameter to profile; may be given several times. All if not given.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Profile the likelihood of the full structure: where the data alone allow each parameter to be, priors aside."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.profiles import profile_all
        from seatrial.campaign.trials import get_trials
        from seatrial.report.profile_picture import write_profile_picture

        found = profile_all(campaign, get_trials(campaign, watch), parameter or [], watch)
        typer.echo("\n".join(found.lines()))
        typer.echo(f"picture: {write_profile_picture(campaign, found)}")
        return Exit.OK

    with_campaign(folder, quiet, work)


def select(folder: Folder, quiet: Quiet = False) -> None:
    """Decide which terms the data support."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.choose import agreement_words, select_structure
        from seatrial.campaign.contenders import find_contenders
        from seatrial.campaign.screen import screening_of, with_shortlist
        from seatrial.campaign.trials import get_trials
        from seatrial.report.select_picture import write_select_picture

        trials = get_trials(campaign, watch)
        screened, cautions = screening_of(campaign, trials, watch)
        if screened is not None:
            typer.echo("\n".join(screened.lines()))
        campaign = with_shortlist(campaign, trials, watch)
        selection = select_structure(campaign, trials, watch)
        for structure, evidence, probability in zip(
            selection.structures, selection.evidences, selection.probability, strict=True
        ):
            value = f"log evidence {evidence.log_value:.3f} ± {evidence.std_error:.3f}"
            typer.echo(f"{structure.label}  {value}  probability {probability:.3f}  {' '.join(structure.terms)}")
            typer.echo(f"  {agreement_words(evidence)}")
        for verdict in selection.verdicts:
            typer.echo(verdict)
        contenders = find_contenders(campaign, selection, trials, watch)
        if contenders is not None:
            typer.echo("\n".join(contenders.lines(selection)))
        if screened is not None or contenders is not None:
            typer.echo(f"picture: {write_select_picture(campaign, selection, screened, contenders)}")
        never = [term for term in campaign.rules.never if term in campaign.source.structure.optional]
        if never:
            cautions = [*cautions, f"the rules leave out {', '.join(never)}: no structure has it"]
        return finish(list(selection.alarms), cautions)

    with_campaign(folder, quiet, work)


def criteria(
    folder: Folder,
    first: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help='Leave-future-out never predicts the first so long, such as "20 s"; a third of the longest record if not given.',
        ),
    ] = None,
    block: Annotated[
        str | None, typer.Option(metavar="TIME", help="Length of the blocks it predicts; a twentieth of the rest.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Compare the structures by every information criterion, by leave-future-out and by Savage-Dickey ratios."""

    def work(campaign: Any, watch: Any) -> Exit:
        from seatrial.campaign.choose import current_selection
        from seatrial.campaign.criteria import criteria_all, future_edges
        from seatrial.campaign.criteria_words import criteria_cautions, criteria_lines, nested_pairs
        from seatrial.campaign.estimate import estimate_all
        from seatrial.campaign.screen import with_shortlist
        from seatrial.campaign.trials import get_trials

        lengths = _seconds(first, "--first"), _seconds(block, "--block")
        trials = get_trials(campaign, watch)
        campaign = with_shortlist(campaign, trials, watch)
        future_edges(trials, *lengths)
        estimates = estimate_all(campaign, trials, watch)
        found = criteria_all(campaign, estimates, trials, *lengths, watch)
        typer.echo("\n".join(criteria_lines(found)))
        pairs = nested_pairs(campaign, estimates, trials, current_selection(campaign, trials))
        if pairs:
            typer.echo("Savage-Dickey, nats in favour of the term:")
        for pair in pairs:
            typer.echo(f"  {pair.line}")
        alarms = [text for item in estimates for text in item.alarms]
        alarms += [f"evidence and Savage-Dickey do not agree about {pair.line}" for pair in pairs if not pair.agrees]
        return finish(alarms, criteria_cautions(found))

    with_campaign(folder, quiet, work)


def _by_chains(campaign: Any, watch: Any) -> Exit:
    from seatrial.campaign.estimate import estimate_all
    from seatrial.campaign.known import known_after
    from seatrial.campaign.screen import with_shortlist
    from seatrial.campaign.trials import get_trials

    trials = get_trials(campaign, watch)
    campaign = with_shortlist(campaign, trials, watch)
    estimates = estimate_all(campaign, trials, watch)
    told = []
    for item in estimates:
        typer.echo(f"{item.structure.label}")
        for name in item.names:
            row = item.data.sel(parameter=name)
            typer.echo(f"  {name:<16} {float(row['mean']):>12.5g} ± {float(row['sd']):<10.3g} {row['unit'].values!s}")
        for name, label, mean, sd, unit in item.own_values():
            typer.echo(f"  {name} in run {label:<8} {mean:>9.5g} ± {sd:<10.3g} {unit}")
        known = known_after(campaign, item, trials)
        typer.echo("\n".join(known.lines()))
        told += known.verdict
    return finish(
        [f"{item.structure.label}: {text}" for item in estimates for text in item.alarms],
        [text for text in estimates[0].cautions if text not in told],
    )


def _first_answers(campaign: Any, watch: Any, by: By, window: float | None) -> Exit:
    from seatrial.campaign.first_answers import MODE, REGRESSION, posterior_modes, regressions
    from seatrial.campaign.screen import with_shortlist
    from seatrial.campaign.trials import get_trials

    trials = get_trials(campaign, watch)
    campaign = with_shortlist(campaign, trials, watch)
    answers = posterior_modes(campaign, trials, watch) if by is By.MODE else regressions(campaign, trials, window)
    for answer in answers:
        typer.echo("\n".join(answer.lines()))
    typer.echo(MODE if by is By.MODE else REGRESSION)
    return finish(
        [answer.alarm for answer in answers if answer.alarm], [answer.caution for answer in answers if answer.caution]
    )


def _seconds(text: str | None, option: str) -> float | None:
    """A time of the command line in seconds."""
    from seatrial.core.units import quantity

    return None if text is None else quantity(text, "s", option)


def _refuse_window(by: By, window: str | None) -> None:
    from seatrial.core.errors import InputError

    if window is not None and by is not By.EQUATION_ERROR:
        raise InputError(
            "--window",
            found=f"--by {by}",
            expected="--by equation-error, which smooths the speed",
            remedy="leave --window out",
        )
