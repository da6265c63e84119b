import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.vehicles.catalogue import load_surge, load_vehicle, make_vehicle, surge_names
from seatrial.vehicles.whole import whole_vehicle
from tests.cases import U0


def test_remus100_as_published():
    entry = load_surge("remus100_surge")
    assert entry.coefficients == {"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4}
    assert (entry.hull.mass, entry.hull.thrust_deduction, entry.hull.fixed) == (30.48, 0.1, {"X_udot": -0.93})
    assert entry.hull.trim["n"] == 125.0


def test_remus100_trims_at_three_knots():
    """6.28e-4 * 125^2 = 6.28e-2 * 12.5^2: the trim thrust, and so the speed, is that of the golden numbers."""
    assert load_surge("remus100_surge").hull.trim["u"] == pytest.approx(U0, abs=1e-11)
    assert pytest.approx(3 * 1852 / 3600, abs=2e-3) == U0


@pytest.mark.parametrize("name", surge_names())
def test_every_vehicle_is_at_rest_at_its_trim(name):
    entry = load_surge(name)
    model = whole_vehicle(entry.hull, tuple(entry.coefficients), moves=("u",))
    control = tuple(entry.hull.trim[name] for name in model.controls)
    assert model.derivative(entry.coefficients, (entry.hull.trim["u"],), control)[0] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", ["remus100_surg", "../remus100_surge", ""])
def test_unknown_vehicle(name):
    with pytest.raises(InputError, match="no such vehicle") as caught:
        load_surge(name)
    assert "remus100_surge" in caught.value.expected
    assert "remus100_surge" in caught.value.remedy


@pytest.mark.parametrize("name", [None, "", 3, ["remus100_surge"]])
def test_a_name_is_text(name):
    with pytest.raises(InputError, match="vehicle, name"):
        load_vehicle(name)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": None}, "vehicle, name"),
        ({"mass": "31 kg"}, 'vehicle "ours", mass'),
        ({"mass": -1.0}, 'vehicle "ours", mass'),
        ({"mass": [31.0]}, 'vehicle "ours", mass'),
        ({"coefficients": ["X_u"]}, "a mapping of names"),
        ({"coefficients": {"X_u": np.nan}}, r'coefficients\["X_u"\]'),
        ({"coefficients": {"X_u": "-3"}}, r'coefficients\["X_u"\]'),
        ({"inertia": (1.0, 2.0)}, "2 of them"),
        ({"inertia": 3.0}, "inertia"),
        ({"inertia": ("1", 2.0, 3.0)}, "inertia x"),
        ({"moves": "fast"}, "u, v, w, p, q, r"),
        ({"moves": ["n"]}, "u, v, w, p, q, r"),
        ({"actuators": {"n": 0.5}}, "actuator n"),
        ({"actuators": [0.5]}, "actuators"),
        ({"thrusters": [(0.0, 0.0, 0.0)]}, r"thrusters\[0\]"),
        ({"added_coriolis": "none"}, "added_coriolis"),
        ({"wakes": 0.1}, 'did you mean "wake"'),
        ({"wake": 1.0}, "wake"),
        ({"trim": {"u": np.inf}}, "trim"),
        ({"centre_of_gravity": (0.0, 0.0)}, "centre_of_gravity"),
        ({"mass": None, "thrust_deduction": np.nan}, "thrust_deduction"),
        ({"mass": None, "trim": [1.0]}, "trim"),
        ({"mass": None, "weight": 300.0}, "thrust_deduction, wake, trim"),
    ],
)
def test_impossible_vehicles(changes, message):
    usual = {"name": "ours", "mass": 31.0, "coefficients": {"X_u": -3.0, "T_nabsn": 6e-4}}
    with pytest.raises(InputError, match=message):
        make_vehicle(**{**usual, **changes})
