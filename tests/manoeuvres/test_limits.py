import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.manoeuvres.manoeuvre import Limits, Manoeuvre, check_limits

CONTROL = np.array([0.0, 1.0, 3.0, -2.0])


@pytest.mark.parametrize(
    ("limits", "broken"),
    [
        (Limits(), {}),
        (Limits(lower=-2.0, upper=3.0, rate=50.0), {}),
        (Limits(upper=2.5), {"upper": (3.0, 2.5)}),
        (Limits(lower=-1.0), {"lower": (-2.0, -1.0)}),
        (Limits(rate=40.0), {"rate": (50.0, 40.0)}),
        (Limits(lower=0.0, upper=1.0, rate=1.0), {"upper": (3.0, 1.0), "lower": (-2.0, 0.0), "rate": (50.0, 1.0)}),
    ],
)
def test_excess(limits, broken):
    assert limits.excess(CONTROL, 0.1) == {name: pytest.approx(pair) for name, pair in broken.items()}


@pytest.mark.parametrize("value", [-1.0, 0.0, 1.0])
def test_reaching_a_limit_is_allowed(value):
    rising = value + np.array([0.0, 1.0, 1.0])
    assert Limits(lower=value, upper=value + 1.0, rate=10.0).excess(rising, 0.1) == {}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"lower": 2.0, "upper": 1.0}, "lower below upper"),
        ({"lower": 1.0, "upper": 1.0}, "lower below upper"),
        ({"upper": np.nan}, "Limits, upper"),
        ({"lower": -np.inf}, "None for no bound"),
        ({"upper": "157 rad/s"}, "Limits, upper"),
        ({"rate": 0.0}, "above 0"),
        ({"rate": -1.0}, "above 0"),
    ],
)
def test_impossible_limits(settings, message):
    with pytest.raises(InputError, match=message):
        Limits(**settings)


def test_excess_of_a_batch_is_along_time():
    batch = np.array([[0.0, 0.1, 0.2], [50.0, 50.1, 50.2]])
    assert Limits(rate=1.001).excess(batch, 0.1) == {}


def manoeuvre(signal):
    return Manoeuvre("sweep", "delta_r", 2.0, {}, signal)


def test_sample_times():
    time, control = manoeuvre(np.cos).sample(0.1)
    assert np.allclose(time, np.linspace(0, 1.9, 20), atol=1e-15)
    assert np.array_equal(control, np.cos(time))


def test_refusal_names_every_limit_and_the_value_reached():
    with pytest.raises(InputError) as caught:
        check_limits(manoeuvre(lambda time: 3 * time), Limits(lower=-1.0, upper=4.0, rate=2.0), 0.5)
    assert "control delta_r" in caught.value.where
    assert caught.value.found == "upper limit: reaches 4.5, limit 4; rate limit: reaches 3, limit 2 (SI)"


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_control_that_is_not_finite_never_passes(value):
    with pytest.raises(InputError):
        check_limits(manoeuvre(lambda time: np.where(time > 1, value, 0.0)), Limits(-1.0, 1.0, 1.0), 0.5)
