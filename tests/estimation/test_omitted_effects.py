"""Effects left out: the score test beside least squares with the effect put in, and vehicles with something that no term has."""

import numpy as np
import pytest
from scipy import stats

from seatrial.core.record import Channel, make_record
from seatrial.estimation.diagnostics.effect_fit import Fit, Linearisation, whiten
from seatrial.estimation.diagnostics.omitted_effects import half_width, omitted_effects, score_effects
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.posterior import posterior_of_density
from seatrial.estimation.posterior.record_posterior import make_posterior
from seatrial.estimation.priors import LogUniform, Normal, Uniform
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation
from seatrial.vehicles.whole import whole_vehicle
from tests.cases import PROVENANCE
from tests.estimation_cases import make_trial
from tests.selection.run_cases import FIXED_DRAG

RNG = np.random.default_rng(5)
N = 400
J = RNG.normal(size=(N, 3))
EFFECT = J @ [0.5, -1.0, 0.2] + RNG.normal(size=N)


def scored(measured, effect=EFFECT, worth=1.0):
    """Score of one effect about least squares, its covariance and its values."""
    values, cov = np.linalg.lstsq(J, measured, rcond=None)[0], np.linalg.inv(J.T @ J)
    return score_effects(Fit(linear(measured - J @ values, effect, worth), (), cov)), values


def linear(residual, signature, worth=1.0):
    columns = np.column_stack([J, signature])
    return Linearisation(np.zeros(3), np.zeros(1), columns.T @ columns, columns.T @ residual, N, worth, 0.0)


def test_size_shift_and_variance_are_those_of_the_wider_fit():
    measured = J @ [1.0, 2.0, 3.0] + 0.3 * EFFECT + RNG.normal(size=N)
    found, values = scored(measured)
    wide = np.column_stack([J, EFFECT])
    exact, cov = np.linalg.lstsq(wide, measured, rcond=None)[0], np.linalg.inv(wide.T @ wide)
    assert found[0].size == pytest.approx(exact[3], rel=1e-9)
    assert 1 / found[0].information == pytest.approx(cov[3, 3], rel=1e-9)
    assert values + found[0].shift == pytest.approx(exact[:3], rel=1e-9)
    assert np.diag(np.linalg.inv(J.T @ J)) + found[0].variance == pytest.approx(np.diag(cov)[:3], rel=1e-9)


def test_log_odds_are_those_of_a_prior_worth_one_sample():
    """The Bayes factor of a normal prior of variance n / information about the size, in closed form; BIC leaves out 1 + 1 / n."""
    found, _ = scored(J @ [1.0, 2.0, 3.0] + 0.3 * EFFECT + RNG.normal(size=N))
    size, information = found[0].size, found[0].information
    exact = 0.5 * size**2 * information * N / (N + 1) - 0.5 * np.log(N + 1)
    assert found[0].log_odds == pytest.approx(exact, abs=0.1)


def test_squared_scores_are_chi_square_where_nothing_is_missing():
    """The share of 2000 data sets above the 95 % point, to four standard errors."""
    found = [scored(RNG.normal(size=N))[0][0] for _ in range(2000)]
    share = np.mean([one.size**2 * one.information > 3.8415 for one in found])
    assert abs(share - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 2000)


@pytest.mark.parametrize("prior", [Normal(0.2, 0.5), Uniform(-1.0, 1.0)])
def test_log_odds_of_a_term_of_other_structures_are_the_bayes_factor_of_its_prior(prior):
    """By dense quadrature over the size, the other values being linear and free; also of a term that the others nearly imitate."""
    for signature in (EFFECT, J @ [0.5, -1.0, 0.2] + 0.05 * EFFECT):
        measured = J @ [1.0, 2.0, 3.0] + 0.1 * signature + RNG.normal(size=N)
        values, cov = np.linalg.lstsq(J, measured, rcond=None)[0], np.linalg.inv(J.T @ J)
        found = score_effects(Fit(linear(measured - J @ values, signature), (), cov), {0: prior})[0]
        sizes = np.linspace(-4.0, 4.0, 20_001)
        left = np.eye(N) - J @ cov @ J.T
        rise = sizes * (signature @ left @ measured) - 0.5 * sizes**2 * (signature @ left @ signature)
        density = stats.norm(0.2, 0.5) if isinstance(prior, Normal) else stats.uniform(-1.0, 2.0)
        exact = np.log(np.trapezoid(np.exp(rise) * density.pdf(sizes), sizes))
        assert found.log_odds == pytest.approx(exact, abs=1e-6 if isinstance(prior, Normal) else 0.4)


