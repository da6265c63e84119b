"""The source of the equations of motion, executed as it is written, against the package's own model."""

from dataclasses import replace

import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.export.equations import source_of, states_of
from seatrial.export.motion import motion_of
from seatrial.export.vehicle import CoefficientEstimates, require_known
from seatrial.export.write import make_exporter, state
from tests.export.cases import PROVENANCE, commanded, own_rates, published, rich, whole_states, with_law, with_terms

VEHICLES = {
    "frame": lambda: published("bluerov2_heavy"),
    "ship": lambda: published("mariner"),
    "surge": lambda: published("remus100_surge"),
    "dive": lambda: published("remus100_longitudinal"),
    "rich": rich,
    "commanded": commanded,
    "law": with_law,
}


def functions(vehicle):
    """What the source defines, on arrays."""
    space = {"sin": np.sin, "cos": np.cos, "tan": np.tan, "fmin": np.minimum, "fmax": np.maximum}
    exec(source_of(vehicle), space)
    return space


@pytest.mark.parametrize("name", VEHICLES)
def test_the_source_is_the_model(name):
    vehicle = VEHICLES[name]()
    state, control = whole_states(vehicle, 1000)
    assert tuple(state) == states_of(vehicle)
    space = functions(vehicle)
    found = space["derivative"](list(state.values()), list(control.values()), list(space["PARAMETERS"].values()))
    wanted = own_rates(vehicle, state, control)
    found = np.array([np.broadcast_to(one, wanted[0].shape) for one in found])
    assert (np.abs(found - wanted).max(1) <= 1e-12 * np.abs(wanted).max(1)).all()


def test_parameters_move_it_as_coefficients_do():
    """Also added masses, the dead zone, weight less buoyancy and lags."""
    vehicle = with_law()
    state, control = whole_states(vehicle, 50)
    space = functions(vehicle)
    values = {name: 1.3 * value for name, value in space["PARAMETERS"].items()}
    other = with_terms(vehicle, **{name: values[name] for name in vehicle.coefficients})
    other = other.with_numbers({k: type(one)(values[k], one.sd, one.unit) for k, one in vehicle.numbers.items()})
    found = space["derivative"](list(state.values()), list(control.values()), list(values.values()))
    np.testing.assert_allclose(np.array(found), own_rates(other, state, control), rtol=1e-9, atol=1e-9)


def test_motion_has_the_thrust_law_too():
    vehicle = with_law()
    state, control = whole_states(vehicle, 50)
    acting = {name: state[f"{name}_act"] for name in control}
    found = motion_of(vehicle)(np.array(list(state.values())[:6]), state["phi"], state["theta"], acting)
    np.testing.assert_allclose(found, own_rates(vehicle, state, control)[:6], rtol=1e-9, atol=1e-9)


def test_a_vehicle_without_mass_has_no_equations():
    vehicle = published("remus100_longitudinal")
    bare = replace(vehicle, hull=replace(vehicle.hull, mass=None, inertia=(None, None, None)))
    with pytest.raises(InputError, match="no I_yy, mass"):
        require_known(bare, "x", bare.moves)


def test_thrusters_that_push_along_no_modelled_axis_have_no_control():
    """A campaign of heave: the four horizontal thrusters of the frame are no controls, and no target asks for them."""
    heave = {name: value for name, value in published("bluerov2_heavy").coefficients.items() if name[0] in "ZT"}
    heave = {name: value for name, value in heave.items() if set(name[2:]) <= set("wdotabs")}
    frame, nothing = published("bluerov2_heavy"), CoefficientEstimates()
    vehicle = replace(frame, moves=("w",), coefficients=heave, estimated=nothing)
    assert vehicle.controls == ("f_5", "f_6", "f_7", "f_8")
    for name in ("json", "casadi", "mjcf", "control"):
        exporter = make_exporter(name)
        text = "".join(map(str, exporter.write(vehicle, state(exporter, vehicle, PROVENANCE)).values()))
        assert "f_5" in text
        assert name == "json" or "f_1" not in text
