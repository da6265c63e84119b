"""Models of an equation of one's own, and the motion of a vehicle for a likelihood of one's own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import seatrial as st
from seatrial.core.errors import InputError
from seatrial.core.signals import declare_signal
from seatrial.estimation.posterior.mode import find_mode

STATES, CONTROLS = {"u": "m/s", "lagging": "m/s"}, {"n": "rad/s"}
COEFFICIENTS = {"decay": "1/s", "gain": "m/(s rad)", "memory": "s"}
TRUTH = {"decay": 0.3, "gain": 0.01, "memory": 2.0}


def rates(params, state, control):
    (u, lagging), (n,) = state, control
    return params["gain"] * n - params["decay"] * u, (u - lagging) / params["memory"]


def own(derivative=rates, **changes):
    parts = {"states": STATES, "controls": CONTROLS, "coefficients": COEFFICIENTS} | changes
    return st.make_model("own", derivative, **parts)


def schedule(control=100.0):
    time = np.arange(0.0, 20.0, 0.1)
    return st.Schedule(time, {"n": np.full(time.size, control)})


def record_of(model, sigma=1e-3, sensors=("u",)):
    return st.simulate(
        model, TRUTH | {f"sigma_{one}": sigma for one in sensors}, schedule(), sensors, start={"u": 1.0}, key=3
    )


def test_motion_of_an_own_equation_is_its_closed_form():
    model = own()
    record = record_of(model)
    motion = st.simulate_motion(model, TRUTH, record, start={"u": 1.0, "lagging": 0.0})
    decay, final, rate, time = TRUTH["decay"], TRUTH["gain"] * 100 / TRUTH["decay"], 1 / TRUTH["memory"], record.time
    u = final + (1.0 - final) * np.exp(-decay * time)
    share = (1.0 - final) * rate / (rate - decay)
    lagging = final + share * np.exp(-decay * time) - (final + share) * np.exp(-rate * time)
    np.testing.assert_allclose(motion["u"], u, atol=1e-6)
    np.testing.assert_allclose(motion["lagging"], lagging, atol=1e-6)
    slope = jax.jacfwd(lambda k: st.simulate_motion(model, TRUTH | {"decay": k}, record, {"u": 1.0})["u"])(decay)
    exact = -100 * TRUTH["gain"] / decay**2 * (1 - np.exp(-decay * time)) - (1.0 - final) * time * np.exp(-decay * time)
    np.testing.assert_allclose(slope, exact, atol=1e-5)


@pytest.mark.proof
def test_coefficients_of_an_own_equation_are_found_with_their_units():
    model = own()
    record = record_of(model, sensors=("u", "lagging"))
    priors = {name: st.LogNormal(0.7 * value, 2.0) for name, value in TRUTH.items()}
    noise = {f"sigma_{one}": st.LogUniform(1e-4, 1e-2) for one in STATES}
    mode = find_mode(st.make_posterior(model, record, priors | noise, start={"u": 1.0}))
    table = mode.summary()
    for name, value in TRUTH.items():
        assert abs(table.loc[name, "mode"] - value) < 5 * table.loc[name, "sd"] < 0.05 * value
        assert table.loc[name, "unit"] == str(model.unit_of(model.coefficients[list(TRUTH).index(name)]))


@pytest.mark.proof
def test_own_equation_of_a_known_vehicle_has_its_posterior():
    vehicle = st.load_vehicle("remus100_surge")
    built = vehicle.build(free=["X_uabsu"])
    same = st.make_model(
        "same",
        lambda p, state, control: built.derivative({"X_uabsu": p["drag"]}, state, control),
        {"u": "m/s"},
        CONTROLS,
        {"drag": "kg/m"},
    )
    truth = {"X_uabsu": vehicle.coefficients["X_uabsu"], "sigma_u": 0.02}
    record = st.simulate(built, truth, schedule(120.0), ["u"], start={"u": 1.0}, key=1)
    noise, drag = {"sigma_u": st.LogUniform(0.002, 0.2)}, st.half_normal(10.0, upper=0.0)
    ours = st.make_posterior(same, record, noise | {"drag": drag}, start={"u": 1.0})
    theirs = st.make_posterior(built, record, noise | {"X_uabsu": drag}, start={"u": 1.0})
    z = ours.sample_prior(jax.random.key(0), 5)
    order = [[one.name.replace("drag", "X_uabsu") for one in ours.parameters].index(p.name) for p in theirs.parameters]
    density = [
        [float(one.log_prior(each) + one.log_likelihood(each)) for each in zs]
        for one, zs in ((ours, z), (theirs, z[:, jnp.array(order)]))
    ]
    np.testing.assert_allclose(density[0], density[1], rtol=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"states": {"u": "kn", "lagging": "m/s"}}, "which is 0.514444 units of SI"),
        ({"states": {"u": "rad/s", "lagging": "m/s"}}, "m/s, as seatrial has it"),
        ({"states": {"u": "m/s", "lagging": "furlong"}}, 'unknown unit "furlong"'),
        ({"states": {"u": "m/s", "udot2dot": "m/s"}}, "an invalid name of a signal"),
        ({"coefficients": {"decay": "1/s", "gain": "m/(s rad)"}}, "params['memory'], which is no coefficient"),
        ({"coefficients": COEFFICIENTS | {"X_u": "1/s"}}, "a unit like"),
        ({"derivative": lambda p, state, control: state[0]}, "a tuple of 2 rates"),
        ({"derivative": lambda p, state, control: state[:1]}, "1 rates"),
    ],
)
def test_equations_that_cannot_be_a_model(changes, words):
    with pytest.raises(InputError) as error:
        own(**changes)
    assert words in str(error.value)


def test_equation_may_divide_by_a_difference_of_states():
    model = st.make_model(
        "pole", lambda p, state, control: (p["k"] / (state[0] - state[1]), 0.0 * state[0]), STATES, {}, {"k": "m^2/s^3"}
    )
    assert [str(one) for one in model.coefficients] == ["k"]


def test_a_signal_keeps_the_unit_it_was_declared_with():
    declare_signal("bubble", "m")
    declare_signal("bubble", "m")
    with pytest.raises(InputError, match="declared before"):
        declare_signal("bubble", "m/s")


def test_motion_needs_the_controls_of_the_vehicle():
    record = record_of(own())
    other = st.make_model("other", lambda p, s, c: (c[0],), {"r": "rad/s"}, {"delta_r": "rad"}, {})
    with pytest.raises(InputError, match="delta_r among them"):
        st.simulate_motion(other, {}, record)
