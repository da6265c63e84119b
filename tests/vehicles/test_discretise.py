import numpy as np
import pytest

from seatrial.numerics.gaussian import independent
from seatrial.numerics.integrate import euler_step
from seatrial.vehicles.discretise import discretise
from tests.cases import N0, SCALES, naive_rk4, paper_model, surge_rate

INITIAL = independent(np.zeros(4), np.ones(4))


def space(outputs=("u", "udot"), **options):
    process_sd, measurement_sd = np.full(4, 0.1), np.full(len(outputs), 0.2)
    return discretise(paper_model(), outputs, INITIAL, process_sd, measurement_sd, SCALES, **options)


def test_states_are_the_vehicles_then_its_coefficients():
    assert space().states == ("u", "X_u", "X_uabsu", "T_nabsn")
    assert (space().outputs, space().n_dynamic) == (("u", "udot"), 1)


def test_transition_and_outputs_in_filter_units():
    state, control, h = (1.7, -1.0, -3.0, 7e-2), (N0,), 0.05

    def rate(u):
        return surge_rate(u, 12.5, *state[1:])

    assert space().transition(state, control, h) == pytest.approx((naive_rk4(rate, 1.7, h),), rel=1e-13)
    by_euler = space(integrator=euler_step)
    assert by_euler.transition(state, control, h) == pytest.approx((1.7 + h * rate(1.7),), rel=1e-13)
    assert space().observe(state, control) == pytest.approx((1.7, rate(1.7)), rel=1e-12)
    assert space(("udot",)).observe(state, control) == pytest.approx((rate(1.7),), rel=1e-12)


def test_equal_models_share_their_functions():
    """Compiled filters are found by these objects: fresh ones would compile again."""
    assert space().transition is space().transition
    assert space().observe is space().observe
    assert space().observe is not space(("u",)).observe


def test_without_scales_coefficients_are_si():
    si = discretise(paper_model(), ("udot",), INITIAL, np.zeros(4), np.ones(1))
    thrust = 7e-2 / (2 * np.pi) ** 2
    expected = surge_rate(1.7, 12.5, -1.0, -3.0, 7e-2)
    assert si.observe((1.7, -1.0, -3.0, thrust), (N0,)) == pytest.approx((expected,), rel=1e-12)
