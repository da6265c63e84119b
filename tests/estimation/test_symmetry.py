"""Sides that are alike: against vehicles whose symmetry is known, mirrored motion, and evidences in closed form."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from seatrial.core.coefficients import CoefficientName
from seatrial.estimation.diagnostics.symmetry import MIRRORS, TURNED, PriorCurve, Symmetry, restrictions_of, symmetries
from seatrial.messages.identifiability import restriction_text, symmetry_sentence
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.thrusters import Thruster

TERMS = "X_u X_uabsu X_uu X_vr X_wq Y_v Y_r Y_uv Y_0 Z_w Z_q Z_ww Z_uw K_p K_v M_q M_w M_uw M_0 N_r N_v N_uv N_r3 N_vabsr N_phi X_vdot"


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_a_mirror_sets_to_zero_is_what_mirrored_motion_contradicts(axis):
    """Reflect position vectors; a rate is the vector product of two of them, so that it is reflected and turned round."""
    rng = np.random.default_rng(axis)
    mirror = np.diag(np.where(np.arange(3) == axis, -1.0, 1.0))
    motion = {name: rng.normal() for name in ("u", "v", "w", "p", "q", "r", "phi", "vdot")}
    image = dict(zip("uvw", mirror @ [motion[name] for name in "uvw"], strict=True))
    image |= dict(zip("pqr", np.linalg.det(mirror) * mirror @ [motion[name] for name in "pqr"], strict=True))
    image |= {"phi": motion["phi"] * image["p"] / motion["p"], "vdot": motion["vdot"] * image["v"] / motion["v"]}
    force = dict(zip("XYZ", np.diag(mirror), strict=True))
    moment = dict(zip("KMN", np.linalg.det(mirror) * np.diag(mirror), strict=True))
    broken = set()
    for name in TERMS.split():
        term = CoefficientName.parse(name)
        if not np.isclose(term.regressor(image, {}), (force | moment)[term.axis] * term.regressor(motion, {})):
            broken.add(name)
    assert {one.first for one in restrictions_of(TERMS.split())[MIRRORS[axis]]} == broken


def test_the_published_remus_is_alike_sideways_and_up_and_down():
    """Prestero, Verification of a six-degree of freedom simulation model, 2001: fins in a cross, a hull of revolution.

    Both rotational drags were computed as -9.40 and then adjusted, in pitch twenty times and in yaw ten times (its table B.2).
    """
    published = load_vehicle("remus100_prestero").coefficients
    told = restrictions_of(list(published))[TURNED]
    pairs = {(one.first, one.second) for one in told}
    assert {frozenset(pair) for pair in pairs} >= {
        frozenset(pair) for pair in (("Z_wabsw", "Y_vabsv"), ("N_rabsr", "M_qabsq"), ("N_uv", "M_uw"), ("Y_ur", "Z_uq"))
    }
    for one in told:
        adjusted = 0.5 if one.first == "N_rabsr" else 1.0
        assert published[one.first] == pytest.approx(adjusted * one.sign * published[one.second]), restriction_text(one)


def test_thrusters_that_are_mirror_images_have_one_gain():
    frame = [Thruster((0.2, y, 0.0), (1.0, push, 0.0)) for y, push in ((0.1, -1.0), (-0.1, 1.0))]
    frame += [Thruster((-0.2, y, 0.0), (0.0, 0.0, 1.0)) for y in (0.3, -0.3)] + [Thruster((0.0, 0.0, 0.2), (0, 1, 0))]
    names = [f"gain_f_{number}" for number in (1, 2, 3, 4, 5)]
    found = restrictions_of(names, frame)
    assert {sides: [restriction_text(one) for one in told] for sides, told in found.items()} == {
        "port and starboard": ["gain_f_1 = gain_f_2", "gain_f_3 = gain_f_4"]
    }


@pytest.mark.parametrize(("truth", "support"), [((0.0, 1.1, 1.1), True), ((0.6, 1.1, 0.7), False)])
def test_the_evidence_of_a_linear_model_is_that_of_its_closed_form(truth, support):
    """y = A (Y_0, gain_f_1, gain_f_2) + noise: the evidence of each model is a normal density of y."""
    rng = np.random.default_rng(7)
    design, noise = rng.normal(size=(60, 3)), 0.5
    y = design @ truth + noise * rng.normal(size=60)
    mean, sd = np.array([0.0, 1.0, 1.0]), np.array([1.0, 0.3, 0.3])
    precision = design.T @ design / noise**2 + np.diag(sd**-2.0)
    cov = np.linalg.inv(precision)
    centre = cov @ (design.T @ y / noise**2 + mean / sd**2)
    draws = rng.multivariate_normal(centre, cov, 40_000)

    def evidence(columns, means, sds):
        spread = columns @ np.diag(np.square(sds)) @ columns.T + noise**2 * np.eye(60)
        return multivariate_normal(columns @ means, spread).logpdf(y)

    # Alike: Y_0 = 0 and one gain, whose prior is the product of both, which is a normal again.
    alike = evidence(design[:, 1:].sum(1, keepdims=True), [1.0], [0.3 / np.sqrt(2)])
    expected = alike - evidence(design, mean, sd)
    frame = [Thruster((0.0, side, 0.0), (1.0, 0.0, 0.0)) for side in (0.2, -0.2)]
    grid = mean + np.linspace(-4, 4, 241)[:, None] * sd
    names = ("Y_0", "gain_f_1", "gain_f_2")
    priors = {name: PriorCurve(grid[:, i], norm(mean[i], sd[i]).pdf(grid[:, i])) for i, name in enumerate(names)}
    (found,) = (one for one in symmetries(priors, draws, frame) if one.sides == "port and starboard")
    away = centre[0] ** 2 / cov[0, 0] + (centre[1] - centre[2]) ** 2 / (cov[1, 1] + cov[2, 2] - 2 * cov[1, 2])
    assert found.log_evidence == pytest.approx(expected, abs=0.01 + 5 * np.sqrt((2 + away) * away / 40_000))
    assert (found.log_evidence > 0) is support
    assert [restriction_text(one) for one in found.restrictions] == ["Y_0 = 0", "gain_f_1 = gain_f_2"]


def test_what_a_prior_forbids_is_not_asked():
    grid = np.linspace(1.0, 2.0, 50)
    draws = np.random.default_rng(1).uniform(1.2, 1.8, (500, 1))
    assert symmetries({"Y_0": PriorCurve(grid, np.ones(50))}, draws) == []


def test_sentences():
    one = restrictions_of(["Y_0", "M_w", "N_v"])["port and starboard"]
    assert symmetry_sentence(Symmetry("port and starboard", one, 4.21)) == (
        "port and starboard alike (Y_0 = 0): log evidence +4.2, supported by the data"
    )
    assert symmetry_sentence(Symmetry(TURNED, restrictions_of(["M_w", "N_v"])[TURNED], -999.0)) == (
        "sideways and up and down alike (N_v = -M_w): log evidence below -20, refuted by the data"
    )
