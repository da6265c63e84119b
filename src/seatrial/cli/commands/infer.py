"""Commands that fit and compare: coefficients, their precision, and the terms that the records support."""

from enum import StrEnum
from typing import Annotated, Any

import typer

from seatrial.cli.running import Answer, Exit, Folder, Quiet, of_campaign, with_campaign

MAX_LINES = 10  # Structures of which `estimate` prints one line


class By(StrEnum):
    """Ways to estimate."""

    CHAINS = "chains"
    MODE = "mode"
    EQUATION_ERROR = "equation-error"


def estimate(
    context: typer.Context,
    folder: Folder,
    by: Annotated[
        By,
        typer.Option(
            help="chains: sample the whole posterior. mode, equation-error: quick first answers without checks. "
            "A later campaign can use the mode by priors_from."
        ),
    ] = By.CHAINS,
    window: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help='With equation-error: smooth the speed by a window of this width, such as "2 s", instead of using the channel udot.',
        ),
    ] = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Print every structure in full, not only the most probable one.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Estimate the coefficients of every structure."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        _refuse_window(by, window)
        from seatrial.core.units import quantity

        seconds = None if window is None else quantity(window, "s", "--window")
        if by is By.CHAINS:
            return _by_chains(campaign, reporter, answer, verbose)
        return _first_answers(campaign, reporter, answer, by, seconds, verbose)

    with_campaign(folder, quiet, work, context)


