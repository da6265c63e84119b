"""Runs left out in turn, in words: which structure and model of the error predicts them, and whether the evidence agrees."""

from seatrial.core.result_table import aligned
from seatrial.messages.render import sentence
from seatrial.selection.cross_validation import SMALL, CrossValidation, Gap, gap, paired


def cross_validation_lines(result: CrossValidation) -> list[str]:
    """Return the headline, then the table."""
    note = "differences to the best: log predictive density of the runs left out, nats, ± the standard error over runs"
    added = [] if result.recommended is None else [f"    {line}" for line in result.recommended.lines]
    table = aligned([heads(result), *rows(result)], left=(0, 1, -1))
    return [*headline(result), *added, note, *table, *_derived_priors(result)]


def headline(result: CrossValidation) -> list[str]:
    """Return what matters most, first."""
    likely, better = result.likely, result.recommended
    lines = [
        disagreement(result) or _agreement(result),
        *(
            f"{likely.name}, each run left out in turn: {bands.level}; {sentence(bands.verdict)}"
            for bands in likely.result.bands.values()
        ),
    ]
    if better is not None:
        lines.append(
            f'error model "{better.error_model}" ({better.words}) predicts runs left out better than the campaign\'s own by '
            f"{_nats(gap(better, result.own_best))} nats; put into campaign.toml:"
        )
    elif len(result.found) > len(result.own):
        lines.append("no other model of the error predicts runs left out clearly better than the campaign's own")
    return lines


def disagreement(result: CrossValidation) -> str:
    """Say where the structure that the evidence prefers predicts runs left out clearly worse than another; empty where not."""
    if len(result.own) < 2:
        return ""
    chosen, better, reasons = result.likely, result.own_best, []
    apart = gap(better, chosen)
    if better is not chosen and apart.is_clear(SMALL):
        reasons.append(f"{better.name} predicts runs left out better by {_nats(apart)} nats")
    for channel in chosen.result.bands:
        crps = chosen.result.mean_crps(channel)
        other = min(result.own, key=lambda one, channel=channel: one.result.mean_crps(channel))
        closer = paired(chosen.result.crps(channel), other.result.crps(channel), mean=True)  # SI
        if other is not chosen and closer.is_clear():
            reasons.append(
                f"{other.name} simulates {channel} of runs left out more closely: the mean CRPS of {chosen.name}, "
                f"{crps:.3g}, is larger by {closer.delta:.2g} ± {closer.std_error:.2g}"
            )
    if not reasons:
        return ""
    return (
        f"evidence and held-back score disagree: {chosen.name} ({' '.join(chosen.structure.terms)}) has probability "
        f"{result.probability(chosen):.3f} by its evidence, but {'; and '.join(reasons)}: do not rely on that probability"
    )


def complaints(result: CrossValidation) -> list[str]:
    """Return what is not to be trusted."""
    lines = [f"{one.name}: {one.result.status}" for one in result.found if one.result.status]
    return [*result.cautions, *lines, *(f"{one.name}: {one.refused}" for one in result.candidates if one.refused)]


def rows(result: CrossValidation) -> list[tuple[str, ...]]:
    """Return the table: structure, error model, difference, CRPS, coverages and k-hat, best first, as text."""
    ordered = sorted(result.found, key=lambda one: -one.total)
    return [
        (
            one.structure.label,
            one.error_model,
            "best" if one is ordered[0] else f"{(apart := gap(one, ordered[0])).delta:+.1f} ± {apart.std_error:.1f}",
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
            f"{result.probability(one):.3f}",
            " ".join(one.structure.terms),
        )
        for one in ordered
    ]


def heads(result: CrossValidation) -> tuple[str, ...]:
    """Return the heads of the table."""
    columns = [text for name in result.found[0].result.bands for text in (f"CRPS {name}", f"{name} in 50 %", "in 90 %")]
    return ("model", "error model", "elpd", *columns, "k-hat", "probability", "terms")


def _agreement(result: CrossValidation) -> str:
    if len(result.own) < 2:
        return "one structure: evidence and held-back score have nothing to disagree about"
    chosen, better = result.likely, result.own_best
    if chosen is better:
        return f"{chosen.name} has the highest evidence and predicts runs left out best"
    return (
        f"{chosen.name} has the highest evidence; {better.name} predicts runs left out better by {_nats(gap(better, chosen))} nats; "
        f"with {len(result.runs)} runs this may be chance"
    )


def _derived_priors(result: CrossValidation) -> list[str]:
    """Return the priors that were derived from the data, of each model of the error once."""
    by_name = {}
    for one in result.found:
        added = [line for line in one.lines[1:] if "= " in line or line.startswith("[prior")]
        if any(line.startswith("[prior") for line in added):
            by_name.setdefault(
                one.error_model, f"priors of {one.structure.label}, {one.error_model}: {'; '.join(added)}"
            )
    return [f"not stated, so derived from the size of the data: {text}" for text in by_name.values()]


def _nats(apart: Gap) -> str:
    return f"{apart.delta:.1f} ± {apart.std_error:.1f}"
