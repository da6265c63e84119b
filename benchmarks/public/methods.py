"""All methods of the benchmark, by name. To add one, write a function that fits it (`benchmarks.public.method`) and add a line here."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.public.method import Fitted, Method, Problem, with_spread
from benchmarks.public.ours import fit_chosen, fit_ours
from benchmarks.public.peers import fit_n4sid, fit_sindy
from benchmarks.public.tasks import Stretch
from seatrial.core.errors import InputError, nearest
from seatrial.core.record import Record
from seatrial.estimation.prediction.acceleration_baseline import acceleration_baseline
from seatrial.estimation.prediction.baselines import BASELINES, Baseline

HISTORY = 30.0
"""Time before a stretch whose controls a baseline is given, s: delays reach back."""


def fit_accelerations(problem: Problem) -> Fitted:
    """Fit all terms that the campaign may have to smoothed accelerations; errors as `Baseline.fit`, and `NumericalError`."""
    campaign = problem.campaign
    return fit_baseline(acceleration_baseline(campaign.model(campaign.full)), problem)


def fit_baseline(baseline: Baseline, problem: Problem) -> Fitted:
    """Fit a baseline of `seatrial.estimation.prediction.baselines`; errors as `Baseline.fit`."""
    fitted = baseline.fit(problem.records, problem.channels, problem.controls)
    columns = [problem.channels.index(channel) for channel in fitted.channels]

    def means(record: Record, stretches: Sequence[Stretch]) -> np.ndarray:
        predicted = np.full((record.time.size, len(problem.channels)), np.nan)
        for begin, end in stretches:
            first = int(np.searchsorted(record.time, record.time[begin] - HISTORY))
            predicted[begin + 1 : end + 1, columns] = fitted.predict(_part(record, first, end), begin - first)[
                begin - first + 1 :
            ]
        return predicted

    return with_spread(problem, means, fitted.parameters)


def _part(record: Record, first: int, end: int) -> Record:
    there = slice(first, end + 1)
    return replace(
        record, time=record.time[there], control=record.control[there], measurement=record.measurement[there]
    )


METHODS = {
    one.name: one
    for one in (
        Method("ours", "the campaign of the set, by the posterior mode", True, fit_ours),
        Method(
            "ours-chosen",
            "the same, with the structure and the model of the error that predict fitted runs left out best",
            True,
            fit_chosen,
            is_slow=True,
        ),
        *(Method(name, one.words, False, partial(fit_baseline, one)) for name, one in BASELINES.items()),
        Method("accelerations", "least squares of accelerations, all terms of the campaign", False, fit_accelerations),
        Method("sindy", "sparse regression of the accelerations, by PySINDy", False, fit_sindy),
        Method("n4sid", "a linear subspace model, by nfoursid", False, fit_n4sid),
    )
}
"""Methods by name, in the order of the table."""


def choose(names: Sequence[str] | None) -> tuple[Method, ...]:
    """Return methods by their names, in the order of the table; all but slow ones if None.

    Raises:
        InputError: no such method.
    """
    for name in names or ():
        if name not in METHODS:
            raise InputError(
                f'method "{name}"',
                found="no such method",
                expected="one of " + ", ".join(METHODS),
                remedy=nearest(name, METHODS),
            )
    return tuple(one for one in METHODS.values() if (not one.is_slow if names is None else one.name in names))
