"""Our own entries: the campaign of the set, estimated by the posterior mode, and predicted with draws about it.

`fit_ours` takes the campaign as it stands and, of several candidate structures, the one of the largest evidence by Laplace. `fit_chosen`
takes the structure and the model of the error that predict fitted runs best, each left out in turn.

Beside the mode stand the coefficients that fit the accelerations (`acceleration_baseline`), an estimate of the same terms by another
method. A whole run is simulated with draws about the mode and with these, each as often as they predict the fitted runs well. A stretch,
and one step, are forecast with both by the measurements so far (`seatrial.estimation.prediction.forecast`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.public.method import Fitted, Predicted, Problem
from benchmarks.public.tasks import Stretch
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.inference.cross_validation import best_campaign, cross_validate
from seatrial.campaign.inference.posterior import first_sd, initial_state
from seatrial.campaign.inference.quick_estimates import draw_about_mode
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.record import Record
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.prediction.acceleration_baseline import acceleration_baseline
from seatrial.estimation.prediction.forecast import SHARPNESS, Forecaster, make_forecaster
from seatrial.estimation.prediction.prediction import Prediction, offsets_at_zero, predict

RUN_DRAWS = 200
"""Draws that are simulated over a whole run."""
FITTED_DRAWS = 40
"""Draws that are simulated over each fitted run."""


def fit_ours(problem: Problem) -> Fitted:
    """Find the posterior mode of every structure of the campaign and keep that of the largest evidence by Laplace.

    Raises:
        NumericalError: no structure has a mode.
    """
    return _fit(problem, problem.campaign)


def fit_chosen(problem: Problem) -> Fitted:
    """Leave each fitted run out in turn, and fit the structure and model of the error that predict it best; `seatrial crossvalidate`.

    Raises:
        InputError: too few measurements.
        NumericalError: no structure has a mode.
    """
    validated = cross_validate(problem.campaign, problem.trials, problem.reporter)
    fitted = _fit(problem, best_campaign(problem.campaign, problem.trials, validated))
    assert validated.chosen is not None  # else there were no best campaign
    return replace(fitted, note=f"{fitted.note}; model of the error: {validated.chosen.error_model}")


def _fit(problem: Problem, campaign: Campaign) -> "Ours":
    """Find the modes of a campaign's structures given the fitted runs; errors as `fit_ours`."""
    study, modes, failures = Study(campaign, problem.records), [], []
    tell = problem.reporter.progress("ours: modes")
    for index, structure in enumerate(campaign.structures):
        tell(index, len(campaign.structures))
        posterior = study.posterior(structure)
        try:
            mode = find_mode(posterior, key=random_key(campaign.seed, f"mode {structure.terms}"))
        except NumericalError as error:
            failures.append(error)
            continue
        drawn = draw_about_mode(campaign.seed, structure, posterior, mode)
        modes.append((mode.log_evidence, drawn, posterior, mode.only(posterior.places)))
    tell(len(campaign.structures), len(campaign.structures))
    if not modes:
        raise failures[0]
    _, drawn, posterior, mode = max(modes, key=lambda one: one[0])
    about, about_sd = (dict(zip(drawn.names, map(float, one), strict=True)) for one in (mode.values, mode.sd))
    several = (
        f"{drawn.structure.label} of {len(campaign.structures)} structures: " if len(campaign.structures) > 1 else ""
    )
    draws = offsets_at_zero(dict(zip(drawn.names, drawn.draws().T, strict=True)))
    ours = Ours(campaign, posterior, draws, draws, (), about, about_sd, several + " ".join(drawn.structure.terms))
    try:
        other = acceleration_baseline(posterior.likelihood.model).fit(
            problem.records, problem.channels, problem.controls
        )
    except (InputError, NumericalError):
        return ours
    # Both are judged by what they leave of the fitted runs in free simulation.
    fitted = [ours.simulated(record, FITTED_DRAWS) for record in problem.records]
    left = np.concatenate([one.measured - one.mean for one in fitted])
    ratio = np.sqrt(np.nanmean(left**2, 0)) / other.noise_sd
    odds = float(np.exp(SHARPNESS * np.mean(np.log(ratio))))
    return replace(ours, mixed=with_estimate(draws, other.parameters, odds), others=(other.parameters,))


def with_estimate(
    draws: Mapping[str, np.ndarray], other: Mapping[str, float], odds: float
) -> dict[str, Float[np.ndarray, " n"]]:
    """Return as many draws of a mixture of a posterior and of another estimate of its coefficients, SI, whose odds to it are given."""
    count = len(next(iter(draws.values())))
    own = round(count / (1.0 + odds))
    first, last = (np.linspace(0, count - 1, size).astype(int) for size in (own, count - own))
    return {
        name: np.append(column[first], np.full(last.size, other[name]) if name in other else column[last])
        for name, column in draws.items()
    }


@dataclass(frozen=True, eq=False)
class Ours:
    """The fitted campaign.

    Attributes:
        campaign: of the set.
        posterior: of the structure that is kept.
        draws: about its mode, by parameter name, SI.
        mixed: these, and the coefficients that fit the accelerations as often as they predict the fitted runs well.
        others: these coefficients, if there are any.
        about: values at the mode, SI.
        about_sd: their standard deviations as if the posterior were normal, SI.
        note: which terms.
    """

    campaign: Campaign
    posterior: Posterior
    draws: Mapping[str, np.ndarray]
    mixed: Mapping[str, np.ndarray]
    others: tuple[Mapping[str, float], ...]
    about: Mapping[str, float]
    about_sd: Mapping[str, float]
    note: str
    _forecasters: dict[int, Forecaster] = field(
        default_factory=dict
    )  # By the longest horizon that each is for, samples

    def simulated(self, record: Record, n: int = RUN_DRAWS) -> Prediction:
        """Predict a whole run."""
        return predict(self.posterior, self.mixed, record, n=n, **self._known(record), first_sd=self._first_sd)

    def predict(self, record: Record, stretches: Sequence[Stretch]) -> Predicted:
        """See `Fitted`."""
        if len(stretches) == 1:
            whole = self.simulated(record)
            return Predicted(whole.mean, whole.sd)
        steps = max(end - begin for begin, end in stretches)
        # Stretches of one horizon differ by some samples.
        if steps > 1.5 * max(self._forecasters, default=0):
            horizon = steps * float(np.median(record.step))
            self._forecasters[steps] = make_forecaster(self.posterior, self.draws, horizon, self._first_sd, self.others)
        ahead = self._forecasters[max(self._forecasters)].forecast(
            record, [begin for begin, _ in stretches], steps, **self._known(record)
        )
        mean = np.full((record.time.size, len(self.campaign.channels)), np.nan)
        sd = mean.copy()
        for place, (begin, end) in enumerate(stretches):
            mean[begin + 1 : end + 1], sd[begin + 1 : end + 1] = (
                one[place, : end - begin] for one in (ahead.mean, ahead.sd)
            )
        return Predicted(mean, sd)

    @property
    def _first_sd(self) -> dict[str, float]:
        return {state: first_sd(self.campaign.noise, state) for state in self.posterior.likelihood.model.states}

    def _known(self, record: Record) -> dict[str, Any]:
        """Return start and random key of a run."""
        start = initial_state(self.campaign, self.posterior.likelihood.model, record)
        return {"start": start, "key": random_key(self.campaign.seed, f"benchmark {record.label}")}