def test_what_the_parameters_imitate_is_not_tested():
    assert scored(RNG.normal(size=N), J @ [1.0, 0.0, 2.0])[0] == {}
    assert scored(RNG.normal(size=N), np.zeros(N))[0] == {}


def test_correlated_residuals_are_worth_less():
    measured = RNG.normal(size=N)
    whole, quarter = (scored(measured, EFFECT, worth)[0][0] for worth in (1.0, 0.25))
    assert quarter.size == whole.size
    assert quarter.variance == pytest.approx(4 * whole.variance)


@pytest.mark.parametrize(("left", "tested"), [(0.9e-4, False), (1.1e-4, True)])
def test_an_effect_is_tested_of_which_the_parameters_leave_a_ten_thousandth(left, tested):
    direction = np.linalg.qr(np.column_stack([J, RNG.normal(size=N)]))[0]
    inside, outside = J[:, 0] / np.linalg.norm(J[:, 0]), direction[:, 3]
    signature = np.sqrt(1 - left) * inside + np.sqrt(left) * outside
    found = score_effects(Fit(linear(outside, signature), (), np.linalg.inv(J.T @ J)))
    assert len(found) == tested
    assert all(one.size == pytest.approx(1 / np.sqrt(left), rel=1e-6) for one in found.values())


def test_half_width_is_the_quantile_of_a_mixture():
    """Of a million draws of three normal densities, to four standard errors of the share inside."""
    rng, weight = np.random.default_rng(3), np.array([2.0, 1.0, 1.0])
    shift, sd = np.array([[0.0, 0.0], [3.0, 0.1], [-1.0, 20.0]]), np.array([[1.0, 1.0], [0.5, 2.0], [4.0, 1.0]])
    which = rng.choice(3, 1_000_000, p=weight / weight.sum())
    drawn = shift[which] + sd[which] * rng.normal(size=(which.size, 2))
    inside = np.mean(np.abs(drawn) < half_width(weight, shift, sd), 0)
    assert np.abs(inside - 0.9).max() < 4 * np.sqrt(0.09 / which.size)
    assert half_width(np.ones(1), np.zeros((1, 1)), np.ones((1, 1)))[0] == pytest.approx(1.644854, rel=1e-6)


@pytest.mark.parametrize("noise", ["coloured", "drifting"])
def test_whitened_columns_give_the_inverse_covariance(noise):
    """x' C^-1 y with C written out: an Ornstein-Uhlenbeck process at uneven times, white noise over it where it drifts."""
    rng = np.random.default_rng(8)
    time = np.cumsum(rng.uniform(0.05, 0.6, 40))
    apart = np.abs(time[:, None] - time)
    if noise == "coloured":
        values, cov = {"sigma_u": 0.3, "tau_u": 0.7}, np.exp(-apart / 0.7)
    else:
        values = {"sigma_u": 0.3, "drift_u": 0.5, "drift_time_u": 2.0}
        cov = 0.09 * np.eye(40) + 0.25 * np.exp(-apart / 2.0)
    columns = rng.normal(size=(40, 3))
    gaps = np.concatenate([[1e12], np.diff(time)])
    new, log_sd = whiten(Sensor("u", noise), values, gaps, columns)
    np.testing.assert_allclose(new.T @ new, columns.T @ np.linalg.solve(cov, columns), rtol=1e-9)
    np.testing.assert_allclose(2 * log_sd, np.linalg.slogdet(cov)[1], rtol=1e-9)
    # Several noises at once, one of each column.
    several = {name: value * np.array([1.0, 0.5, 2.0]) for name, value in values.items()}
    found, logs = whiten(Sensor("u", noise), several, gaps, columns)
    for i in range(3):
        alone, log_alone = whiten(
            Sensor("u", noise), {k: v[i] for k, v in several.items()}, gaps, columns[:, i : i + 1]
        )
        np.testing.assert_allclose(found[:, i], alone[:, 0], rtol=1e-12)
        assert logs[i] == pytest.approx(log_alone[0], rel=1e-12)


