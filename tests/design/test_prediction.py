"""Stated predictions against closed forms, and other sensors against plans of their own."""

import numpy as np
import pytest

from seatrial.core.errors import InputError, NumericalError
from seatrial.design.fisher_utilities import find_criterion
from seatrial.design.sensor_choice import SensorChoice, sensor_worth
from seatrial.design.stated_prediction import prediction
from seatrial.design.trial_plan import plan_trial
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.whole import whole_vehicle

MASS, DRAG = 30.0, -6.0
MODEL = whole_vehicle(Hull("glider", MASS), ("X_uabsu", "X_tau_X"), moves=("u",))


def test_the_way_of_a_coasting_vehicle_and_its_slope():
    """m du/dt = -d u^2 from U: the way is (m / d) ln(1 + U d t / m)."""
    found = prediction(MODEL, "distance", (1.5,), (0.0,), 20.0, 0.05)
    value, gradient = found.at(np.array([DRAG, 1.0]))
    x = -DRAG * 1.5 * 20.0 / MASS
    assert value == pytest.approx(MASS / -DRAG * np.log1p(x), rel=1e-9)
    assert gradient[0] == pytest.approx(MASS / DRAG**2 * (np.log1p(x) - x / (1 + x)), rel=1e-8)
    assert gradient[1] == pytest.approx(0.0, abs=1e-12)


def test_a_speed_and_an_advance_backwards():
    speed, _ = prediction(MODEL, "u", (1.5,), (0.0,), 20.0, 0.05).at(np.array([DRAG, 1.0]))
    assert speed == pytest.approx(1.5 / (1 - DRAG * 1.5 * 20.0 / MASS), rel=1e-9)
    advance, _ = prediction(MODEL, "advance", (-1.5,), (0.0,), 20.0, 0.05).at(np.array([DRAG, 1.0]))
    distance, _ = prediction(MODEL, "distance", (-1.5,), (0.0,), 20.0, 0.05).at(np.array([DRAG, 1.0]))
    assert advance == pytest.approx(-distance, rel=1e-12)


def test_predictions_that_cannot_be_made():
    with pytest.raises(InputError, match="prediction"):
        prediction(MODEL, "theta", (1.5,), (0.0,), 20.0, 0.05)
    with pytest.raises(NumericalError, match="distance diverges"):
        prediction(MODEL, "distance", (1.5,), (0.0,), 20.0, 0.05).at(np.array([60.0, 1.0]))


def test_other_sensors_against_plans_of_their_own():
    time = np.arange(200) * 0.1
    control = np.where(np.sin(time) > 0, 12.0, 4.0)[:, None]
    draws, cov = np.array([[-6.0, 1.0], [-5.0, 0.9]]), np.diag([4.0, 0.04])
    criterion, sensors = find_criterion("fisher-d", cov), {"u": 0.01, "udot": 0.02}
    choices = [SensorChoice((1, 1), (1.0, 1.0)), SensorChoice((5, 0), (1.0, 1.0)), SensorChoice((2, 10), (0.5, 1.0))]
    plan = plan_trial(MODEL, (1.2,), sensors, 200, 0.1)
    found = sensor_worth(plan, control, draws, cov, criterion, choices)
    for worth, choice in zip(found, choices, strict=True):
        mask = np.zeros((200, 2))
        for channel, every in enumerate(choice.every):
            mask[:: every or 1000, channel] = float(every > 0)
        noise = {name: sd * choice.noise[i] for i, (name, sd) in enumerate(sensors.items())}
        own = plan_trial(MODEL, (1.2,), noise, 200, 0.1, mask)
        information = np.stack([np.asarray(own.information(values, control)) for values in draws])
        assert worth.utility == pytest.approx(float(criterion(information).mean()), rel=1e-9)
        sd = np.sqrt(np.mean([np.diag(np.linalg.inv(f + np.linalg.inv(cov))) for f in information], 0))
        np.testing.assert_allclose(worth.sd, sd, rtol=1e-9)
