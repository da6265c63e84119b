"""Messages about Markov chains: whether their draws may be used."""

from collections.abc import Mapping
from typing import Any

from seatrial.core.findings import Finding
from seatrial.messages.entry import Entry, Remedy


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.sampling.diagnostics import MAX_R_HAT, MIN_ESS

    return {"MAX_R_HAT": MAX_R_HAT, "MIN_ESS": MIN_ESS}


def _stuck(values: Mapping[str, Any]) -> str:
    named = ", ".join(map(str, values["stuck"][:5])) + (", ..." if len(values["stuck"]) > 5 else "")
    return (
        f"{len(values['stuck'])} of {{chains}} chains never moved in {{kept}} draws (chain {named}): the density is broken at their "
        "start, or the proposal is far too wide"
    )


def _more(values: Mapping[str, Any]) -> str:
    ratio = values["more"]
    return f"ask for more draws, {'twice' if ratio <= 2 else f'{int(-(-ratio // 1))} times'} as many"


ENTRIES = {
    "chains-still": Entry(
        title="Chains that never moved",
        sentence="the chains of {subject:and} never moved: the proposal is far too wide or the density is flat or broken",
        meaning="All draws are the same value, which states no uncertainty.",
        decided="Rank R-hat is not a number.",
        example=Finding("chains-still", "alarm", ("X_u",), {}, ("check-prior-and-data",)),
    ),
    "chains-disagree": Entry(
        title="Chains that disagree",
        sentence="the chains disagree about {subject:and} (R-hat {r_hat:.3f}, at most {limit})",
        meaning="Each chain explored another part of the posterior, so that their mean and spread are wrong.",
        decided="Rank R-hat exceeds {MAX_R_HAT} (Vehtari et al., Bayesian Analysis 16, 2021).",
        example=Finding("chains-disagree", "alarm", ("X_u",), {"r_hat": 1.05, "limit": 1.01}, ("longer-chains",)),
    ),
    "draws-too-few": Entry(
        title="Too few independent draws",
        sentence="too few independent draws of {subject:and} ({effective:.0f} effective, at least {limit:.0f})",
        meaning="Mean and interval of these parameters have a Monte Carlo error that is not small.",
        decided="The effective sample size of the centre or of the tails is below {MIN_ESS:.0f} (the same source).",
        example=Finding(
            "draws-too-few", "alarm", ("X_u",), {"effective": 90.0, "limit": 400.0, "more": 4.5}, ("more-draws",)
        ),
    ),
    "chains-stuck": Entry(
        title="Some chains never moved",
        sentence=_stuck,
        meaning="A chain that never moves has the same weight as the others and shifts every mean.",
        decided="All draws of a chain are the same.",
        example=Finding("chains-stuck", "alarm", (), {"stuck": (3,), "chains": 32, "kept": 200}, ("warm-up-longer",)),
    ),
    "transitions-diverged": Entry(
        title="Divergent transitions",
        sentence="{diverged} of {transitions} transitions diverged: the density has an edge or a narrow neck that the sampler may not have "
        "entered",
        meaning="The part of the posterior beyond the edge or neck is missing in the draws.",
        decided="The No-U-Turn sampler counts trajectories whose energy error is too large, after warm-up.",
        example=Finding(
            "transitions-diverged", "alarm", (), {"diverged": 3, "transitions": 6000}, ("another-sampler",)
        ),
    ),
}
REMEDIES = {
    "check-prior-and-data": Remedy(command="check the prior and the data"),
    "longer-chains": Remedy(
        command="double warm-up and draws; if the chains still disagree, look for two separate explanations of the data"
    ),
    "more-draws": Remedy(command=_more),
    "warm-up-longer": Remedy(command="warm up longer, or use another sampler"),
    "another-sampler": Remedy(command="use adaptive Metropolis, or a prior that excludes this edge or neck"),
}
