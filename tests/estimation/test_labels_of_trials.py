"""Labels of trials, units and printed names change no compiled code, and no number."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import seatrial as st
from seatrial.compiled.program_store import key_of
from seatrial.estimation.posterior.posterior import Posterior
from seatrial.estimation.posterior.slopes import likelihood_slopes
from seatrial.sampling.target import log_densities
from tests.estimation_cases import make_trial

MODEL = st.load_vehicle("remus100_surge").build(free=["X_u", "X_uabsu", "T_nabsn"])
PRIORS = {
    "X_u": st.Normal(-1.2, 0.3),
    "X_uabsu": st.Normal(-3.0, 0.5),
    "T_nabsn": st.Normal(6e-4, 1e-4),
    "sigma_u": st.LogUniform(0.01, 0.1),
}
OF_TRIALS = {
    "nothing": ({}, {}),
    "starts": ({"u_0": st.Normal(1.5, 0.2)}, {}),
    "bias": ({"bias_u": st.Normal(0.0, 0.1)}, {"sensors": [st.Sensor("u", bias=True)], "own": ["bias_u"]}),
    "coefficients": ({"spread_X_u": st.LogUniform(0.05, 0.5)}, {}),
    "filter": ({"process_u": st.LogUniform(0.001, 0.1)}, {}),
}
SAMPLES = 43  # a length that no other test has


def of_trials(what, labels, seed=0):
    random = np.random.default_rng(seed)
    time, records = np.arange(SAMPLES) * 0.1, []
    for label in labels:
        speed = 1.5 + 0.1 * random.standard_normal(SAMPLES)
        records.append(make_trial(time, np.full(SAMPLES, 20.0), label, u=speed))
    priors, options = OF_TRIALS[what]
    return st.make_posterior(MODEL, records, PRIORS | priors, **{"sensors": ["u"], **options})


def both(posterior, z):
    return np.asarray(log_densities(posterior, z)), likelihood_slopes(posterior, np.asarray(posterior.constrain(z[0])))


def check(posterior, z, found):
    """Compare with what Python computes of this very posterior, by its own names."""
    densities, slopes = found
    for one, density in zip(z, densities, strict=True):
        values = dict(zip(posterior.names, np.asarray(posterior.constrain(one)), strict=True))
        expected = float(posterior.likelihood(values, posterior.data)) + float(posterior.log_prior(one))
        assert density == pytest.approx(expected, rel=1e-12)
    values = dict(zip(posterior.names, np.asarray(posterior.constrain(z[0])), strict=True))
    assert float(slopes.value) == pytest.approx(float(posterior.likelihood(values, posterior.data)), rel=1e-12)


@pytest.mark.parametrize("what", OF_TRIALS)
def test_records_of_other_labels_need_no_program(what, programs):
    first, second = of_trials(what, ("out", "back")), of_trials(what, ("back", "third"), seed=1)
    texts = tuple(replace(one, unit="1", label="?", shown=(2.0, "knots")) for one in second.parameters)
    second = replace(second, parameters=texts)
    z = np.random.default_rng(2).normal(scale=0.3, size=(3, first.dim))
    found = {}
    assert programs(lambda: found.update(first=both(first, z))) > 0
    assert programs(lambda: found.update(second=both(second, z))) == 0
    assert jax.tree.structure(first) == jax.tree.structure(second)
    assert key_of(jax.tree.structure(first)) == key_of(jax.tree.structure(second))
    check(first, z, found["first"])
    check(second, z, found["second"])
    assert second.likelihood.labels == ("back", "third")
    assert [name.partition("[")[0] for name in second.names] == [name.partition("[")[0] for name in first.names]


@pytest.mark.parametrize("what", [what for what in OF_TRIALS if what not in ("nothing", "filter")])
def test_trials_in_another_order_than_their_parameters_are_not_mixed_up(what, programs):
    first = of_trials(what, ("out", "back"))
    likelihood = first.likelihood.labelled(("back", "out"))
    turned = Posterior(first.parameters, likelihood, first.data)
    assert likelihood != first.likelihood
    assert jax.tree.structure(turned) != jax.tree.structure(first)
    assert key_of(jax.tree.structure(turned)) != key_of(jax.tree.structure(first))
    z = np.random.default_rng(3).normal(scale=0.3, size=(2, first.dim))
    here, there = both(first, z), both(turned, z)
    check(first, z, here)
    check(turned, z, there)
    assert not np.allclose(here[0], there[0])


@pytest.mark.parametrize(("what", "same"), [("nothing", True), ("filter", True), ("starts", False), ("bias", False)])
def test_likelihoods_by_themselves_are_told_apart_where_labels_name_parameters(what, same):
    first, second, alone = (of_trials(what, labels).likelihood for labels in (("a", "b"), ("c", "d"), ("a",)))
    assert (first == second) is same
    assert (key_of(first) == key_of(second)) is same
    assert first != alone
    if same:
        assert hash(first) == hash(second)


def test_a_parameter_of_no_trial_keeps_its_name():
    """One named after a trial's number must not stand in for that trial's."""
    first = of_trials("starts", ("out", "back"))
    assert [name for name in first.names if "[" in name] == ["u_0[out]", "u_0[back]"]
    parameters = tuple(replace(one, name=one.name.replace("[out]", "[0]")) for one in first.parameters)
    strange = replace(first, parameters=parameters)
    assert jax.tree.structure(strange) != jax.tree.structure(first)
    z = np.zeros((1, first.dim))
    z[0, -2] = 1.0
    check(strange, z, both(strange, z))
    check(first, z, both(first, z))
