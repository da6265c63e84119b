"""A campaign of a vehicle with a tether, whose log is made by plain Newtonian mechanics: what is found of its drag, and what is refused."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.data.true_vehicle import true_vehicle
from seatrial.campaign.inference.posterior import build_posterior, initial_state
from seatrial.compiled.random_keys import random_key
from seatrial.core.errors import InputError
from seatrial.estimation.diagnostics.identifiability import identifiability_of_fit
from seatrial.estimation.posterior.first_guess import first_guess
from seatrial.estimation.posterior.mode import find_mode
from seatrial.messages.identifiability import identifiability_cautions
from tests.campaign.small import write_summary
from tests.campaign.test_thrusters import CAMPAIGN, INERTIA, MASS, PLACES, PUSHES, TRUTH, law
from tests.campaigns import write_campaign

POINT, DRAG = np.array([-0.6, 0.1]), {"tether_linear": 6.0, "tether_quadratic": 25.0}
NOISE = 0.005
GAIN = CAMPAIGN[CAMPAIGN.index("[prior.gain_f_2]") : CAMPAIGN.index("[sensors.u]")]
TETHER = """
[vehicle.tether]
point = ["-60 cm", "0.1 m", "0 m"]
linear = "2 N s/m"

"""
PRIORS = """
[prior.tether_linear]
distribution = "uniform"
lower = 0.0
upper = 40.0

[prior.tether_quadratic]
distribution = "half-normal"
scale = 50.0
lower = 0.0

"""
TOWED = CAMPAIGN.replace(GAIN, PRIORS).replace("[vehicle.thrust_laws", f"{TETHER}[vehicle.thrust_laws")


def rates(nu, force):
    """m (udot - v r) = X, m (vdot + u r) = Y, I rdot = N, each with linear damping, and the tether's drag at its point."""
    u, v, r = nu
    local = np.array([u - r * POINT[1], v + r * POINT[0]])
    pull = -(DRAG["tether_linear"] + DRAG["tether_quadratic"] * np.hypot(*local)) * local
    x, y = force @ PUSHES + pull + [TRUTH["X_u"] * u, TRUTH["Y_v"] * v]
    turning = np.sum(force * (PLACES[:, 0] * PUSHES[:, 1] - PLACES[:, 1] * PUSHES[:, 0]))
    n = turning + TRUTH["N_r"] * r + POINT[0] * pull[1] - POINT[1] * pull[0]
    return np.array([x / MASS + v * r, y / MASS - u * r, n / INERTIA])


@pytest.fixture(scope="module")
def log():
    rng = np.random.default_rng(7)
    command = np.repeat(rng.integers(1100, 1900, (60, 3)), 10, axis=0).astype(float)
    nu, motion = np.zeros(3), []
    for row in law(command):
        motion.append(nu)
        for _ in range(50):
            nu = nu + 0.002 * rates(nu + 0.001 * rates(nu, row), row)
    return command, np.array(motion) + NOISE * rng.normal(size=(len(motion), 3))


def campaign(folder, *changes, log=None):
    write_campaign(folder, TOWED, *changes)
    if log is not None:
        rows = [
            ",".join(f"{x:.8g}" for x in (0.1 * k, *c, *nu, 0.0)) for k, (c, nu) in enumerate(zip(*log, strict=True))
        ]
        (folder / "log.csv").write_text("t,pwm[0],pwm[1],pwm[2],u,v,r,psi\n" + "\n".join(rows) + "\n")
    return load_campaign(folder)


def test_least_squares_finds_it_from_the_measured_motion(tmp_path, log):
    found = campaign(tmp_path, log=log)
    (record,), model = get_trials(found).fit, found.model(found.full)
    guess = first_guess(model, [record], [initial_state(found, model, record)], found.priors)
    for name, value in {**TRUTH, **DRAG}.items():
        assert guess[name] == pytest.approx(value, rel=0.05), name


