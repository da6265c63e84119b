import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.linearise import trim_speed
from seatrial.vehicles.whole import whole_vehicle
from tests.cases import N0, TERMS, TRUTH, U0, X_U, X_UU, paper_hull, paper_model, surge_rate


@pytest.mark.parametrize("u", [-1.2, 0.0, 0.7, 2.5])
@pytest.mark.parametrize("rev_per_s", [-8.0, 12.5])
def test_equation_of_the_paper(u, rev_per_s):
    (rate,) = paper_model().derivative(TRUTH, (u,), (rev_per_s * 2 * np.pi,))
    assert rate == pytest.approx(surge_rate(u, rev_per_s), rel=1e-13)


def test_cubic_term_is_about_trim():
    (rate,) = paper_model(*TERMS, "X_du3").derivative({**TRUTH, "X_du3": 0.1}, (2.5,), (N0,))
    assert rate == pytest.approx(surge_rate(2.5, 12.5, cubic=0.1), rel=1e-13)


def test_every_kind_of_term():
    hull = Hull("tug", mass=50.0, thrust_deduction=0.2, fixed={"X_0": -2.0}, trim={"u": 1.0, "n": 30.0})
    model = whole_vehicle(hull, ["X_udot", "X_u", "X_uu", "T_nabsn", "T_un", "X_tau_X", "X_dndu"], moves=("u",))
    params = {"X_udot": -5.0, "X_u": -3.0, "X_uu": -7.0, "T_nabsn": 0.01, "T_un": -0.02, "X_tau_X": 0.9, "X_dndu": 0.05}
    u, n, tau = 1.4, 40.0, 6.0
    force = -2.0 - 3 * u - 7 * u**2 + 0.8 * (0.01 * n**2 - 0.02 * u * n) + 0.9 * tau + 0.05 * (n - 30) * (u - 1)
    assert model.controls == ("n", "tau_X")
    assert model.derivative(params, (u,), (n, tau)) == pytest.approx((force / 55,), rel=1e-13)


def test_unknown_mass_means_forces_per_unit_mass():
    model = whole_vehicle(Hull("light", mass=None), TERMS, moves=("u",))
    assert [model.unit_of(term) for term in model.coefficients] == ["1/s", "1/m", "m/rad^2"]
    params = {"X_u": -0.1, "X_uabsu": -0.2, "T_nabsn": 0.003}
    assert model.derivative(params, (2.0,), (10.0,)) == pytest.approx((-0.2 - 0.8 + 0.3,))


def test_units_and_channels():
    model = paper_model()
    assert [model.unit_of(term) for term in model.coefficients] == ["kg/s", "kg/m", "kg m/rad^2"]
    assert model.channel_units() == {"u": "m/s", "udot": "m/s^2"}
    assert model.output("u", TRUTH, (1.7,), (N0,)) == 1.7
    assert model.output("udot", TRUTH, (1.7,), (N0,)) == pytest.approx(surge_rate(1.7, 12.5), rel=1e-12)


def test_fixed_terms_are_not_free():
    assert [str(term) for term in paper_model("X_udot", "X_u").coefficients] == ["X_u"]


def test_models_of_the_same_equations_are_equal():
    """A trim value counts where a term is a change from it."""
    assert paper_model() == paper_model()
    assert hash(paper_model()) == hash(paper_model())
    others = [
        Hull("paper", 30.0, thrust_deduction=0.1, fixed={"X_udot": -0.93}, trim={"u": U0}),
        Hull("paper", 30.47, thrust_deduction=0.2, fixed={"X_udot": -0.93}, trim={"u": U0}),
        Hull("paper", 30.47, thrust_deduction=0.1, fixed={"X_udot": -1.0}, trim={"u": U0}),
    ]
    assert all(paper_model() != whole_vehicle(hull, TERMS, moves=("u",)) for hull in others)
    assert paper_model() != paper_model("X_u", "T_nabsn")
    assert paper_model() == whole_vehicle(paper_hull(u=1.0), TERMS, moves=("u",))
    assert paper_model(*TERMS, "X_du3") != whole_vehicle(paper_hull(u=1.0), (*TERMS, "X_du3"), moves=("u",))


def test_trim_speed_is_golden():
    assert trim_speed(paper_model(), TRUTH, [N0]) == pytest.approx(U0, abs=1e-12)


@pytest.mark.parametrize("cubic", [-20.0, 0.1, 1.0])
def test_trim_is_the_equilibrium_reached_from_rest(cubic):
    """A destabilising cubic term adds an unstable equilibrium at a higher speed; the vehicle never gets there."""
    assert trim_speed(paper_model(*TERMS, "X_du3"), {**TRUTH, "X_du3": cubic}, [N0]) == pytest.approx(U0, abs=1e-11)


def test_trim_under_drag_without_modulus():
    params = {"X_u": X_U, "X_uu": X_UU, "T_nabsn": TRUTH["T_nabsn"]}
    assert trim_speed(paper_model(*params), params, [N0]) == pytest.approx(U0, abs=1e-12)


def test_trim_astern():
    assert trim_speed(paper_model(), TRUTH, [-N0]) == pytest.approx(-U0, abs=1e-12)


@pytest.mark.parametrize("params", [{**TRUTH, "X_u": 1.21, "X_uabsu": 2.93}, {**TRUTH, "X_u": np.nan}])
def test_no_trim(params):
    with pytest.raises(InputError, match="drag that balances the thrust"):
        trim_speed(paper_model(), params, [N0])
