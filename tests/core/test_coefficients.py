from math import prod

import numpy as np
import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.core.coefficients import AXES, CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.signals import RATES

SIGNAL_UNITS = {
    **dict.fromkeys("uvw", "m/s"),
    **dict.fromkeys("pqrn", "rad/s"),
    **dict.fromkeys(("phi", "theta", "psi", "delta_r", "delta_s"), "rad"),
    **dict.fromkeys(("tau_X", "tau_Y", "tau_Z"), "kg*m/s^2"),
    **dict.fromkeys(("tau_K", "tau_M", "tau_N"), "kg*m^2/s^2"),
}
AXIS_UNITS = {**dict.fromkeys("XYZT", "kg*m/s^2"), **dict.fromkeys("KMNQ", "kg*m^2/s^2")}
UNITS = pint.UnitRegistry(None)
for base in ("meter = [length] = m", "second = [time] = s", "kilogram = [mass] = kg", "radian = [angle] = rad"):
    UNITS.define(base)

VALUES = {
    "u": -1.7,
    "v": 0.4,
    "w": 0.3,
    "p": 0.2,
    "q": -0.6,
    "r": 0.5,
    "udot": -0.31,
    "phi": 0.1,
    "psi": -2.0,
    "n": -70.0,
    "delta_r": -0.2,
    "tau_X": 12.0,
}
TRIM = {"u": 1.5, "n": 78.5, "delta_r": 0.05}


@pytest.mark.parametrize(
    ("text", "unit", "label", "value"),
    [
        ("X_u", "kg/s", "X_{u}", -1.7),
        ("X_uabsu", "kg/m", "X_{u|u|}", -1.7 * 1.7),
        ("X_uu", "kg/m", "X_{uu}", 1.7**2),
        ("X_du3", "kg s/m^2", r"X_{\Delta u^3}", (-1.7 - 1.5) ** 3),
        ("X_absdu", "kg/s", r"X_{|\Delta u|}", 3.2),
        ("X_udot", "kg", r"X_{\dot{u}}", -0.31),
        ("X_0", "kg m/s^2", "X_{0}", 1.0),
        ("X_tau_X", "1", r"X_{\tau_X}", 12.0),
        ("T_nabsn", "kg m/rad^2", "T_{n|n|}", -70.0 * 70.0),
        ("T_un", "kg/rad", "T_{un}", 119.0),
        ("Q_nabsn", "kg m^2/rad^2", "Q_{n|n|}", -4900.0),
        ("Y_uudelta_r", "kg/(m rad)", r"Y_{uu\delta_r}", 1.7**2 * -0.2),
        ("Y_ddelta_r", "kg m/(s^2 rad)", r"Y_{\Delta \delta_r}", -0.25),
        ("N_rabsr", "kg m^2/rad^2", "N_{r|r|}", 0.25),
        ("K_phi", "kg m^2/(s^2 rad)", r"K_{\phi}", 0.1),
        ("N_psi", "kg m^2/(s^2 rad)", r"N_{\psi}", -2.0),
        ("K_pphi", "kg m^2/(s rad^2)", r"K_{p\phi}", 0.02),
        ("M_uq", "kg m/rad", "M_{uq}", 1.02),
        ("Z_w2", "kg/m", "Z_{w^2}", 0.09),
    ],
)
def test_name_is_the_equation(text, unit, label, value):
    name = CoefficientName.parse(text)
    assert (name.axis, name.unit, name.label, str(name)) == (text[0], unit, label, text)
    assert name.regressor(VALUES, TRIM) == pytest.approx(value, rel=1e-14)
    assert name.is_added_mass == ("dot" in text)


def test_signals_in_order_and_once():
    name = CoefficientName.parse("Y_uabsudelta_rdn")
    assert name.signals == ("u", "delta_r", "n")
    assert name.trim_signals == ("n",)


def test_regressor_on_arrays():
    u = np.linspace(-2, 2, 9)
    assert np.array_equal(CoefficientName.parse("X_uabsu").regressor({"u": u}, {}), u * np.abs(u))


@pytest.mark.parametrize(
    ("left", "right", "equal"),
    [
        ("Y_uv", "Y_vu", True),
        ("X_u2", "X_uu", True),
        ("X_u2", "X_absuabsu", True),
        ("X_u2", "X_absu2", True),
        ("X_uabsu", "X_absuu", True),
        ("X_absu3", "X_u2absu", True),
        ("X_u3", "X_uabsu2", True),
        ("X_uabsu", "X_uu", False),
        ("X_u", "Y_u", False),
        ("X_du2", "X_u2", False),
        ("X_udot", "X_u", False),
        ("X_0", "X_u", False),
    ],
)
def test_equal_names_are_those_of_one_regressor(left, right, equal):
    first, second = CoefficientName.parse(left), CoefficientName.parse(right)
    assert (first == second) is equal
    assert len({first, second}) == (1 if equal else 2)