@pytest.mark.proof
def test_a_straight_run_cannot_tell_it_from_damping_ahead(tmp_path):
    """Nothing but u moves, and the tether pulls along the axis: its drag is that of X_u and X_uabsu, and the answer says what helps."""
    command = np.repeat(np.random.default_rng(3).integers(1550, 1900, 60), 10)
    u, motion = 0.0, []
    for force in law(command.astype(float)):
        motion.append(u)
        for _ in range(50):
            u += (
                0.002
                * (2 * force + (TRUTH["X_u"] - DRAG["tether_linear"] - DRAG["tether_quadratic"] * abs(u)) * u)
                / MASS
            )
    shown = np.column_stack([motion, np.zeros((600, 2))]) + NOISE * np.random.default_rng(4).normal(size=(600, 3))
    log = np.column_stack([command, command, np.full(600, 1500)]), shown
    found = campaign(tmp_path, ('"0.1 m", "0 m"]\nlinear', '"0 m", "0 m"]\nlinear'), log=log)
    posterior = build_posterior(found, found.full, get_trials(found).fit)
    judged = identifiability_of_fit(posterior, find_mode(posterior, key=random_key(1, "mode")))
    assert [one.names for one in judged.groups] == [("X_u", "tether_linear")]
    said = "\n".join(identifiability_cautions(judged))
    assert "X_u - tether_linear to 0." in said
    assert "a trial that moves along and about several axes at once, or the same trial without the tether" in said


REFUSED = {
    "a point of two numbers": ([('"0.1 m", "0 m"]\nlinear', '"0.1 m"]\nlinear')], ("vehicle.tether.point",)),
    "a point without a unit": ([('"-60 cm"', "-0.6")], ("vehicle.tether.point", '"m"')),
    "a negative drag": ([('"2 N s/m"', '"-2 N s/m"')], ("tether, linear", "-2", "0 or more")),
    "a drag in another unit": ([('"2 N s/m"', '"2 N s^2/m^2"')], ("vehicle.tether.linear", "kg/s")),
    "a prior below 0": (
        [
            (
                '[prior.tether_linear]\ndistribution = "uniform"\nlower = 0.0',
                '[prior.tether_linear]\ndistribution = "uniform"\nlower = -1.0',
            )
        ],
        ("prior.tether_linear", "below 0"),
    ),
    "no tether": ([(TETHER, "")], ("prior.tether_linear", "add [vehicle.tether]")),
    "no drag": (
        [(PRIORS, ""), ('linear = "2 N s/m"\n', "")],
        ("vehicle.tether", "a key without effect: it has no drag"),
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_impossible_tether_is_refused_by_key(tmp_path, what):
    changes, parts = REFUSED[what]
    with pytest.raises(InputError) as refused:
        campaign(tmp_path, *changes)
    for part in parts:
        assert part in str(refused.value)


def test_what_an_earlier_campaign_found_of_it_is_sought_again(tmp_path):
    """With its uncertainty, where the vehicle has a tether; without one it is left alone."""
    write_summary(tmp_path / "first", ("X_u",), tether_linear=(6.0, 0.3), X_u=(-12.0, 0.1))
    known = ('moves = ["u"', 'priors_from = ["../first"]\nmoves = ["u"'), (PRIORS, "")
    found = campaign(tmp_path / "second", *known)
    prior = found.priors["tether_linear"]
    assert (float(prior.mean), float(prior.sd)) == pytest.approx((6.0, 0.3), rel=0.05)
    assert "tether_linear" not in campaign(tmp_path / "third", *known, (TETHER, "")).priors


def test_a_simulated_vehicle_drags_what_its_truth_says(tmp_path):
    """The truth may name what has a prior; what it does not name is as stated."""
    trimmed = ("[vehicle.tether]", '[vehicle.trim]\nf_2 = "0 N"\nf_3 = "0 N"\n\n[vehicle.tether]')
    simulated = (TOWED[TOWED.index("[import]") :], "[truth]\nX_u = -12.0\nY_v = -25.0\nN_r = -2.0\n")
    shown = {}
    for name, line in {"named": "tether_linear = 6.0\n", "stated": ""}.items():
        found = campaign(tmp_path / name, (simulated[0], simulated[1] + line), trimmed)
        true = true_vehicle(found)
        nu = [0.5, 0.1, 0.2]
        state = tuple(dict(zip("uvr", nu, strict=True)).get(one, 0.0) for one in true.simulator.model.states)
        shown[name] = np.array(true.simulator.model.derivative(true.values, state, (0.0,) * 3), float)[:3]
    local = np.array([0.5 - 0.2 * POINT[1], 0.1 + 0.2 * POINT[0]])
    pull = -(6.0 - 2.0) * local
    expected = [*(pull / MASS), (POINT[0] * pull[1] - POINT[1] * pull[0]) / INERTIA]
    np.testing.assert_allclose(shown["named"] - shown["stated"], expected, rtol=1e-9)
    with pytest.raises(InputError, match=r"(?s)truth\.tether_linear.*-6.*0 or more"):
        campaign(tmp_path / "bad", (simulated[0], simulated[1] + "tether_linear = -6.0\n"), trimmed)
