"""Evidences with every error: against quadrature over what is stated, a slow noise that is modelled, and each model by itself."""

from dataclasses import replace

import numpy as np
import pytest

from seatrial.estimation.diagnostics.error_budget import EXACT, error_budget
from seatrial.estimation.diagnostics.error_evidence import log_evidence_gains
from seatrial.estimation.diagnostics.error_sources import StatedErrors
from seatrial.estimation.diagnostics.linear_model import NOTHING
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.posterior import posterior_of_density
from seatrial.estimation.priors import Normal
from tests.estimation.test_error_budget import TRUTH, posterior_of


def at(posterior):
    return find_mode(posterior, key=0, starts=64, tries=1)


def test_a_stated_inertia_is_integrated_out():
    """Forces of a mass 5 % smaller are those of coefficients 5 % larger: the evidence is the mean over scales of all forces."""
    plain = posterior_of()
    tight = {name: Normal(1.05 * value, 0.01 * abs(value)) for name, value in TRUTH.items()}
    posterior = replace(
        plain, parameters=tuple(replace(one, prior=tight.get(one.name, one.prior)) for one in plain.parameters)
    )
    stated = StatedErrors(inertia=0.05, scale=0.0, clock=0.0)
    (gain,) = log_evidence_gains([posterior], [at(posterior)], stated) or [0.0]
    logs = []
    nodes, weights = np.polynomial.hermite_e.hermegauss(9)
    for node in nodes:
        scale = 1.0 / (1.0 + 0.05 * node)
        moved = {name: Normal(prior.mean * scale, prior.sd * scale) for name, prior in tight.items()}
        one = replace(
            plain, parameters=tuple(replace(one, prior=moved.get(one.name, one.prior)) for one in plain.parameters)
        )
        logs.append(at(one).log_evidence)
    exact = np.logaddexp.reduce(np.array(logs) + np.log(weights / weights.sum()))
    assert exact - at(posterior).log_evidence > 1.0
    # The constant that all models share is of the mode within, where the residuals are large: here it does not cancel.
    assert gain == pytest.approx(exact - at(posterior).log_evidence, abs=1.0)


@pytest.mark.proof
def test_models_that_share_a_likelihood_are_compared_as_if_each_were_alone():
    """With X_u, and without it: as one posterior of which a term is absent, and as two."""
    whole, alone = posterior_of(), posterior_of(terms=("X_uabsu", "T_nabsn"))
    absent = replace(whole, present=np.array([float(name != "X_u") for name in whole.names]))
    full = replace(whole, present=np.ones(whole.dim))
    totals = []
    for pair in ([full, absent], [whole, alone]):
        modes = [at(one) for one in pair]
        gains = log_evidence_gains(pair, modes, EXACT) or []
        totals.append([gain + mode.log_evidence for gain, mode in zip(gains, modes, strict=True)])
    assert np.diff(totals[0]) == pytest.approx(np.diff(totals[1]), abs=0.3)
    assert totals[0][0] - at(whole).log_evidence == pytest.approx(np.log(NOTHING), abs=0.15)  # the model is right


@pytest.mark.proof
def test_a_slow_error_taken_as_white_is_as_if_it_were_modelled():
    """Log Bayes factor of X_u: 60 nats too large with white noise alone."""
    factors = []
    for noise in ("white", "drifting"):
        pair = [
            posterior_of(drift=0.05, noise=noise, terms=terms)
            for terms in (("X_uabsu", "T_nabsn", "X_u"), ("X_uabsu", "T_nabsn"))
        ]
        modes = [at(one) for one in pair]
        within = np.array([mode.log_evidence for mode in modes])
        factors.append((-np.diff(within)[0], -np.diff(within + (log_evidence_gains(pair, modes, EXACT) or 0.0))[0]))
    (white, with_errors), (modelled, _) = factors
    assert with_errors == pytest.approx(modelled, abs=1.5)
    assert abs(white - modelled) > 3 * abs(with_errors - modelled)


def test_a_density_of_ones_own_has_no_errors_of_sensors():
    own = posterior_of_density(lambda values: -0.5 * values["a"] ** 2, {"a": Normal(0.0, 1.0)})
    assert log_evidence_gains([own], [at(own)]) is None


def test_added_mass_that_is_estimated_is_no_force_that_a_model_may_lack():
    """Its signal is an acceleration, which the sources of error do not have; its error is one of the inertia."""
    whole = posterior_of(terms=("X_udot", "X_uabsu", "T_nabsn"))
    mode = at(whole)
    budget = error_budget(replace(whole, present=np.ones(whole.dim)), mode)
    within = dict(zip(whole.names, mode.sd, strict=True))
    assert "X_udot" not in {one.effect.of for one in budget.omitted}
    # The force of the vehicle is not known to 7 %.
    assert budget.sd("X_uabsu", within["X_uabsu"]) > 1.5 * within["X_uabsu"]
