"""The vehicle of a study: the paper's under both readings, and a user's own, good and bad."""

from pathlib import Path

import pytest

from seatrial.core.errors import InputError
from studies.remus100.vehicle_file import READINGS, RPM, paper_reading, read_vehicle
from tests.cases import U0

A, B = READINGS["A"], READINGS["B"]
PAPER = A.path.read_text(encoding="utf-8")
OWN = """
name = "a heavier one"
mass = "200 kg"
fixed = { X_udot = -20.0 }
coefficients = { X_u = "-10 kg/s", X_uabsu = -8.0, T_nabsn = "0.5 N/(rev/s)^2" }
trim = { n = "600 rpm" }
"""
"""At 10 rev/s the thrust is 50 N: 10 u + 8 u^2 = 50 at u = (-5 + sqrt(425)) / 8."""


def write(folder: Path, text: str) -> Path:
    path = folder / "own.toml"
    path.write_text(text)
    return path


def test_reading_a():
    """Printed -1.21, -2.93, 6.28 with T in 1e-2 N/(rev/s)^2, trim at 750 rpm, m - X_udot = 31.4 kg."""
    assert A.truth == pytest.approx({"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-2 / 39.47841760435743})
    assert A.printed_truth == pytest.approx({"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28})
    assert (A.trim, A.inertia) == pytest.approx((78.53981633974483, 31.4))
    assert (A.filter_noise, A.sigma) == (0.1, 0.0757)
    assert (A.steps / RPM, A.lowest / RPM, A.highest / RPM) == pytest.approx((400, 100, 200))
    assert A.thrust_filter / A.thrust_print == pytest.approx(100)
    assert (A.doubted, A.source.doubted.values, A.source.doubted.wide) == ("X_du3", [0.1, 1.0], 50.0)


def test_reading_b():
    """As reading A but with T in 1e-4 N/(rad/s)^2 and 125 rad/s."""
    assert B.truth == pytest.approx({"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4})
    assert B.printed_truth == pytest.approx(A.printed_truth)
    assert (B.trim, B.inertia, B.thrust_filter / B.thrust_print) == pytest.approx((125.0, 31.4, 1.0))
    assert (B.sigma, B.steps, B.highest) == pytest.approx((A.sigma, A.steps, A.highest))


def test_both_readings_have_the_same_trim():
    """Thrust, and so speed: 6.28e-2 12.5^2 = 6.28e-4 125^2, at 1.541862 m/s."""
    assert A.truth["T_nabsn"] * A.trim**2 == pytest.approx(B.truth["T_nabsn"] * B.trim**2, rel=1e-12)
    assert A.hull.trim["u"] == pytest.approx(U0, abs=1e-9)
    assert B.hull.trim["u"] == pytest.approx(1.541861549917, abs=1e-9)


def test_what_the_paper_prints_belongs_to_its_own_vehicle(tmp_path):
    assert A.printed(6.28) == 6.28
    assert read_vehicle(write(tmp_path, PAPER)).printed(6.28) is None
    assert read_vehicle(write(tmp_path, PAPER)).truth == paper_reading("A").truth


def test_another_vehicle_in_its_own_proportions(tmp_path):
    """Where the file is silent, noise and amplitudes keep the paper's shares of trim speed and trim propeller speed."""
    own = read_vehicle(write(tmp_path, OWN))
    speed = (-5 + 425**0.5) / 8
    assert own.hull.trim == pytest.approx({"u": speed, "n": 600 * RPM})
    assert (own.name, own.inertia, own.is_paper) == ("own", 220.0, False)
    assert own.truth == pytest.approx({"X_u": -10.0, "X_uabsu": -8.0, "T_nabsn": 0.5 / 39.47841760435743})
    assert own.printed_truth["T_nabsn"] == pytest.approx(6.28)
    assert (own.filter_noise, own.sigma) == pytest.approx((0.05 * speed, 0.05 * speed))
    assert (own.steps / RPM, own.lowest / RPM, own.highest / RPM) == pytest.approx((320, 80, 160))
    rate = own.model("X_du3").derivative({**own.truth, "X_du3": 2.0}, (speed + 1.0,), (0.0,))[0]
    assert rate == pytest.approx((-10 * (speed + 1) - 8 * (speed + 1) ** 2 + 2.0) / 220)


def test_the_example_is_a_vehicle():
    example = read_vehicle(Path(__file__).parents[3] / "examples" / "vehicle.toml")
    assert not example.is_paper
    assert example.hull.trim["u"] > 0


MISTAKES = {
    "unknown key": (("[noise]", "[noize]"), "key noize", 'did you mean "noise"?'),
    "unknown key in a table": (('steps = "400 rpm"', 'stebs = "400 rpm"'), "key inputs.stebs", "steps"),
    "missing key": (('mass = "30.47 kg"\n', ""), "key mass", "nothing"),
    "missing table": (('[trim]\nn = "750 rpm"\n', ""), "key trim", "nothing"),
    "missing coefficient": (("X_u = -1.21\n", ""), "key coefficients.X_u", "nothing"),
    "number without unit": (('"30.47 kg"', "30.47"), "key mass", '"30.47 kg"'),
    "word for a number": (("X_u = -1.21", "X_u = true"), "key coefficients.X_u", "True"),
    "text in a list of numbers": (("[0.1, 1.0]", '["a", 1.0]'), "key doubted.values.0", "'a'"),
    "one value too few": (("[0.1, 1.0]", "[0.1]"), "key doubted.values", "at least 2"),
    "unknown unit": (('"750 rpm"', '"750 rpn"'), "key trim.n", 'did you mean "rpm"?'),
    "unit of another dimension": (("X_u = -1.21", 'X_u = "-1.21 kg/m"'), "key coefficients.X_u", "kg/s"),
    "unit of no thrust": (("1e-2 N/(rev/s)^2", "1e-2 N"), "key units.printed_thrust", "kg m/rad^2"),
    "mass that is no number": (('"30.47 kg"', '"nan kg"'), "key mass", "nan"),
    "coefficient that is no number": (("X_u = -1.21", "X_u = nan"), "key coefficients.X_u", "finite"),
    "infinite coefficient": (("X_uabsu = -2.93", "X_uabsu = -inf"), "key coefficients.X_uabsu", "finite"),
    "doubted value that is no number": (("[0.1, 1.0]", "[0.1, nan]"), "key doubted.values.1", "finite"),
    "infinite prior": (("wide = 50.0", "wide = inf"), "key doubted.wide", "finite"),
    "deduction that is no number": (("thrust_deduction = 0.1", "thrust_deduction = nan"), "thrust_deduction", "nan"),
    "coefficient of zero": (("X_u = -1.21", "X_u = 0.0"), "key coefficients.X_u", "negative"),
    "drag that drives": (("X_uabsu = -2.93", "X_uabsu = 2.93"), "key coefficients.X_uabsu", "negative"),
    "added mass of the wrong sign": (("X_udot = -0.93", "X_udot = 0.93"), "key fixed.X_udot", "SNAME"),
    "doubted values alike": (("[0.1, 1.0]", "[1.0, 1.0]"), "key doubted.values", "different"),
    "a wide prior without the truth": (("wide = 50.0", "wide = 0.5"), "key doubted.wide", "larger"),
    "no name": (
        ('name = "REMUS 100, reading A (T in 1e-2 N/(rev/s)^2, trim 750 rpm)"', 'name = " "'),
        "key name",
        "no name",
    ),
    "steps beyond the trim": (('"400 rpm"', '"5000 rpm"'), "key inputs.steps", "trim.n"),
    "a mass of nothing": (('"30.47 kg"', '"1e-9 kg"'), "key mass", "answers in"),
    "a mass of everything": (('"30.47 kg"', '"1e300 kg"'), "key mass", "answers in"),
    "doubted value of zero": (("[0.1, 1.0]", "[0.0, 1.0]"), "key doubted.values", "0"),
    "no mass": (('"30.47 kg"', '"0 kg"'), "mass", "above 0"),
    "negative noise": (('"0.0757 m/s"', '"-1 m/s"'), "key noise.trial", "positive"),
    "amplitudes upside down": (('lowest = "100 rpm"', 'lowest = "300 rpm"'), "key inputs.lowest", "inputs.highest"),
    "thrust astern": (('n = "750 rpm"', 'n = "-750 rpm"'), "key trim.n", "positive"),
    "no equilibrium": (("6.28e-2 N", "6.28e3 N"), "trim", "balances the thrust"),
    "doubted term of another axis": (('"X_du3"', '"Y_v"'), "term Y_v", "axis Y does not move"),
    "doubted term that is there already": (('"X_du3"', '"X_u"'), "term X_u", "each regressor once"),
    "doubted term that is fixed": (('"X_du3"', '"X_udot"'), "key doubted.term", "X_udot"),
    "coefficient that is fixed": (("X_udot = -0.93", "X_u = -1.0"), "key fixed", "X_u"),
    "malformed TOML": (('name = "', 'name = = "'), "malformed TOML", "line"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_with_its_place(tmp_path, name):
    (old, new), *words = MISTAKES[name]
    assert old in PAPER
    with pytest.raises(InputError) as raised:
        read_vehicle(write(tmp_path, PAPER.replace(old, new)))
    text = str(raised.value)
    assert text.count("own.toml") == 1
    assert "remedy" in text
    for word in words:
        assert word in text


@pytest.mark.parametrize("path", ["absent.toml", "."])
def test_no_such_file(tmp_path, path):
    with pytest.raises(InputError, match=r"no such file|a folder") as raised:
        read_vehicle(tmp_path / path)
    assert str(tmp_path / path) in str(raised.value)


def test_a_file_that_is_not_text(tmp_path):
    path = tmp_path / "own.toml"
    path.write_bytes(b"name = \xff")
    with pytest.raises(InputError, match=r"own.toml:1"):
        read_vehicle(path)