def profile(
    context: typer.Context,
    folder: Folder,
    parameter: Annotated[
        list[str] | None, typer.Option(help="Parameter to profile; may be given several times. All if not given.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Show the range of each parameter by the data only."""

    def work(campaign: Any, reporter: Any, answer: Answer) -> Exit:
        from seatrial.campaign.workflow.steps import Workflow
        from seatrial.report.figure_files import write_profile_picture

        result = Workflow(campaign, reporter, parameters=parameter or []).get("profiles")
        answer.say("\n".join(result.lines()))
        answer.give_result(result)
        answer.wrote("picture", write_profile_picture(campaign.folder, campaign.name, campaign.truth, result))
        return Exit.OK

    with_campaign(folder, quiet, work, context)


@of_campaign
def select(campaign: Any, reporter: Any, answer: Answer) -> Exit:
    """Decide which terms the data support."""
    from seatrial.campaign.workflow.steps import Workflow
    from seatrial.campaign.workflow.whole_run import timed
    from seatrial.messages.structures import BEFORE_DATA, agreement_words, contenders_lines, screening_lines
    from seatrial.report.figure_files import write_select_picture

    flow = Workflow(campaign, reporter)
    with timed(flow, reporter, "selection"):
        screened, cautions = flow.get("screening")
        if screened is not None:
            answer.say("\n".join(screening_lines(screened)))
        campaign, selection = flow.get("candidates"), flow.get("selection")
    for row, evidence in zip(selection.rows, selection.evidences, strict=True):
        value = f"log evidence {row.log_evidence:.3f} ± {row.log_evidence_error:.3f}"
        if row.log_evidence_with_errors is not None:
            value += f", with every error {row.log_evidence_with_errors:.3f}"
        answer.say(f"{row.label}  {value}  probability {row.probability:.3f}  {' '.join(row.terms)}")
        answer.say(f"  {agreement_words(evidence, row.log_evidence_needed)}")
    if any(row.log_evidence_with_errors is not None for row in selection.rows):
        answer.say("probabilities use the evidences with every error that a ± contains")
    if len(selection.rows) > 1:
        answer.say(BEFORE_DATA[selection.structure_prior])
    for verdict in selection.verdicts:
        answer.say(verdict)
    answer.give_result(selection)
    contenders = flow.get("contenders")
    if contenders is not None:
        answer.say("\n".join(contenders_lines(contenders, selection)))
    if screened is not None or contenders is not None:
        answer.wrote("picture", write_select_picture(campaign, selection, screened, contenders))
    never = [term for term in campaign.rules.never if term in campaign.structure.optional]
    if never:
        cautions = [*cautions, f"the rules exclude {', '.join(never)}: no structure has it"]
    return answer.finish(list(selection.alarms), [*cautions, *selection.cautions])


@of_campaign
def criteria(campaign: Any, reporter: Any, answer: Answer) -> Exit:
    """Compare structures by AIC, BIC, WAIC and others."""
    from seatrial.campaign.selection.criteria import nested_pairs
    from seatrial.campaign.selection.evidence import current_selection
    from seatrial.campaign.workflow.steps import Workflow
    from seatrial.messages.criteria import criteria_cautions, criteria_lines, pair_line

    flow = Workflow(campaign, reporter)
    trials, campaign = flow.get("trials"), flow.get("candidates")
    estimates, result = flow.get("estimates"), flow.get("criteria")
    answer.say("\n".join(criteria_lines(result)))
    pairs = nested_pairs(campaign, estimates, trials, current_selection(campaign, trials))
    if pairs:
        answer.say("Savage-Dickey, nats in favour of the term:")
    for pair in pairs:
        answer.say(f"  {pair_line(pair)}")
    rows = [
        {
            "structure": one.structure.label,
            "criterion": name,
            "value": value.value,
            "error": value.error,
            "status": status,
        }
        for one in result
        for name, (value, status) in one.values().items()
    ]
    answer.give(criteria=rows, savage_dickey=pairs)
    alarms = [text for item in estimates for text in item.alarms]
    alarms += [f"evidence and Savage-Dickey do not agree about {pair_line(pair)}" for pair in pairs if not pair.agrees]
    return answer.finish(alarms, criteria_cautions(result))


@of_campaign
def crossvalidate(campaign: Any, reporter: Any, answer: Answer) -> Exit:
    """Predict each fitted run from the others, by each model."""
    from seatrial.campaign.workflow.steps import Workflow
    from seatrial.campaign.workflow.whole_run import timed
    from seatrial.messages.cross_validation import complaints, cross_validation_lines, disagreement

    flow = Workflow(campaign, reporter)
    with timed(flow, reporter, "cross_validation"):
        result = flow.get("cross_validation")
    answer.say("\n".join(cross_validation_lines(result)))
    answer.give_result(result)
    return answer.finish([*filter(None, [disagreement(result)])], complaints(result))


def _by_chains(campaign: Any, reporter: Any, answer: Answer, verbose: bool) -> Exit:
    from seatrial.campaign.config.taken_as_exact import taken_as_exact
    from seatrial.campaign.inference.coefficient_csv import write_coefficients
    from seatrial.campaign.inference.identifiability import known_after
    from seatrial.campaign.inference.judge_predictions import held_back_cautions, predict_held_back
    from seatrial.campaign.workflow.steps import Workflow
    from seatrial.campaign.workflow.whole_run import timed
    from seatrial.messages.render import sentence

    flow = Workflow(campaign, reporter)
    verdicts, held_back, structures, in_full = [], [], [], []
    with timed(flow, reporter, "estimates"):
        trials = _checked_trials(campaign, flow, answer)
        estimates = flow.get("estimates")
        for item in estimates:
            held_back.append(predict_held_back(flow.get("candidates"), item, trials))
            known = known_after(flow.get("candidates"), item, trials)
            verdicts += known.verdict
            words = [item.contains, *map(sentence, item.cause_findings)]
            structures.append({"estimate": item, "contains": words, "known": known, "held_back": held_back[-1].fits})
            in_full.append("\n".join([item.structure.label, *_lines_of(campaign, item, words, held_back[-1], known)]))
    candidates = flow.get("candidates")
    weights = [item.log_evidence_laplace + candidates.log_prior(item.structure) for item in estimates]
    rows = [
        (item.structure, item.log_evidence_laplace, weight, _state(item, one["known"]))
        for item, weight, one in zip(estimates, weights, structures, strict=True)
    ]
    _say_structures(answer, in_full, rows, verbose)
    exact = taken_as_exact(campaign)
    if exact:
        answer.say(exact)
    answer.give(by=By.CHAINS, structures=structures, taken_as_exact=exact)
    answer.wrote("coefficients", write_coefficients(campaign.folder, estimates, campaign.shown))
    alarms = [f"{item.structure.label}: {text}" for item in estimates for text in item.alarms]
    labels = [item.structure.label for item in estimates]
    unseen, doubts = _judge_unseen(answer, flow.get("baselines"), labels, weights, held_back)
    doubts += held_back_cautions(campaign.imports, trials)
    doubts += [f"{item.structure.label}: {text}" for item in estimates[1:] for text in item.at_bounds]
    return answer.finish(alarms + unseen, [*doubts, *(text for text in estimates[0].cautions if text not in verdicts)])


def _lines_of(campaign: Any, item: Any, contains: list[str], held_back: Any, known: Any) -> list[str]:
    """Return the printed lines of the posterior of one structure."""
    from seatrial.campaign.inference.judge_predictions import held_back_lines
    from seatrial.messages.effects import shares_text
    from seatrial.messages.known import known_lines
    from seatrial.messages.values import change_text, value_lines, value_text

    texts = {}
    for name in item.names:
        row, made_of = item.data.sel(parameter=name), shares_text(item.shares(name), item.causes.get(name, ""))
        unit = campaign.shown(name, str(row["unit"].values))
        texts[name] = value_text(float(row["mean"]), float(row["sd"]), unit, made_of)
    lines = [*value_lines(texts, item.structure.terms), *contains]
    for name, label, mean, sd, si in item.own_values():
        factor, unit = campaign.shown(name, si)
        lines.append(f"{name} in run {label:<8} {factor * mean:>9.5g} ± {factor * sd:<10.3g} {unit}")
    lines += [change_text(one, campaign.shown(one.name, one.unit)) for one in item.configuration_differences]
    return [*(f"  {line}" for line in (*lines, *held_back_lines(held_back))), *known_lines(known, campaign.shown)]


def _state(item: Any, known: Any) -> str:
    """Return in a few words whether a posterior can be used; alarms and cautions are printed below with their reasons."""
    if item.alarms:
        return "alarm, see below"
    if item.at_bounds:
        return "caution, see below"
    return "parameters are not known separately" if known.verdict else "chains converged"


def _say_structures(
    answer: Answer, in_full: list[str], rows: list[tuple[Any, float | None, float, str]], verbose: bool
) -> None:
    """Print the most probable structure in full and a line about each other one.

    Args:
        answer: prints.
        in_full: each structure; its first line begins with its label.
        rows: each structure, its log evidence by Laplace, None if it has none, that with its log prior, and its state.
        verbose: whether all are printed in full.
    """
    from seatrial.core.result_table import aligned
    from seatrial.messages.structures import change_words

    best, *others = sorted(range(len(rows)), key=lambda at: rows[at][2], reverse=True)
    (structure, highest, *_), terms = rows[best], rows[best][0].terms
    if verbose or highest is None or not others:
        answer.say("\n".join(in_full))
        return
    _, _, more = in_full[best].partition("\n")
    words = f"the most probable of {len(rows)} structures (log evidence by Laplace {highest:.2f})"
    answer.say(f"{structure.label}, {words}: {' '.join(terms)}\n{more}")
    lines = [
        (one.label, change_words(terms, one.terms), "" if value is None else f"{highest - value:.1f} nats", state)
        for one, value, _, state in (rows[at] for at in others[:MAX_LINES])
    ]
    left = len(others) - MAX_LINES
    answer.say("other structures, with the difference of log evidence and their state:")
    answer.say("\n".join(f"  {line}" for line in aligned(lines, left=(0, 1, 3))))
    answer.say(f"  {f'and {left} more; ' if left > 0 else ''}`--verbose` prints each in full")


def _checked_trials(campaign: Any, flow: Any, answer: Answer) -> Any:
    """Return the records, and print their faults and those of priors of earlier campaigns before the fit."""
    from seatrial.campaign.config.earlier_campaigns import lost_correlations
    from seatrial.campaign.data.check import record_doubts, step_cautions

    trials = flow.get("trials")
    doubts = (text for record in trials.fit for text in record_doubts(campaign, record))
    answer.caution(*doubts, *step_cautions(campaign, trials), *lost_correlations(campaign))
    return trials


def _first_answers(campaign: Any, reporter: Any, answer: Answer, by: By, window: float | None, verbose: bool) -> Exit:
    from seatrial.campaign.config.taken_as_exact import taken_as_exact
    from seatrial.campaign.inference.judge_predictions import held_back_cautions
    from seatrial.campaign.inference.quick_estimates import (
        MODE,
        REGRESSION,
        best_mode,
        keep_mode,
        posterior_modes,
        regressions,
    )
    from seatrial.campaign.workflow.steps import Workflow
    from seatrial.core.findings import Finding

    flow = Workflow(campaign, reporter)
    trials, campaign = _checked_trials(campaign, flow, answer), flow.get("candidates")
    answers = posterior_modes(campaign, trials, reporter) if by is By.MODE else regressions(campaign, trials, window)
    rows = [(one.structure, one.log_evidence, one.log_weight, one.state) for one in answers]
    _say_structures(answer, ["\n".join(one.lines()) for one in answers], rows, verbose)
    exact = taken_as_exact(campaign)
    answer.give(by=by, first_answers=[_first_answer(one) for one in answers if not one.alarm], taken_as_exact=exact)
    if exact:
        answer.say(exact)
    answer.say(MODE if by is By.MODE else REGRESSION)
    alarms = [one.alarm for one in answers if one.alarm]
    if by is By.MODE and len(alarms) < len(answers):
        keep_mode(campaign, trials, best_mode(answers))
    tested = [one for one in answers if one.held_back is not None]
    unseen, doubts = _judge_unseen(
        answer,
        flow.get("baselines") if tested else None,
        [one.structure.label for one in tested],
        [one.log_weight for one in tested],
        [one.held_back for one in tested],
    )
    doubts += held_back_cautions(campaign.imports, trials) if by is By.MODE else []
    of_answers = [text for one in answers for text in one.cautions]
    grave = [one for one in of_answers if isinstance(one, Finding) and one.level == "alarm"]
    return answer.finish([*alarms, *unseen, *grave], [*doubts, *(one for one in of_answers if one not in grave)])


def _first_answer(one: Any) -> dict[str, Any]:
    """Return one structure at first sight, each number by its name."""
    values = [
        {
            "name": name,
            "unit": unit,
            "by": way,
            "value": value,
            "sd": sd,
            "shares": one.shares.get(name),
            "cause": one.causes.get(name, ""),
        }
        for name, unit, pairs in one.rows
        for way, (value, sd) in zip(one.heads or ("mode",), pairs, strict=False)
    ]
    return {
        "label": one.structure.label,
        "terms": one.structure.terms,
        "values": values,
        "contains": one.contains,
        "log_evidence_laplace": one.log_evidence,
        "held_back": () if one.held_back is None else one.held_back.fits,
        "symmetry": one.symmetry,
    }


def _judge_unseen(
    answer: Answer, baselines: Any, labels: list[str], weights: list[float], held_back: list[Any]
) -> tuple[list[Any], list[str]]:
    """Print how the most probable structure compares with the baselines; return alarms and cautions about other runs."""
    from seatrial.campaign.inference.baselines import (
        compare_with_baselines,
        comparison_alarms,
        comparison_cautions,
        comparison_lines,
    )
    from seatrial.campaign.inference.judge_predictions import held_back_alarms

    if not labels:
        return [], []
    best = max(range(len(labels)), key=weights.__getitem__)
    which = labels[best] if len(labels) == 1 else f"{labels[best]}, the most probable"
    compared = compare_with_baselines(baselines, held_back[best].curves)
    lines = comparison_lines(baselines, compared)
    answer.give(baselines=compared)
    answer.say("\n".join([f"{which}, compared with baselines", *(f"  {line}" for line in lines)]))
    failed = held_back_alarms(held_back[best].fits, held_back[best].pooled)
    alarms = [f"{which}, {text}" for text in comparison_alarms(compared)] + [
        one.among(structure=which) for one in failed
    ]
    return alarms, [f"{which}, {text}" for text in comparison_cautions(compared)]


def _refuse_window(by: By, window: str | None) -> None:
    from seatrial.core.errors import InputError

    if window is not None and by is not By.EQUATION_ERROR:
        raise InputError(
            "--window",
            found=f"--by {by}",
            expected="--by equation-error, which smooths the speed",
            remedy="leave --window out",
        )
