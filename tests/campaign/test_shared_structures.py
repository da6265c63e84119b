"""Structures as the widest one with terms absent, against a posterior of their own."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference import posterior as posteriors
from seatrial.campaign.inference.modes import structure_modes
from seatrial.campaign.inference.posterior import build_posterior, shared_model
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.noncentred import coupled, uncouple
from seatrial.estimation.posterior.posterior import named_draws
from seatrial.sampling.run import unnamed_draws
from seatrial.selection.importance import importance_evidence
from tests.campaign.small import write_small
from tests.campaign.yaw_campaign import write_yaw

KEY = jax.random.key(1)
TWO_MORE = (
    ('optional = ["X_u"]', 'optional = ["X_u", "X_du3"]'),
    ("[prior.X_u]", '[prior.X_du3]\ndistribution = "normal"\nmean = 0.0\nsd = 1.0\n\n[prior.X_u]'),
    ("[truth]", "[truth]\nX_du3 = 0.0"),
)
WRITTEN = {"surge": lambda folder: write_small(folder, *TWO_MORE), "yaw": write_yaw}


@pytest.fixture(scope="module", params=["surge", pytest.param("yaw", marks=pytest.mark.proof)])
def study(request, tmp_path_factory):
    campaign = load_campaign(WRITTEN[request.param](tmp_path_factory.mktemp(request.param)))
    return Study(campaign, get_trials(campaign).fit)


def pair(study, index):
    """Return the two posteriors of a structure: its own, and the shared one with terms absent."""
    structure = study.campaign.structures[index]
    own, shared = build_posterior(study.campaign, structure, study.records), study.posterior(structure)
    assert shared.dim > own.dim
    assert set(shared.present_names) == set(own.names)
    return own, shared, [own.names.index(name) for name in shared.present_names]


def test_all_structures_have_the_same_tree(study):
    trees = {jax.tree.structure(study.posterior(one)) for one in study.campaign.structures}
    assert len(study.campaign.structures) == 4
    assert len(trees) == 1


@pytest.mark.parametrize("index", [1, 2, 3])
@pytest.mark.proof
def test_density_is_that_of_its_own_and_standard_normal_in_what_is_absent(study, index):
    own, shared, order = pair(study, index)
    z = np.asarray(own.sample_prior(KEY, 8))
    wide = np.array(jax.random.normal(jax.random.key(2), (8, shared.dim)))
    absent = np.delete(wide, shared.places, axis=1)
    wide[:, shared.places] = z[:, order]
    here, there = (np.asarray(jax.vmap(one.log_density)(x)) for one, x in ((own, z), (shared, wide)))
    normal = -0.5 * (absent**2).sum(1) - 0.5 * absent.shape[1] * np.log(2 * np.pi)
    finite = np.isfinite(here)
    assert finite.any()
    assert (finite == np.isfinite(there)).all()
    np.testing.assert_allclose(there[finite] - normal[finite], here[finite], rtol=1e-10)
    drawn = named_draws(shared, unnamed_draws(wide[None], there[None], 0.5))
    np.testing.assert_allclose(drawn.log_density[0][finite], here[finite], rtol=1e-10)
    np.testing.assert_allclose(drawn.values[0], np.asarray(own.constrain(z))[:, order], rtol=1e-12)
    assert drawn.names == shared.present_names
    assert drawn.z.shape[-1] == own.dim


@pytest.mark.proof
def test_modes_are_those_of_each_by_itself(study):
    """The search for one structure begins where the largest one expects it, and ends where its own draws lead."""
    known = structure_modes(study, get_trials(study.campaign))
    for structure in study.campaign.structures:
        (mode,) = known.of(structure)
        mode = mode.only(study.posterior(structure).places)
        alone = find_mode(build_posterior(study.campaign, structure, study.records), key=KEY)
        order = [alone.names.index(name) for name in mode.names]
        np.testing.assert_array_less(abs(mode.values - alone.values[order]), 1e-4 * alone.sd[order])
        assert mode.sd == pytest.approx(alone.sd[order], rel=1e-3)


@pytest.mark.proof
def test_evidence_is_that_of_its_own(study):
    own, shared, _ = pair(study, 3)
    here, there = (importance_evidence(one, KEY) for one in (own, shared))
    assert (here.status, there.status) == ("", "")
    joint = np.hypot(here.std_error, there.std_error)
    assert abs(here.log_value - there.log_value) < 4 * joint < 0.1


def test_prior_draws_are_those_of_the_priors_and_standard_normal_in_what_is_absent(study):
    _, shared, _ = pair(study, 3)
    z = np.asarray(shared.sample_prior(KEY, 4000))
    values = np.asarray(shared.constrain(z))
    there = np.zeros(shared.dim, bool)
    there[shared.places] = True
    assert (values[:, ~there] == 0).all()
    assert (np.abs(z[:, ~there].mean(0)) < 4 / np.sqrt(4000)).all()
    assert (np.abs(z[:, ~there].std(0) - 1) < 4 / np.sqrt(8000)).all()
    for i in shared.places:
        prior = shared.parameters[i].prior
        assert abs(values[:, i].mean() - prior.mean) < 4 * prior.sd / np.sqrt(4000)


@pytest.mark.proof
def test_a_value_that_varies_may_be_absent(tmp_path):
    """Coordinates of a value that no trial has are its own, and finite."""
    varying = ("[estimation]", '[estimation]\nvarying = ["X_u"]')
    spread = ("[truth]", '[prior.spread_X_u]\ndistribution = "half-normal"\nlower = 0.0\nscale = 0.5\n\n[truth]')
    campaign = load_campaign(write_small(tmp_path, varying, spread))
    trials = get_trials(campaign).fit
    study = Study(campaign, [*trials, *(replace(one, label="again") for one in trials)])
    without = next(one for one in campaign.structures if "X_u" not in one.terms)
    posterior = study.posterior(without)
    target, mode = uncouple(posterior, find_mode(posterior, key=KEY))
    x = np.asarray(jax.random.normal(KEY, (4, target.dim))) * 0.1 + mode.z
    assert np.isfinite(np.asarray(jax.vmap(target.log_prior)(x))).all()
    absent = np.delete(np.arange(target.dim), posterior.places)
    np.testing.assert_allclose(np.asarray(coupled(target, x))[:, absent], x[:, absent], atol=1e-12)


def test_another_motion_has_a_model_of_its_own(study):
    """A structure that shares states and controls shares the model; the widest is one of the structures here."""
    campaign = study.campaign
    assert {shared_model(campaign, one) for one in campaign.structures} == {campaign.model(campaign.full)}


def test_few_of_many_parameters_have_a_posterior_of_their_own(study, monkeypatch):
    campaign = study.campaign
    monkeypatch.setattr(posteriors, "FEW", 0)
    monkeypatch.setattr(posteriors, "SHARED", 1.0)
    least = min(campaign.structures, key=lambda one: len(one.terms))
    own = Study(campaign, study.records).posterior(least)
    assert own.present is None
    assert set(own.names) == set(study.posterior(least).present_names)
