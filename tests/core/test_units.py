import subprocess
import sys
from math import pi

import pint
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.units import UNITS, _parse, quantity, to_si


@pytest.mark.parametrize(
    ("text", "si", "value"),
    [
        ("200 rpm", "rad/s", 200 * 2 * pi / 60),
        ("12.5 rev/s", "rad/s", 25 * pi),
        ("3 kn", "m/s", 3 * 1852 / 3600),
        ("90 deg", "rad", pi / 2),
        ("10 deg/s", "rad/s", pi / 18),
        ("6.28e-2 N/(rev/s)^2", "kg m/rad^2", 6.28e-2 / (2 * pi) ** 2),
        ("1.5 t", "kg", 1500.0),
        ("250 g", "kg", 0.25),
        ("10 min", "s", 600.0),
        ("2 h", "s", 7200.0),
        ("20 ms", "s", 0.02),
        ("5 us", "s", 5e-6),
        ("7 ns", "s", 7e-9),
        ("1 nmi", "m", 1852.0),
        ("35 cm", "m", 0.35),
        ("2 kN", "kg m/s^2", 2000.0),
        ("4 Pa", "N/m^2", 4.0),
        ("50 Hz", "1/s", 50.0),
        ("-1.21 kg/s", "kg/s", -1.21),
        ("+.5e1m", "m", 5.0),
        ("3 N*m", "J", 3.0),
        ("2 W", "N m/s", 2.0),
        ("0.1", "1", 0.1),
        ("5 percent", "1", 0.05),
        ("5 %", "1", 0.05),
        ("5%", "1", 0.05),
        ("3 kg·m²s⁻²", "N*m", 3.0),
        ("3 kg m / s ** 2", "N", 3.0),
        ("4 1/(s m)", "1/(m s)", 4.0),
        ("2 mm m", "m^2", 0.002),
        ("6 (rev/(s))^-1", "s/rad", 6 / (2 * pi)),
        ("1 kg s^25/m^26", "kg s^25/m^26", 1.0),
    ],
)
def test_quantity_in_si(text, si, value):
    assert quantity(text, si, "here") == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize("name", ["X_uabsu", "X_du3", "X_udot", "T_nabsn", "N_delta_r", "Y_uudelta_r", "X_tau_X"])
def test_unit_of_every_coefficient_is_readable(name):
    unit = CoefficientName.parse(name).unit
    assert to_si(2.5, unit, unit, "here") == 2.5


def test_a_plain_number_needs_no_unit():
    assert quantity(0.1, "1", "here") == 0.1
    assert quantity(3, "1", "here") == 3.0


@pytest.mark.parametrize(
    ("text", "si"),
    [
        ("5 Hz", "rad/s"),
        ("5 rad/s", "1/s"),
        ("3 m", "s"),
        ("90 deg", "1"),
        ("1 kg", "N"),
        ("2 N", "N*m"),
        ("200 rpm", "m/s"),
        ("3", "kg"),
    ],
)
def test_wrong_dimension(text, si):
    with pytest.raises(InputError, match=f'a unit like "{si}"'.replace("*", r"\*")):
        quantity(text, si, "vehicle.toml, key x")


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("3 knt", '"knot"'),
        ("200 RPM", 'did you mean "rpm"?'),
        ("3 kt", 'write "kn"'),
        ("3 knots", 'write "kn"'),
        ("5 KN", 'did you mean "kN" or "kn"?'),
        ("3 meters", '"meter"'),
        ("2 degre", '"degree"'),
        ("1 xyz", "use one of: m/s, kn"),
        ("1 rads", '"rad'),
        ("1 metres per sec", 'as in "m/s"'),
        ("1 per s", "with / for per"),
    ],
)
def test_unknown_unit(text, remedy):
    with pytest.raises(InputError, match=f'unknown unit "{text.split()[1]}"') as caught:
        quantity(text, "m/s", "here")
    assert remedy in caught.value.remedy


@pytest.mark.parametrize("value", [200, 12.5, float("nan")])
def test_bare_number_where_a_unit_is_needed(value):
    with pytest.raises(InputError, match="without a unit"):
        quantity(value, "rad/s", "here")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "m",
        "fast",
        "nan m",
        "inf m",
        "1e400 m",
        "1,5 m",
        "1_000 m",
        "1 2 m",
        None,
        True,
        [1, "m"],
    ],
)
def test_malformed_quantity(text):
    with pytest.raises(InputError) as caught:
        quantity(text, "m", "vehicle.toml, key x")
    assert caught.value.where == "vehicle.toml, key x"


def test_nan_is_no_quantity():
    with pytest.raises(InputError):
        quantity(float("nan"), "1", "here")


