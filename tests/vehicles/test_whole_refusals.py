"""What is no vehicle, and what the builders say of it."""

import pytest

from seatrial.core.errors import InputError
from seatrial.vehicles.active_dof import acting_terms
from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.hull import whole_hull
from seatrial.vehicles.thrusters import Thruster
from seatrial.vehicles.whole import whole_vehicle

INERTIA = (0.2, 3.0, 3.1)
DIAGONAL = {"X_udot": -1.0, "Y_vdot": -20.0, "Z_wdot": -20.0, "K_pdot": -0.1, "M_qdot": -2.0, "N_rdot": -2.0}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mass": -3.0}, "mass\n"),
        ({"mass": 0.0}, "above 0"),
        ({"mass": float("nan")}, "mass\n"),
        ({"inertia": (0.2, float("inf"), 3.0)}, "inertia y"),
        ({"inertia": (0.2, 3.0, -1.0)}, "inertia z"),
        ({"inertia": (0.2, 3.0, 4.0)}, "none above the sum of the two others"),
        ({"products": (2.0, 0.0, 0.0)}, "positive ones"),
        ({"centre_of_gravity": (0.0, 0.0, 0.5)}, "check the centre of gravity"),
        ({"inertia": (None, 3.0, None), "centre_of_gravity": (0.5, 0.0, 0.0)}, "check the centre of gravity"),
        ({"buoyancy": -1.0}, "buoyancy"),
        ({"thrust_deduction": 1.0}, "thrust_deduction"),
        ({"thrust_deduction": -0.1}, "thrust_deduction"),
        ({"wake": 1.2}, "wake"),
        ({"fixed": {"Y_v": float("nan")}}, "Y_v"),
        ({"fixed": {"X_ux": 1.0}}, "character 4"),
        ({"trim": {"u": float("inf")}}, 'trim\\["u"\\]'),
        ({"fixed": {"Y_rdot": 1.93, "N_vdot": -1.93}}, "the added mass of an ideal fluid is symmetric"),
    ],
)
def test_impossible_hulls(changes, words):
    with pytest.raises(InputError, match=words):
        whole_hull(**{"name": "a", "mass": 30.0, "inertia": INERTIA, **changes})


def test_measured_added_mass_need_not_be_symmetric():
    hull = whole_hull("ship", 30.0, INERTIA, fixed={"Y_rdot": -1.0, "N_vdot": 0.5}, symmetric=False)
    assert whole_vehicle(hull, (), moves=("v", "r")).states == ("v", "r")


@pytest.mark.parametrize(
    ("terms", "options", "words"),
    [
        (["Y_ux"], {}, "character 4"),
        (["Y_v", "Y_v"], {}, "the same regressor"),
        (["X_u2", "X_absuabsu"], {}, "the same regressor as X_u2"),
        (["X_u2"], {"fixed": {"X_uu": -1.0}}, "the same regressor"),
        ([], {"fixed": {"M_qdot": 4.0}}, "positive definite"),
        (["X_du2"], {}, 'no trim value of "u"'),
        (["N_uudr"], {}, "for the rudder write N_uudelta_r"),
        (["Q_nabsn"], {}, "write K_nabsn"),
        (["Y_vdot2"], {}, "an added mass such as"),
        (["Y_vdotu"], {}, "an added mass such as"),
        (["X_absudot"], {}, "an added mass such as"),
        (["T_udot"], {}, "an added mass such as"),
        (["Y_v"], {"moves": ("u",)}, r"axis Y does not move(.|\n)*vehicle\.terms\(moves\) gives"),
        (["X_vr"], {"moves": ("u", "r")}, "v is zero"),
        (["Y_rdot"], {"moves": ("v",)}, "no part in the motion"),
        ([], {"moves": ("u", "z")}, "moves"),
        ([], {"moves": ()}, "tied in place, with thrusters without a lag"),
        ([], {"moves": ("u", "u")}, "each once"),
        ([], {"given": ("u",)}, "a velocity is a state, a given signal, or zero"),
        ([], {"positions": ("depth",)}, "positions"),
        ([], {"angles": ("pitch",)}, "angles"),
        ([], {"current": (0.1, 0.2)}, "three velocities"),
        ([], {"current": "north"}, "three velocities"),
        ([], {"added_coriolis": "both"}, '"named" or "automatic"'),
        (["Z_qdot"], {"added_coriolis": "automatic"}, "give M_wdot too"),
        (["Y_ur"], {"added_coriolis": "automatic"}, "already follows from X_udot"),
        (["N_uv"], {"added_coriolis": "automatic"}, "already follows from"),
        (["T_nabsn"], {"thrusters": (Thruster((0, 0, 0), (0, 0, 0)),)}, "thruster 1"),
        (["K_nabsn"], {"thrusters": (Thruster((0, 0, 0), (1, 0, 0)),)}, "only on the axis T"),
    ],
)
def test_impossible_vehicles(terms, options, words):
    options = dict(options)
    hull = whole_hull("a", 30.0, INERTIA, fixed=DIAGONAL | options.pop("fixed", {}))
    with pytest.raises(InputError, match=words):
        whole_vehicle(hull, terms, **options)


def test_unknown_inertia_and_wrong_signs():
    with pytest.raises(InputError, match="no I_xx, and p moves"):
        whole_vehicle(whole_hull("a", 30.0, (None, 3.0, 3.0)), ())
    with pytest.raises(InputError, match="positive definite"):
        whole_vehicle(whole_hull("a", 30.0, INERTIA, fixed={"X_udot": 40.0}), (), moves=("u",))


def test_lift_beside_automatic_coriolis_forces_has_another_product():
    hull = whole_hull("a", 30.0, INERTIA, fixed=DIAGONAL)
    model = whole_vehicle(hull, ("Y_absur", "Y_uv", "X_uu"), added_coriolis="automatic")
    assert len(model.coefficients) == 3


def test_terms_that_act():
    terms = ("X_u", "X_vr", "Y_v", "T_nabsn", "Z_0", "Y_rdot", "N_rdot", "N_uv")
    assert acting_terms(terms, ("u",)) == ("X_u", "T_nabsn")
    assert acting_terms(terms, ("v", "r")) == ("Y_v", "Y_rdot", "N_rdot")
    assert acting_terms(terms, ("v", "r"), given=("u",)) == ("Y_v", "Y_rdot", "N_rdot", "N_uv")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"time_constant": -1.0}, "time_constant"),
        ({"time_constant": float("nan")}, "time_constant"),
        ({"time_constant": "1 s"}, "time_constant"),
        ({"lower": 2.0, "upper": 1.0}, "lower below upper"),
        ({"lower": float("nan")}, "Actuator, lower"),
        ({"rate": 0.0}, "rate"),
    ],
)
def test_impossible_actuators(settings, words):
    with pytest.raises(InputError, match=words):
        Actuator(**{"time_constant": 1.0, **settings})


@pytest.mark.parametrize(
    ("actuators", "words"), [({"delta": Actuator(1.0)}, "no such control"), ({"n": 1.0}, "an Actuator")]
)
def test_actuators_of_nothing(actuators, words):
    model = whole_vehicle(whole_hull("a", 30.0, INERTIA), ("T_nabsn",), moves=("u",))
    with pytest.raises(InputError, match=words):
        with_actuators(model, actuators)
