import pytest

from seatrial.core.errors import InputError, nearest
from seatrial.core.signals import Dimension, signal_label, signal_unit


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("u", "m/s"),
        ("udot", "m/s^2"),
        ("r", "rad/s"),
        ("rdot", "rad/s^2"),
        ("theta", "rad"),
        ("n", "rad/s"),
        ("delta_s", "rad"),
        ("tau_X", "kg m/s^2"),
        ("tau_N", "kg m^2/s^2"),
        ("q_w", "1"),
        ("n_act", "rad/s"),
        ("n_actdot", "rad/s^2"),
        ("current_x", "m/s"),
        ("f_1", "kg m/s^2"),
        ("force_Z", "kg m/s^2"),
        ("moment_K", "kg m^2/s^2"),
        ("V", "V"),
    ],
)
def test_signal_unit(name, unit):
    assert signal_unit(name) == unit


@pytest.mark.parametrize(
    ("dimension", "text"),
    [
        (Dimension(), "1"),
        (Dimension(s=-1), "1/s"),
        (Dimension(kg=1, m=2, rad=-2), "kg m^2/rad^2"),
        (Dimension(kg=1, s=-1, rad=-3), "kg/(s rad^3)"),
        (Dimension(m=-1, s=2), "s^2/m"),
    ],
)
def test_dimension_prints_as_si(dimension, text):
    assert str(dimension) == text


def test_error_says_where_what_and_how():
    error = InputError("a.toml, key mass", found="-3 kg", expected="a positive mass", remedy="give the dry mass")
    assert all(part in str(error) for part in ("a.toml, key mass", "-3 kg", "a positive mass", "give the dry mass"))
    assert nearest("delta_t", ["u", "delta_r"]) == 'did you mean "delta_r"?'
    assert nearest("xyz", ["u", "v"]) == "use one of: u, v"


def test_forces_on_a_gauge_have_symbols_as_other_signals_have():
    labels = [signal_label(name) for name in ("force_X", "moment_N", "force_Ydot", "delta_r", "udot", "z")]
    assert labels == ["F_X", "M_N", r"\dot{F_Y}", r"\delta_r", r"\dot{u}", "z"]
