"""Runs left out in turn, in words: the structure and model of the error that predict them best, and whether the evidence agrees."""

from seatrial.core.result_table import aligned
from seatrial.messages.render import sentence, statement
from seatrial.selection.cross_validation import Candidate, CrossValidation, gap


def cross_validation_lines(result: CrossValidation) -> list[str]:
    """Return the headline, then the table."""
    note = "differences to the best: log predictive density of runs or blocks left out, nats, ± its standard error"
    if not result.found:
        return []
    table = aligned([heads(result), *rows(result)], left=(0, 1, -1))
    return [*headline(result), *(f"    {line}" for line in new_lines(result)), note, *table]


def new_lines(result: CrossValidation) -> list[str]:
    """Return the lines for the campaign file that make the recommended setting, of each other model of the error once."""
    lines = {one.error_model: one.lines for one in (result.chosen, result.whole_run) if one and one.lines}
    return [line for name, own in lines.items() for line in (*([f"# error {name}"] * (len(lines) > 1)), *own)]


def headline(result: CrossValidation) -> list[str]:
    """Return the recommendation, its reason, and the findings."""
    chosen, whole = result.chosen, result.whole_run
    if chosen is None or whole is None:
        return []
    best, parts = result.ordered[0], len(result.runs)
    apart = gap(best, chosen)
    why = (
        "it predicts best"
        if best is chosen
        else f"{best.name} is better by {apart.delta:.1f} ± {apart.std_error:.1f} nats, which {parts} parts cannot resolve"
    )
    lines = [*filter(None, [disagreement(result)])]
    if whole is chosen:
        lines.append(f"recommended: {_whole_name(chosen)}: {why}")
    else:
        closer = result.closer(whole, chosen)
        smaller = (
            f"its CRPS is {closer.delta:.0%} ± {closer.std_error:.0%} smaller"
            if not chosen.diverges
            else "it does not diverge"
        )
        lines.append(f"recommended for forecasts from now: {_whole_name(chosen)}: {why}")
        lines.append(f"recommended for predictions of a whole run: {_whole_name(whole)}: {smaller}")
    lines += [
        f"{one.name}, each left out in turn: {bands.level}; {sentence(bands.verdict)}"
        for one in (chosen, *([] if whole is chosen else [whole]))
        for bands in one.result.bands.values()
    ]
    better = [one for one in result.findings if one.code == "error-model-better"]
    return lines + [f"{statement(one)}; put into campaign.toml:" for one in better]


def _whole_name(one: Candidate) -> str:
    return f"{one.structure.label} ({' '.join(one.structure.terms)}), error {one.error_model}"


def disagreement(result: CrossValidation) -> str:
    """Return where runs left out contradict the evidence; empty if they do not."""
    return next((sentence(one) for one in result.findings if one.level == "alarm"), "")


def complaints(result: CrossValidation) -> list[str]:
    """Return cautions, unreliable candidates and refused ones."""
    cautions = [sentence(one) for one in result.findings if one.level == "caution"]
    cautions += [f"{one.name}: {one.result.status}" for one in result.found if one.result.status]
    return cautions + [f"{one.name}: {one.refused}" for one in result.candidates if one.refused]


def rows(result: CrossValidation) -> list[tuple[str, ...]]:
    """Return the table, best first, as text: see `heads`."""
    if result.stack is None:
        return []
    return [
        (
            member.model,
            member.error_model,
            f"{member.weight:.2f}",
            "diverges" if one.diverges else f"{member.crps:.2f}",
            "best" if member.delta == 0.0 else f"{member.delta:+.1f} ± {member.std_error:.1f}",
            *(
                text
                for channel in one.result.bands
                for text in (
                    f"{one.result.mean_crps(channel):.3g}",
                    f"{one.result.mean_score(channel, 'coverage_50'):.0%}",
                    f"{one.result.mean_score(channel, 'coverage'):.0%}",
                )
            ),
            f"{one.result.k_hat:.2f}",
            f"{member.probability:.3f}",
            " ".join(one.structure.terms),
        )
        for one, member in zip(result.ordered, result.stack.members, strict=True)
    ]


def heads(result: CrossValidation) -> tuple[str, ...]:
    """Return the heads of the table."""
    columns = [text for name in result.found[0].result.bands for text in (f"CRPS {name}", f"{name} in 50 %", "in 90 %")]
    return ("model", "error model", "weight", "whole run", "elpd", *columns, "k-hat", "probability", "terms")