@pytest.mark.parametrize(
    "unit",
    [
        "m^",
        "m**",
        "*m",
        "m//s",
        "/s",
        "m^m",
        "m()",
        "()",
        "m^99",
        "-m",
        "m+m",
        "m - s",
        "2 m",
        "m/2",
        "'m'",
        "m[s]",
        "(m",
        "m)",
        "N/(rev/s",
        "m,s",
        "m;s",
        "m@s",
        "m<s",
        "m=",
        "m!",
        "m#",
        "{m}",
    ],
)
def test_malformed_unit(unit):
    with pytest.raises(InputError, match="cannot be read"):
        to_si(1.0, unit, "m", "here")


@pytest.mark.parametrize(
    "text",
    [
        "1 m**9**9**9/s",
        "1 m*9^9^9^9",
        "1 " + "(" * 20 + "km" + "^9)" * 20,
        "1 h^27 nmi^27 kN^27 t^27",
        "1" + " " * 100_000 + "\n",
        "1 " + "m" * 100_000,
        "1 " + "(" * 100_000,
        "9" * 100_000 + " m",
    ],
)
def test_what_would_be_computed_for_ever_is_refused_at_once(text):
    code = f"from seatrial.core.units import quantity; quantity({text[:60]!r} + {text[60:]!r}, 'm', 'here')"
    result = subprocess.run([sys.executable, "-"], input=code, capture_output=True, text=True, timeout=20)
    assert "InputError: here" in result.stderr
    assert len(result.stderr) < 3000


@pytest.mark.parametrize(
    ("text", "si", "remedy"),
    [
        ("1500", "rad/s", 'write "1500 rpm" or "1500 deg/s" or "1500 rad/s", as intended'),
        (0.05, "m/s", 'write "0.05 m/s" or "0.05 kn", as intended'),
        ("0.3", "kg/m", 'write "0.3 kg/m", as intended'),
        ("2 s", "rad", "to one of: deg, rad"),
    ],
)
def test_a_unit_of_the_same_quantity_is_suggested(text, si, remedy):
    with pytest.raises(InputError) as caught:
        quantity(text, si, "here")
    assert remedy in caught.value.remedy


ONE = {"m": 1.0, "kn": 1852 / 3600, "rpm": 2 * pi / 60, "N": 1.0, "ms": 1e-3, "g": 1e-3, "deg": pi / 180}


def larger(part):
    """An expression and its worth in SI, from smaller ones."""
    return st.one_of(
        st.tuples(part, st.sampled_from([" ", "*", "·"]), part).map(
            lambda x: (f"{x[0][0]}{x[1]}{x[2][0]}", x[0][1] * x[2][1])
        ),
        st.tuples(part, part).map(lambda x: (f"({x[0][0]})/({x[1][0]})", x[0][1] / x[1][1])),
        st.tuples(part, st.sampled_from([-2, -1, 1, 2])).map(lambda x: (f"({x[0][0]})^{x[1]}", x[0][1] ** x[1])),
    )


@given(st.recursive(st.sampled_from(sorted(ONE.items())), larger, max_leaves=6))
def test_an_expression_is_worth_what_its_parts_are(both):
    text, expected = both
    assume(len(text) <= 120)
    unit = _parse(text, "1", "here")
    assert unit.factor == pytest.approx(expected, rel=1e-12)


PINT = pint.UnitRegistry()
ANGLES = pint.UnitRegistry(None)
"""In which an angle is a dimension, as it is here."""
for definition in ("meter = [length] = m", "second = [time] = s", "kilogram = [mass] = kg", "radian = [angle] = rad"):
    ANGLES.define(definition)


@pytest.mark.parametrize("unit", UNITS)
def test_every_unit_is_worth_what_pint_says(unit):
    theirs = PINT.Quantity(1.0, {"%": "percent", "rev": "revolution"}.get(unit, unit)).to_base_units().m
    assert _parse(unit, "1", "here").factor == pytest.approx(theirs, rel=1e-14)


@pytest.mark.parametrize("unit", ["m/s", "kg*m/s^2", "1/s", "rad/s", "kg*m/rad^2", "kg/m", "m^2", "rad^2/s", "rad"])
def test_dimensions_read_as_pint_writes_them(unit):
    with pytest.raises(InputError) as caught:
        to_si(1.0, unit, "kg^7", "here")
    theirs = str(ANGLES.Unit(unit.replace("^", "**")).dimensionality)
    ours = caught.value.found.split("(")[-1].removesuffix(")")
    assert [sorted(part.split(" * ")) for part in ours.split(" / ")] == [
        sorted(part.split(" * ")) for part in theirs.split(" / ")
    ]


@pytest.mark.parametrize(("text", "meant"), [("0,05 m/s", "0.05 m/s"), ("-1,5m/s", "-1.5m/s"), ("1,5", "1.5")])
def test_a_decimal_comma_is_told_apart_from_a_unit(text, meant):
    with pytest.raises(InputError) as caught:
        quantity(text, "m/s", "here")
    assert f'write "{meant}"' in caught.value.remedy
