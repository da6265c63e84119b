from dataclasses import replace

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.export.stability import dissipation_findings
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.hull import added_mass_matrix, rigid_mass_matrix
from seatrial.vehicles.whole import whole_vehicle
from tests.vehicles.laws import (
    added_mass_findings,
    check_laws,
    coriolis_findings,
    energy_findings,
    sign_findings,
)
from tests.vehicles.test_free_body import odd_body

REMUS = load_vehicle("remus100_hall_anstee")
DRAG = {"X_uabsu": -3.0, "Y_vabsv": -50.0, "N_rabsr": -9.0}


def test_the_published_vehicle_obeys_but_for_one_sign():
    """M_wabsw = 3.18 and Z_wabsw = -1310 together take power; Y_rabsr and Z_qabsq are small beside N_rabsr and M_qabsq."""
    check_laws(REMUS.hull, REMUS.coefficients)
    assert coriolis_findings({**REMUS.hull.fixed, **REMUS.coefficients}) == []


def test_added_mass():
    assert added_mass_findings({"Y_rdot": 1.93, "N_vdot": 1.93, "Y_vdot": -35.5, "N_rdot": -4.88}) == []
    assert "differ" in added_mass_findings({"Y_rdot": 1.93, "N_vdot": -1.93, "Y_vdot": -35.5, "N_rdot": -4.88})[0]
    coupled = added_mass_findings({"Y_rdot": 30.0, "N_vdot": 30.0, "Y_vdot": -35.5, "N_rdot": -4.88})
    assert "eigenvalue" in coupled[0]
    assert "eigenvalue" in added_mass_findings({"X_udot": 1.0})[0]


def test_missing_coriolis_forces_are_named():
    found = coriolis_findings({"X_udot": -1.0, "Y_vdot": -20.0, "Y_ur": -1.0, "X_vr": 20.0})
    assert {line.split()[0] for line in found} == {"Z_uq", "Z_vp", "K_vw", "M_uw", "N_uv"}


@pytest.mark.parametrize(
    ("change", "motion"),
    [
        ({"X_uabsu": 3.0}, "u ="),
        ({"Y_v": 60.0}, "v ="),
        ({"Y_rabsr": -90.0, "N_vabsv": -90.0}, "r ="),
        ({"X_u3": 3.0}, "u ="),
    ],
)
def test_damping_that_drives(change, motion):
    assert dissipation_findings(DRAG) == []
    assert motion in dissipation_findings({**DRAG, **change})[0]


def test_lift_is_no_damping():
    assert dissipation_findings({**DRAG, "Y_uv": 90.0, "M_uw": 24.0, "X_vr": 900.0}) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"X_uabsu": 2.9}, "X_uabsu"),
        ({"Z_w": 1.0}, "Z_w"),
        ({"T_nabsn": -1e-4}, "T_nabsn"),
        ({"N_uudelta_r": 6.15}, "ahead of the origin"),
        ({"M_uudelta_s": 6.15}, "ahead of the origin"),
    ],
)
def test_signs(change, words):
    assert sign_findings(REMUS.hull, REMUS.coefficients) == []
    assert words in sign_findings(REMUS.hull, {**REMUS.coefficients, **change})[0]
    with pytest.raises(InputError, match=words):
        check_laws(REMUS.hull, {**REMUS.coefficients, **change})


def test_top_heavy():
    hull = replace(REMUS.hull, centre_of_gravity=(0.0, 0.0, -0.02))
    assert "upside down" in sign_findings(hull, {})[0]


def test_energy_in_still_water_without_damping():
    hull = odd_body()
    model = whole_vehicle(hull, (), added_coriolis="automatic")
    mass = rigid_mass_matrix(hull) + added_mass_matrix(hull.fixed)
    assert energy_findings(model, {}, mass) == []
    assert energy_findings(whole_vehicle(hull, ()), {}, mass) == []
    lone = whole_vehicle(hull, ("X_vr",))
    assert "energy changes" in energy_findings(lone, {"X_vr": 20.0}, mass)[0]
    assert np.linalg.eigvalsh(mass).min() > 0