@pytest.mark.parametrize(
    ("left", "right", "signals"),
    [
        ("X_uu", "X_uabsu", ("u",)),
        ("X_absu", "X_u", ("u",)),
        ("T_nn", "T_nabsn", ("n",)),
        ("Y_uabsv", "Y_absuv", ("u", "v")),
        ("X_u2", "X_uu", ()),
        ("X_u", "X_uabsu", ()),
        ("X_uu", "Y_uabsu", ()),
        ("X_uabsu", "X_uabsu3", ()),
        ("X_du2", "X_duabsdu", ()),
        ("X_0", "X_u", ()),
    ],
)
def test_terms_that_are_one_until_a_signal_changes_its_sign(left, right, signals):
    """Told by the name as by the values: on one side of zero, and only there, their regressors are in proportion."""
    first, second = CoefficientName.parse(left), CoefficientName.parse(right)
    assert first.parted_by_sign(second) == second.parted_by_sign(first) == signals
    rng, trim = np.random.default_rng(1), dict.fromkeys(("u", "v", "n"), 2.0)
    values = {name: rng.uniform(0.5, 3.0, 20) for name in trim}
    ratio = first.regressor(values, trim) / second.regressor(values, trim)
    if signals:
        assert np.ptp(ratio) == pytest.approx(0.0, abs=1e-12)
        values = {name: column * rng.choice([-1.0, 1.0], 20) for name, column in values.items()}
        assert np.ptp(first.regressor(values, trim) / second.regressor(values, trim)) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("text", "character", "found"),
    [
        ("X_uabsx", 4, '"absx"'),
        ("X_", 3, "nothing follows"),
        ("X_foo", 4, '"X_foo", which is not a term'),
        ("X_u1", 4, '"1"'),
        ("X_u22", 5, '"2"'),
        ("X_0u", 3, '"0u"'),
        ("X_u0", 4, '"0"'),
        ("X_dudot", 3, '"dudot"'),
        ("X_phidot", 3, '"phidot"'),
        ("X__u", 3, '"_u"'),
        ("X_u ", 4, '" "'),
        ("X_uabs", 4, '"abs"'),
        ("Y_uudelta", 5, '"delta"'),
        ("X_U", 3, '"U"'),
        ("X_u-v", 4, '"-v"'),
    ],
)
def test_malformed_name_shows_the_place(text, character, found):
    with pytest.raises(InputError) as caught:
        CoefficientName.parse(text)
    error = caught.value
    heading, name, caret = error.where.split("\n")
    assert heading.endswith(f"character {character}")
    assert name.index(text) + character - 1 == caret.index("^")
    assert found in error.found
    assert "[abs][d]signal[dot][2-9]" in error.expected
    assert all(signal in error.expected for signal in SIGNAL_UNITS)


@pytest.mark.parametrize("text", ["", "u", "X", "Xu", "x_u", "U_u", "_u", " X_u"])
def test_unknown_axis(text):
    with pytest.raises(InputError, match="instead of the axis") as caught:
        CoefficientName.parse(text)
    assert all(f"{axis}_" in caught.value.expected for axis in AXES)


def test_misspelt_signal_suggests_the_nearest():
    with pytest.raises(InputError, match='did you mean "delta_r"'):
        CoefficientName.parse("Y_uudeltar")
    with pytest.raises(InputError, match="write for example X_u") as caught:
        CoefficientName.parse("X_tanhu")
    assert "did you mean" not in str(caught.value)


@st.composite
def factors(draw, signals=tuple(SIGNAL_UNITS)):
    signal = draw(st.sampled_from(signals))
    dot = signal in RATES and draw(st.booleans())
    return draw(st.booleans()), not dot and draw(st.booleans()), signal, dot, draw(st.integers(1, 9))


def spelling(axis, chosen):
    parts = [
        ("abs" * modulus) + ("d" * change) + signal + ("dot" * dot) + (str(power) if power > 1 else "")
        for modulus, change, signal, dot, power in chosen
    ]
    return f"{axis}_{''.join(parts)}"


def value_of(chosen, signals, trim):
    values = [
        (signals[signal + "dot"] if dot else signals[signal] - trim[signal] * change, modulus, power)
        for modulus, change, signal, dot, power in chosen
    ]
    return prod((abs(x) if modulus else x) ** power for x, modulus, power in values)


@given(st.sampled_from(sorted(AXIS_UNITS)), st.lists(factors(), min_size=1, max_size=4))
def test_any_composed_name_parses(axis, chosen):
    name = CoefficientName.parse(spelling(axis, chosen))
    unit = UNITS.parse_expression(name.unit) * UNITS.Quantity(1)
    for _, _, signal, dot, power in chosen:
        factor = UNITS.parse_expression(SIGNAL_UNITS[signal]) / (UNITS.parse_expression("s") if dot else 1)
        unit = unit * factor**power
    assert unit.dimensionality == UNITS.parse_expression(AXIS_UNITS[axis]).dimensionality
    rng = np.random.default_rng(0)
    signals = {key: rng.normal() for signal in SIGNAL_UNITS for key in (signal, signal + "dot")}
    trim = {signal: rng.normal() for signal in SIGNAL_UNITS}
    assert name.regressor(signals, trim) == pytest.approx(value_of(chosen, signals, trim), rel=1e-12)


@given(*[st.lists(factors(("u", "v")).filter(lambda factor: factor[-1] < 4), min_size=1, max_size=3)] * 2)
def test_names_are_equal_exactly_when_regressors_are(left, right):
    rng = np.random.default_rng(1)
    trim = {"u": 0.3, "v": -0.4}
    signals = {key: rng.normal(size=20) for key in ("u", "v", "udot", "vdot")}
    same = np.allclose(value_of(left, signals, trim), value_of(right, signals, trim), rtol=1e-10, atol=0)
    assert (CoefficientName.parse(spelling("X", left)) == CoefficientName.parse(spelling("X", right))) == same
