"""Messages about evidences and the choice between structures."""

from seatrial.core.findings import Finding
from seatrial.messages.entry import Entry, Remedy


def thresholds() -> dict[str, float]:
    """Return the limits that the entries name."""
    from seatrial.selection.method_agreement import MAX_JOINT_ERRORS

    return {"MAX_JOINT_ERRORS": MAX_JOINT_ERRORS}


ENTRIES = {
    "evidence-check-blunt": Entry(
        title="Check of an evidence too blunt",
        sentence="the verdict on {subject:and} would change if the evidence of {label} were wrong by {needed:.2g} nat; its check resolves "
        "{resolution:.2g} nat",
        meaning="A second method confirms the evidence, but with a larger error than the verdict allows.",
        decided="The probability of a term passes from one verdict to another within {MAX_JOINT_ERRORS:g} joint errors of the two methods.",
        example=Finding(
            "evidence-check-blunt",
            "caution",
            ("X_u",),
            {"label": "M-1", "resolution": 0.8, "needed": 0.4},
            ("sharpen-evidence",),
        ),
    ),
    "evidence-within-model": Entry(
        title="Probabilities within the model",
        sentence="the probabilities of models and terms hold only if the noise and everything stated are right",
        meaning="Evidences with every error need output error and records: with process noise, and of a density of one's own, they are "
        "those within the model. A slow error of a sensor, a wrong mass or a lag can then look like a term.",
        decided="The evidence with every error is not known for these models.",
        example=Finding("evidence-within-model", "caution"),
    ),
}
REMEDIES = {
    "sharpen-evidence": Remedy(
        command="raise `particles` or `repeats` of [selection]",
        python="raise `repeats`, or the particles of `smc`, of EvidenceSettings",
    ),
}
