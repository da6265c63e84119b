"""What makes a vehicle run away is named."""

from types import SimpleNamespace

from seatrial.export.stability import _culprit


def test_the_one_coefficient_that_gives_energy_is_named():
    """Forty newtons for each metre per second of sway push on; without that, all damping takes energy."""
    forces = {"X_u": -5.0, "X_uabsu": -3.0, "Y_v": 40.0, "Y_vabsv": -3.0}
    assert _culprit(SimpleNamespace(forces=forces), {"u": 1.0, "v": 0.5}) == "Y_v"
    assert _culprit(SimpleNamespace(forces=forces | {"X_u": 80.0}), {"u": 1.0, "v": 0.5}) is None
