"""Two vehicles of the same names and different equations in one process: no path may serve one with what was compiled for the other.

The second has half the acceleration of the first, as a vehicle of twice the mass has, which is built of other parts and is the reference.
"""

from dataclasses import replace
from threading import Barrier, Thread

import numpy as np
import pytest

import seatrial as st
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.run import run_filter
from seatrial.numerics.gaussian import independent
from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation
from seatrial.vehicles.discretise import discretise
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.linearise import linearise
from seatrial.vehicles.remus100_fossen import remus100_fossen
from seatrial.vehicles.simulate import simulate
from seatrial.vehicles.whole import whole_vehicle

TERMS = ("X_uabsu", "T_nabsn")
TRUTH = {"X_uabsu": -6.0, "T_nabsn": 5e-4}
PRIORS = {"X_uabsu": st.Normal(-6.0, 2.0), "T_nabsn": st.LogNormal(5e-4, 1.5), "sigma_u": st.LogUniform(0.005, 0.2)}
FAMILY = st.Family("n", 100.0, duration=12.0, active=8.0, sample_time=0.25, kind="doublet")
STEP, COMMAND = np.full(48, 0.25), np.where(np.arange(48) < 24, 120.0, 80.0)[:, None]
SPEED = 1.0 + 0.3 * np.sin(np.arange(48) / 5.0)
RECORD = st.make_record(
    np.cumsum(STEP),
    {"n": COMMAND[:, 0], "u": SPEED},
    (st.Channel("n", "rad/s", "control"), st.Channel("u", "m/s", "measurement")),
    st.Provenance("own numbers", ""),
)


def of_terms(*terms, mass=30.0):
    return whole_vehicle(Hull("AUV", mass), terms, moves=("u",))


def of_mass(mass):
    return of_terms(*TERMS, mass=mass)


def halved(model):
    def derivative(params, state, control):
        return tuple(0.5 * rate for rate in model.derivative(params, state, control))

    return replace(model, derivative=derivative)


def simulated(model):
    return simulate(model, TRUTH, COMMAND, STEP, [1.0])


def filtered(model):
    space = discretise(model, ["udot"], independent(np.ones(3), np.full(3, 0.1)), np.zeros(3), [0.05], (6.0, 5e-4))
    return run_filter(ExtendedKalmanFilter(), space, COMMAND, np.zeros((48, 1)), STEP).means


def matrices(model):
    return np.hstack(linearise(model, TRUTH, [1.2], [110.0]))


def posterior(model):
    return st.make_posterior(model, RECORD, PRIORS, start={"u": 1.0})


def record_drawn(model):
    truth = {**TRUTH, "sigma_u": 0.02}
    return st.simulate(model, truth, FAMILY.schedule(20.0, 4.0), ["u"], start={"u": 1.0}, key=1).measurement


def mode(model):
    return list(st.find_mode(posterior(model), starts=64, tries=1).by_name.values())


def drawn_and_predicted(model):
    fit = posterior(model)
    draws = st.sample(fit, "adaptive-metropolis", settings=st.ChainSettings(chains=4, warmup=100, draws=100))
    return [*draws.array(TERMS).mean(0), *st.predict(fit, draws, RECORD, start={"u": 1.0}, n=20).mean[:, 0]]


def designed(model):
    priors = {name: PRIORS[name] for name in TERMS}
    asked = st.make_design_problem(model, priors, FAMILY, [10.0, 20.0], [4.0, 8.0], {"u": 0.02}, start={"u": 1.0})
    return list(st.design_trial(asked).sd_after.values())


@pytest.mark.proof
@pytest.mark.parametrize(
    "path",
    [
        simulated,
        filtered,
        matrices,
        record_drawn,
        mode,
        designed,
        drawn_and_predicted,
    ],
)
def test_each_has_its_own_answer(path):
    light, own, heavy = (np.asarray(path(model)) for model in (of_mass(30.0), halved(of_mass(30.0)), of_mass(60.0)))
    assert not np.allclose(own, light, rtol=1e-3)
    np.testing.assert_allclose(own, heavy, rtol=1e-9)


def test_models_are_equal_if_their_functions_are():
    model = of_mass(30.0)
    views = replace(model, outputs={"phi": lambda *_: 0.0})
    late = replace(model, exact_lags=(lambda *_: 0.0,))
    for other in (halved(model), views, late):
        assert other != model
        assert other == replace(other, name="another")
        assert hash(other) == hash(replace(other, name="another"))


def bodies(**options):
    return st.load_vehicle("remus100_prestero").build(["u", "v", "r"], positions=["x", "y"], **options)


def lagged(time):
    return with_actuators(of_mass(30.0), {"n": Actuator(time)}, ["lag_n"])


def axes(known):
    return axes_vehicle("ship", [axis_equation("N", ["N_r", "N_delta_r"], known=known)])


@pytest.mark.parametrize(
    ("one", "same", "other"),
    [
        (lambda: of_mass(30.0), lambda: of_mass(np.float64(30.0)), lambda: of_mass(31.0)),
        (lambda: of_mass(30.0), lambda: of_mass(30.0), lambda: of_terms("X_u", "T_nabsn")),
        (lambda: of_terms("X_uabsu"), lambda: of_terms("X_uabsu"), lambda: of_terms("X_absuu")),
        (bodies, bodies, lambda: bodies(current="state")),
        (
            lambda: bodies(current=(0.5, 0.0, 0.0)),
            lambda: bodies(current=[0.5, 0.0, 0.0]),
            lambda: bodies(current=[0.0, 0.5, 0.0]),
        ),
        (lambda: lagged(0.5), lambda: lagged(0.5), lambda: lagged(0.6)),
        (lambda: axes({"N_v": 1.0}), lambda: axes({"N_v": 1.0}), lambda: axes({"N_v": 2.0})),
        (remus100_fossen, remus100_fossen, lambda: remus100_fossen("euler")),
    ],
)
def test_equal_parts_give_equal_models(one, same, other):
    assert one() == same()
    assert one() != other()


def test_a_model_keeps_its_parts_if_the_callers_mapping_changes():
    parts = {"n": Actuator(0.5)}
    model = with_actuators(of_mass(30.0), parts)
    parts["n"] = Actuator(2.0)
    for one in (model, with_actuators(of_mass(30.0), {"n": Actuator(0.5)})):
        assert one.derivative(TRUTH, (1.0, 0.0), (1.0,))[1] == pytest.approx(1 / 0.5)


def test_threads_share_one_model():
    found, together = [], Barrier(4)

    def build():
        together.wait()
        found.append(of_mass(37.0))

    threads = [Thread(target=build) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [model == found[0] for model in found] == [True] * 4
