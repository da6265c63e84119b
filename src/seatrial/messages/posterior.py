"""Messages about posteriors: the step of the simulation, priors, and what the data determine."""

from collections.abc import Mapping
from typing import Any

from seatrial.core.findings import Finding
from seatrial.messages.entry import Entry, Remedy, listed


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.estimation.posterior.step_shift import MIN_SHIFT

    return {"MIN_SHIFT": MIN_SHIFT}


def _moved(values: Mapping[str, Any]) -> str:
    moved = [f"{name} by {shift:+.1f} sd" for name, shift in zip(values["subject"], values["shifts"], strict=True)]
    more = values["more"]
    text = ", ".join(moved) + f" and {more} more" if more else listed(moved)
    return "the simulation's steps of {step:.2g} s are too long: steps half as long move " + text


ENTRIES = {
    "steps-too-long": Entry(
        title="Simulation steps too long",
        sentence=_moved,
        meaning="The error of the integration is as large as the stated standard deviations, which do not contain it.",
        decided="About the mode, the sensors are simulated again in steps half as long, and one linear step of the posterior gives "
        "the shift of each parameter. Reported from {MIN_SHIFT:g} standard deviation: below that the ± covers it.",
        example=Finding(
            "steps-too-long",
            "caution",
            ("X_u", "X_uabsu"),
            {"shifts": (-2.4, 1.3), "more": 0, "step": 0.1, "shorter": 0.025},
            ("shorter-step",),
        ),
    ),
}
REMEDIES = {
    "shorter-step": Remedy(
        command='set step = "{shorter:.2g} s" under [import]',
        python="read the log again with step={shorter:.2g}",
        page="set the step to {shorter:.2g} s under Import",
    ),
}
