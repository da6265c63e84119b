"""Words that a reader may not know, each with its meaning; the same texts as in docs/glossary.md."""

from typing import NamedTuple


class Word(NamedTuple):
    """One word.

    Attributes:
        forms: regular expression of its forms in a sentence.
        meaning: in one or more sentences, as the glossary has it.
    """

    forms: str
    meaning: str


GLOSSARY = {
    "band": Word(
        "bands?",
        "the interval that should contain a stated share of the measurements. The share is 90 % unless "
        "another is named.",
    ),
    "baseline": Word("baselines?", "a simple method, such as a first-order lag, that predicts the same runs."),
    "coverage": Word("coverage", "the share of true values, or of measurements, inside their intervals."),
    "CRPS": Word(
        "CRPS",
        "continuous ranked probability score of a prediction with its band, in the unit of the channel; lower "
        "is better. Without a band it is the mean absolute error.",
    ),
    "effective draws": Word(
        "effective (?:samples|draws)",
        "the number of independent draws with the same information as the correlated ones.",
    ),
    "evidence": Word(
        "evidences?",
        "the probability density of the data under a model, averaged over its priors. The ratio of two "
        "evidences, times the prior odds, gives the odds between two models.",
    ),
    "held-back run": Word("held[ -]back", "a run that is not fitted, kept to test predictions."),
    "k-hat": Word(
        "k-hat", "the Pareto shape of importance weights. Above 0.7 the result of importance sampling is not reliable."
    ),
    "mode": Word(
        "modes?",
        "the most probable values of the coefficients. A fit of the mode is quick; its ± is that of a normal "
        "distribution.",
    ),
    "model": Word(
        "models?|structures?", "one set of terms. M-0, M-1 and so on are labels. Usually M-0 has every optional term."
    ),
    "nat": Word(
        "nats?",
        "the unit of information and of log evidence. A difference of 1 nat is odds of 2.7 to 1, 3 nats are "
        "20 to 1, 5 nats are 150 to 1. One nat of information in one coefficient divides its ± by 2.7.",
    ),
    "posterior": Word("posteriors?", "the distribution of the coefficients after the data: prior times likelihood."),
    "prior": Word("priors?", "the distribution of a coefficient before the data."),
    "R-hat": Word("R-hat", "compares chains with one another. Above 1.01 they do not agree yet."),
    "ridge": Word("ridges?", "the line along which coefficients can change together while the fit hardly changes."),
    "trim": Word("trim", "the steady state about which the vehicle works, such as 1.5 m/s at 1200 rpm."),
}
"""Words by their entry in the glossary."""
