"""Damping that drives, and the one coefficient that makes a vehicle run away."""

from types import SimpleNamespace

import pytest

from seatrial.export.stability import _culprit, dissipation_findings

DRAG = {"X_uabsu": -3.0, "Y_vabsv": -50.0, "N_rabsr": -9.0}


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


def test_the_one_coefficient_that_gives_energy_is_named():
    """Forty newtons for each metre per second of sway push on; without that, all damping takes energy."""
    forces = {"X_u": -5.0, "X_uabsu": -3.0, "Y_v": 40.0, "Y_vabsv": -3.0}
    assert _culprit(SimpleNamespace(forces=forces), {"u": 1.0, "v": 0.5}) == "Y_v"
    assert _culprit(SimpleNamespace(forces=forces | {"X_u": 80.0}), {"u": 1.0, "v": 0.5}) is None
