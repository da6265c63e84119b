"""What is wrong with a new campaign stands beside the field that says it."""

import pytest

pytest.importorskip("nicegui", reason="the dashboard needs NiceGUI: pip install -e '.[dashboard]'")

from seatrial.apps.dashboard.model_queries import begun
from seatrial.apps.dashboard.new_campaign_rows import field_of
from seatrial.apps.dashboard.pages.new_campaign import _remedied
from seatrial.core.errors import InputError

SAID = {
    "mass": "30 kg",
    "thrust_deduction": "0.1",
    "speed": "1.5 m/s",
    "duration": "60 s",
    "moves": "u",
    "known": ("X_udot -1.0",),
    "seek": ("X_uabsu -4.5 to -1.5", "T_nabsn 0.018 to 0.034 N/(rev/s)^2"),
    "optional": ("X_u -3 to 0",),
    "control": ("n 1200 rpm, 700 to 1600 rpm, 800 rpm/s",),
    "sensor": ("u 0.05 m/s, 5 Hz",),
    "limit": ("u above 0.5 m/s", "distance below 150 m"),
    "goal": ("X_uabsu 3 %",),
}
PROPELLED = {
    "known": ("X_udot -1.0", "X_tau_X 1.0"),
    "seek": ("X_uabsu -4.5 to -1.5",),
    "control": ("tau_X 10 N, 2 to 20 N",),
}
"""Of a vehicle whose thrust is commanded, so that no thrust deduction has an effect."""


def refusal(folder, **other):
    said = {option: value for option, value in {**SAID, **other}.items() if value}
    with pytest.raises(InputError) as caught:
        begun(str(folder), "boat", "", tuple(said.items()))
    return caught.value


@pytest.mark.parametrize(
    ("other", "option", "name"),
    [
        ({"thrust_deduction": "1"}, "thrust_deduction", ""),
        ({"thrust_deduction": "0.1", **PROPELLED}, "thrust_deduction", ""),
        ({"mass": "0 kg"}, "mass", ""),
        ({"inertia": "1, 2 kg m^2"}, "inertia", ""),
        ({"inertia": "1, 2, 3 kg m^2"}, "inertia", ""),
        ({"duration": "-1 s"}, "duration", ""),
        ({"duration": "0.5 s"}, "duration", ""),
        ({"known": ("X_udot 1.0",)}, "known", "X_udot"),
        ({"known": ("Y_vdot -1",)}, "known", "Y_vdot"),
        ({"known": ("X_udot -1", "X_udot -2")}, "known", "X_udot"),
        ({"optional": ("Y_v -3 to 0",)}, "optional", "Y_v"),
        ({"optional": ("X_uabsu -3 to 0",)}, "optional", "X_uabsu"),
        ({"seek": ("X_uabsu -4 to -1", "X_uabsu -3 to -1")}, "seek", "X_uabsu"),
        ({"control": ("n 1200 rpm",)}, "control", "n"),
        ({"control": ("delta_r 0 deg, -15 to 15 deg",)}, "control", "delta_r"),
        ({"sensor": ("v 0.05 m/s",)}, "sensor", "v"),
        ({"sensor": ("u 0.05 m/s", "u 0.1 m/s")}, "sensor", "u"),
        ({"limit": ("distance above 3 m",)}, "limit", "distance"),
        ({"limit": ("n above 3 rpm",)}, "limit", "n"),
        ({"goal": ("Y_v 3 %",)}, "goal", "Y_v"),
    ],
)
def test_every_refusal_of_the_form_has_its_field(tmp_path, other, option, name):
    assert field_of(refusal(tmp_path, **other).where) == (option, name)


def test_no_thrust_deduction_is_none(tmp_path):
    text, _ = begun(str(tmp_path), "boat", "", tuple({**SAID, **PROPELLED, "thrust_deduction": "0"}.items()))
    assert "thrust_deduction =" not in text


def test_a_form_is_told_to_empty_a_field(tmp_path):
    error = refusal(tmp_path, **PROPELLED)
    assert "; empty this field, or add thrust such as T_nabsn" in _remedied(error, "empty this field")
    assert str(error).startswith("--thrust-deduction\n  found: ")