STEP, SAMPLES = 0.1, 900
TRUTH = {"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4}
FIXED_HULL = type(FIXED_DRAG)("hull", FIXED_DRAG.mass)


SLOW = {
    "white": {},
    "coloured": {"tau_u": LogUniform(0.05, 30.0)},
    "drifting": {"drift_u": LogUniform(1e-4, 0.5), "drift_time_u": LogUniform(0.1, 180.0)},
}
"""Priors that a model of the noise adds."""


def posterior_of(lag=0.0, cubic=0.0, seed=1, noise="white", drift=0.0, late=0, terms=tuple(TRUTH), loss=0.0):
    """One record by a loop of its own, midpoint steps, fitted without lag, cubic drag and loss of thrust; its sensor may drift within 3 s,
    and its clock be late by some samples."""
    rng = np.random.default_rng(seed)
    n = np.repeat(125 + rng.uniform(-60, 60, SAMPLES // 30), 30)
    u, turning, shown, h = 1.5, n[0], [], STEP / 5
    for command in np.r_[np.full(late, n[0]), n][:SAMPLES]:
        shown.append(u)
        turning = turning if lag else command
        for _ in range(5):
            thrust = TRUTH["T_nabsn"] * turning * abs(turning)

            def rate(u, thrust=thrust):
                return (
                    thrust * (1 - loss * u) ** 2 + TRUTH["X_u"] * u + TRUTH["X_uabsu"] * u * abs(u) - cubic * u**3
                ) / FIXED_DRAG.mass

            u += h * rate(u + 0.5 * h * rate(u))
            turning += h * (command - turning) / lag if lag else 0.0
    noisy, slow = np.array(shown) + 0.02 * rng.normal(size=SAMPLES), 0.0
    for k in range(SAMPLES if drift else 0):
        slow = slow * np.exp(-STEP / 3) + drift * np.sqrt(-np.expm1(-2 * STEP / 3)) * rng.normal()
        noisy[k] += slow
    record = make_trial(STEP * np.arange(SAMPLES), n / (2 * np.pi), "one", u=noisy)
    priors = {"X_u": Normal(-1.2, 1.5), "X_uabsu": Normal(-3.0, 3.0), "T_nabsn": Normal(6e-4, 3e-4)}
    priors = {name: priors[name] for name in terms}
    priors |= {"sigma_u": LogUniform(0.002, 0.5), "u_0": Normal(1.5, 0.3)} | SLOW[noise]
    return make_posterior(whole_vehicle(FIXED_HULL, terms, moves=("u",)), record, priors, [Sensor("u", noise)])


def two_axes_of(coupling, drag=0.0, seed=2):
    """A record of surge and pitch, each with a command of its own; no term has `drag`, nor what the first does to pitch."""
    rng = np.random.default_rng(seed)
    push, turn = (np.repeat(rng.uniform(-20, 20, SAMPLES // 30), 30) for _ in range(2))
    u, q, shown = 0.0, 0.0, []
    for force, moment in zip(push, turn, strict=True):
        shown.append((u, q))
        for h in np.full(20, STEP / 20):
            middle = u + 0.5 * h * (force - 8.0 * u - drag * u * abs(u)) / 30.0
            u += h * (force - 8.0 * middle - drag * middle * abs(middle)) / 30.0
        q += ((moment + coupling * force) / 12.0 - q) * -np.expm1(-STEP * 12.0 / 6.0)
    u, q = np.array(shown).T + 0.01 * rng.normal(size=(2, SAMPLES))
    commands = {"tau_X": ("N", push), "tau_M": ("N m", turn)}
    measured = {"u": ("m/s", u), "q": ("rad/s", q)}
    channels = [Channel(name, unit, "control") for name, (unit, _) in commands.items()]
    channels += [Channel(name, unit, "measurement") for name, (unit, _) in measured.items()]
    columns = {name: column for name, (_, column) in {**commands, **measured}.items()}
    record = make_record(STEP * np.arange(SAMPLES), columns, channels, PROVENANCE, "one")
    equations = axis_equation("X", ("X_tau_X", "X_u"), 30.0), axis_equation("M", ("M_tau_M", "M_q"), 6.0)
    priors = {"X_tau_X": Normal(1, 0.5), "X_u": Normal(-8, 8), "M_tau_M": Normal(1, 0.5), "M_q": Normal(-12, 12)}
    priors |= {name: LogUniform(0.002, 0.5) for name in ("sigma_u", "sigma_q")}
    priors |= {name: Normal(0.0, 0.1) for name in ("u_0", "q_0")}
    return make_posterior(axes_vehicle("two axes", equations), record, priors, ["u", "q"])


@pytest.mark.parametrize("coupling", [pytest.param(0.0, marks=pytest.mark.proof), 0.3])
def test_a_command_that_acts_on_another_axis_too_is_found(coupling):
    posterior = two_axes_of(coupling)
    found = omitted_effects(posterior, find_mode(posterior, 0)).found
    assert [one.effect.of for one in found] == ["M_tau_X"] * (coupling > 0)
    assert all(abs(one.size - coupling) < 4 * one.sd for one in found)


def test_two_effects_that_are_missing_are_both_found():
    """Residuals of either axis are hardly worth a sample in fifty: what the first effect leaves must not hide the second."""
    posterior = two_axes_of(coupling=0.3, drag=3.0)
    mode = find_mode(posterior, 0)
    omitted = omitted_effects(posterior, mode)
    assert {one.effect.of for one in omitted.found} == {"M_tau_X", "X_uabsu"}
    sizes = {one.effect.of: (one.size, one.sd) for one in omitted.found}
    assert abs(sizes["M_tau_X"][0] - 0.3) < 4 * sizes["M_tau_X"][1]
    assert abs(sizes["X_uabsu"][0] + 3.0) < 4 * sizes["X_uabsu"][1]
    spread = dict(zip(posterior.names, omitted.spread, strict=True))
    sd = dict(zip(posterior.names, mode.sd, strict=True))
    assert 5 * sd["X_u"] < abs(mode.by_name["X_u"] + 8.0) < 2.5 * sd["X_u"] * spread["X_u"]


@pytest.mark.parametrize("is_line", [True, False])
def test_a_command_that_was_measured_while_it_changed_leads_by_half_a_step(is_line):
    """The propeller follows straight lines between samples of 0.1 s, or jumps at them; the model takes what was sampled as held."""
    rng, u, shown = np.random.default_rng(4), 1.5, []
    n = 125 + 40 * np.interp(np.arange(SAMPLES) / 7, np.arange(SAMPLES), rng.uniform(-1, 1, SAMPLES))
    for k, sampled in enumerate(n):
        shown.append(u)
        following = n[min(k + 1, SAMPLES - 1)] if is_line else sampled
        for i in range(10):
            now = sampled + (i + 0.5) / 10 * (following - sampled)
            thrust = TRUTH["T_nabsn"] * now * abs(now)

            def rate(u, thrust=thrust):
                return (thrust + TRUTH["X_u"] * u + TRUTH["X_uabsu"] * u * abs(u)) / FIXED_DRAG.mass

            u += STEP / 10 * rate(u + STEP / 20 * rate(u))
    shown += 2e-4 * rng.normal(size=SAMPLES)
    record = make_trial(STEP * np.arange(SAMPLES), n / (2 * np.pi), "one", u=shown)
    priors = {"X_u": Normal(-1.2, 1.5), "X_uabsu": Normal(-3.0, 3.0), "T_nabsn": Normal(6e-4, 3e-4)}
    priors |= {"sigma_u": LogUniform(1e-5, 0.5), "u_0": Normal(1.5, 0.3)}
    posterior = make_posterior(whole_vehicle(FIXED_HULL, tuple(TRUTH), moves=("u",)), record, priors, ["u"])
    found = omitted_effects(posterior, find_mode(posterior, 0)).found
    assert [one.effect.kind for one in found[:1]] == ["command lead"] * is_line
    assert not is_line or abs(found[0].size - STEP / 2) < 4 * found[0].sd + 0.002


def away(posterior, mode):
    """Distance from the truth in standard deviations."""
    return {name: abs(mode.by_name[name] - value) / mode.sd[mode.names.index(name)] for name, value in TRUTH.items()}


@pytest.mark.parametrize(("noise", "drift"), [("white", 0.0), pytest.param("drifting", 0.05, marks=pytest.mark.proof)])
def test_nothing_is_found_where_nothing_is_missing(noise, drift):
    posterior = posterior_of(noise=noise, drift=drift)
    found = omitted_effects(posterior, find_mode(posterior, 0))
    assert found.found == ()
    assert len(found.tried) >= 5
    spread = dict(zip(posterior.names, found.spread, strict=True))
    assert spread["sigma_u"] == pytest.approx(1.0, abs=1e-3)
    assert 1.0 <= spread["T_nabsn"] < 3.0


def test_a_loss_of_thrust_with_the_speed_is_found():
    """A propeller whose speed through the water falls by 6 % for each m/s: three coefficients are off by over 20 of their sds."""
    posterior = posterior_of(loss=0.06)
    mode = find_mode(posterior)
    omitted = omitted_effects(posterior, mode)
    (found,) = omitted.found
    assert (found.effect.kind, found.alike) == ("thrust loss", ())
    assert abs(found.size - 0.06) < 3 * found.sd
    off = away(posterior, mode)
    assert min(off.values()) > 20
    assert max(off[name] / omitted.spread[posterior.names.index(name)] for name in off) < 2


def test_a_lag_is_found_with_its_size_and_what_it_does():
    """No lag has a first-order size: Newton's steps have to reach 0.8 s from none; the delay that looks alike loses."""
    posterior = posterior_of(lag=0.8)
    mode = find_mode(posterior, 0)
    found = omitted_effects(posterior, mode)
    lag = found.found[0]
    assert (lag.effect.kind, lag.effect.of) == ("command lag", "n")
    assert abs(lag.size - 0.8) < 4 * lag.sd
    assert lag.sd < 0.05
    wrong = away(posterior, mode)
    at = posterior.names.index(max(wrong, key=wrong.__getitem__))
    assert max(wrong.values()) > 8
    assert abs(lag.shift[at]) == pytest.approx(max(wrong.values()), rel=0.1)
    assert 1.645 * found.spread[at] > 0.9 * max(wrong.values())


@pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.proof), 3])
def test_a_lag_whose_place_a_delay_has_taken_is_not_named(seed):
    """A clock that is late by 0.8 s, and drag that is linear too: a lag does best alone, and nothing once the delay is found."""
    posterior = posterior_of(late=8, seed=seed, terms=("X_uabsu", "T_nabsn"))
    mode = find_mode(posterior, 0)
    omitted = omitted_effects(posterior, mode)
    at = posterior.names.index("T_nabsn")
    assert 1.645 * omitted.spread[at] > 0.9 * abs(mode.by_name["T_nabsn"] - TRUTH["T_nabsn"]) / mode.sd[at] > 5
    delay, *others = omitted.found
    assert delay.effect.kind == "delay"
    assert abs(delay.size - 0.8) < 4 * delay.sd + 0.02
    assert delay.sd < 0.05
    assert "command lag" not in [one.effect.kind for one in others]


@pytest.mark.parametrize(
    ("noise", "cubic", "seed"),
    [
        ("white", 1.5, 1),
        *(pytest.param(*case, marks=pytest.mark.proof) for case in (("drifting", 1.0, 1), ("coloured", 0.7, 2))),
    ],
)
def test_a_cubic_drag_is_found(noise, cubic, seed):
    """A noise with a memory takes up what is missing: nothing is found, or a constant force, as long as it stays as it was fitted."""
    posterior = posterior_of(cubic=cubic, seed=seed, noise=noise)
    mode = find_mode(posterior, 0)
    found = omitted_effects(posterior, mode)
    assert [one.effect.of for one in found.found] == ["X_u3"]
    assert abs(found.found[0].size + cubic) < 4 * found.found[0].sd
    at, wrong = posterior.names.index("X_uabsu"), away(posterior, mode)
    assert wrong["X_uabsu"] > 8
    assert abs(found.found[0].shift[at]) == pytest.approx(wrong["X_uabsu"], rel=0.3)
    assert [one.of for one in found.causes[at]] == ["X_u3"]
    assert 1.645 * found.spread[at] > 0.9 * wrong["X_uabsu"]


def test_a_density_of_ones_own_has_none():
    own = posterior_of_density(lambda values: -(values["a"] ** 2), {"a": Normal(0.0, 1.0)})
    found = omitted_effects(own, find_mode(own, 0))
    assert (found.found, found.tried) == ((), ())
    assert found.spread == pytest.approx([1.0])
