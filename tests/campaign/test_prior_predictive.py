"""Motions drawn from the prior: steady speeds in closed form, bands around a known vehicle, and the words that follow."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.prior.predictive import FASTEST, N_DRAWS, predict_from_prior, speeds, steady_motion
from seatrial.core.display_units import shown_as_written
from seatrial.core.errors import InputError
from seatrial.messages.priors import prior_alarms, prior_cautions, prior_lines
from seatrial.vehicles.linearise import trim_speed
from tests.campaign.small import LOGGED, write_small
from tests.cases import DEDUCTION, MASS, N0, TRUTH, U0, paper_model
from tests.estimation_cases import naive_doublets, naive_speed

DRAG = "lower = -8.8\nupper = 0.0"
LINEAR = "lower = -3.6\nupper = 1.2"
THRUST = "lower = 2.0e-4\nupper = 12.0e-4"
TRIM, PER_REV = 125.0 / (2 * np.pi), 6.28e-4 * (2 * np.pi) ** 2
"""Trim of the small campaign, rev/s, and its thrust coefficient, N/(rev/s)^2."""


def predicted(folder, *replacements):
    return predict_from_prior(load_campaign(write_small(folder, *replacements)))


def write_log(folder):
    """A log of the vehicle of the small campaign about 125 rad/s, 0.05 m/s of noise."""
    time = np.arange(400) * 0.1
    rev = TRIM + naive_doublets(time, 200, 10, active=30.0) - 12.5
    speed = naive_speed(rev, np.full(400, 0.1), thrust=PER_REV) + 0.05 * np.random.default_rng(0).normal(size=400)
    folder.mkdir(parents=True, exist_ok=True)
    rows = "".join(f"{t:.1f},{u:.6f},{60 * n:.6f}\n" for t, u, n in zip(time, speed, rev, strict=True))
    (folder / "log_1.csv").write_text("t,speed,rpm\n" + rows)


def test_steady_speeds_and_time_constants_in_closed_form():
    """The root of X_u u + X_uu u^2 + (1 - t) T n^2 = 0, and m / -(X_u + 2 X_uu u) there."""
    rng = np.random.default_rng(1)
    x_u, x_uu, thrust = rng.uniform(-3.6, 1.2, 300), rng.uniform(-8.8, -0.1, 300), rng.uniform(2e-4, 12e-4, 300)
    push = (1 - DEDUCTION) * thrust * N0**2
    exact = (-x_u - np.sqrt(x_u**2 - 4 * x_uu * push)) / (2 * x_uu)
    params = {"X_u": x_u, "X_uabsu": x_uu, "T_nabsn": thrust}
    steady, settling = steady_motion(paper_model(), params, [N0])
    assert steady == pytest.approx(exact, rel=1e-10)
    assert settling == pytest.approx(MASS / -(x_u + 2 * x_uu * exact), rel=1e-10)
    assert steady_motion(paper_model(), params, [N0], start=U0)[0] == pytest.approx(exact, rel=1e-10)
    astern, _ = steady_motion(paper_model(), params, [-N0])
    assert astern == pytest.approx(-exact, rel=1e-10)


def test_steady_speed_is_that_of_one_vehicle_at_a_time():
    cubic = np.array([-40.0, 0.1, 5.0, 40.0])
    params = {**{name: np.full(4, value) for name, value in TRUTH.items()}, "X_du3": cubic}
    model = paper_model(*TRUTH, "X_du3")
    steady, _ = steady_motion(model, params, [1.2 * N0])
    for i, value in enumerate(steady):
        one = {name: column[i] for name, column in params.items()}
        if np.isfinite(value):
            assert value == pytest.approx(trim_speed(model, one, [1.2 * N0]), abs=1e-10)
        else:
            with pytest.raises(InputError):
                trim_speed(model, one, [1.2 * N0])
    assert np.isnan(steady).tolist() == [False, False, True, True]
    near_trim, _ = steady_motion(model, params, [1.2 * N0], start=U0)
    assert np.isnan(near_trim).tolist() == [False, False, False, True]


def test_vehicles_that_run_away_are_told_apart():
    time = np.arange(600) * 0.1
    params = {name: np.array([value, value]) for name, value in TRUTH.items()}
    params["X_uabsu"] = np.array([TRUTH["X_uabsu"], 3.0])
    control = 2 * np.pi * naive_doublets(time, 200, 10)[:, None]
    speed, lost = speeds(
        paper_model(), ["u"], params, None, np.full((2, 1), U0), control, np.full(600, 0.1), [0, 100, 599]
    )
    assert lost.tolist() == [False, True]
    assert speed[0, :, 0] == pytest.approx(
        naive_speed(control[:, 0] / (2 * np.pi), np.full(600, 0.1))[[0, 100, 599]], rel=1e-9
    )
    late, _ = speeds(
        paper_model(), ["u"], params, np.array([0.2, 0.2]), np.full((2, 1), U0), control, np.full(600, 0.1), range(600)
    )
    shifted = np.concatenate([control[:2, 0], control[:-2, 0]]) / (2 * np.pi)
    assert late[0, :, 0] == pytest.approx(naive_speed(shifted, np.full(600, 0.1)), rel=1e-9)


def test_a_term_that_is_zero_changes_no_motion():
    """One program serves all structures; vehicles that do not fill the last batch are none the less told one by one."""
    count, time = 103, np.arange(70) * 0.1
    params = {name: value * np.linspace(0.8, 1.2, count) for name, value in TRUTH.items()}
    control = 2 * np.pi * naive_doublets(time, 200, 2)[:, None]
    given = None, np.full((count, 1), U0), control, np.full(70, 0.1), range(70)
    own, lost = speeds(paper_model(*TRUTH), ["u"], params, *given)
    full, _ = speeds(paper_model(*TRUTH, "X_du3"), ["u"], {**params, "X_du3": np.zeros(count)}, *given)
    assert full == pytest.approx(own, rel=1e-12)
    assert len(np.unique(own[:, -1, 0])) == count
    assert not lost.any()


def test_without_a_record_the_largest_doublet_is_simulated(tmp_path):
    """Draws are those of the seed, and what one coefficient does alone is the closed form at its own quantiles."""
    found = predicted(tmp_path, (LINEAR, f"{LINEAR}\ndissipative = true"))
    again = predicted(tmp_path, (LINEAR, f"{LINEAR}\ndissipative = true"))
    assert np.array_equal(found.channels[0].bands, again.channels[0].bands)
    assert "largest input" in found.over
    assert found.settled.at == "n = 1194 rpm"
    assert np.ptp(found.control["n"]) == pytest.approx(400 * 2 * np.pi / 60, rel=1e-9)
    assert found.channels[0].measured is None
    assert found.lost.mean() < 0.01
    assert found.unphysical == ()
    assert "draws over" in repr(found)
    assert "steady speed at n = 1194 rpm: " in found._repr_html_()
    assert (np.diff(found.channels[0].bands, axis=0) >= 0).all()
    by_name = {item.name: item for item in found.believed}
    x_u, x_uu = by_name["X_u"].quantiles[1], by_name["X_uabsu"].quantiles[1]
    push = 0.9 * 125.0**2 * np.array(by_name["T_nabsn"].quantiles)[[0, 2]]
    exact = (-x_u - np.sqrt(x_u**2 - 4 * x_uu * push)) / (2 * x_uu)
    assert (by_name["T_nabsn"].alone.low, by_name["T_nabsn"].alone.high) == pytest.approx(exact, rel=1e-3)
    assert by_name["X_uabsu"].quantiles == pytest.approx((-8.36, -4.4, -0.44), abs=4 * 8.8 * 0.5 / np.sqrt(N_DRAWS))


def test_a_vehicle_that_is_known_gives_its_own_motion(tmp_path):
    """Priors a ten-thousandth wide leave one motion: the textbook's."""
    found = predicted(
        tmp_path,
        (LINEAR, "lower = -1.2101\nupper = -1.2099"),
        (DRAG, "lower = -2.9301\nupper = -2.9299"),
        (THRUST, "lower = 6.2799e-4\nupper = 6.2801e-4"),
    )
    time = np.arange(300) * 0.1
    rev = TRIM + naive_doublets(time, 200, 20, active=20.0) - 12.5
    start = load_campaign(tmp_path).hull.trim["u"]
    exact = naive_speed(rev, np.full(300, 0.1), start=start, thrust=PER_REV)
    assert found.channels[0].bands[2] == pytest.approx(exact, abs=1e-4)
    assert np.ptp(found.channels[0].bands, axis=0).max() < 1e-3
    assert (prior_alarms(found), prior_cautions(found)) == ([], [])


def test_a_record_is_held_or_not(tmp_path):
    for name in ("good", "bad"):
        write_log(tmp_path / name)
    good = predicted(tmp_path / "good", LOGGED, (LINEAR, f"{LINEAR}\ndissipative = true"))
    assert "record 1" in good.over
    assert good.channels[0].held > 0.95
    assert np.isfinite(good.channels[0].measured).all()
    assert prior_alarms(good) == []
    assert any("the prior covers them" in line for line in prior_lines(good, shown_as_written({})))
    bad = predicted(tmp_path / "bad", LOGGED, (THRUST, "lower = 2.0e-6\nupper = 12.0e-6"))
    assert bad.channels[0].held < 0.1
    assert any("misses the measured speeds" in text for text in prior_alarms(bad))


def test_initial_speed_and_noise_are_drawn_where_they_are_unknown(tmp_path):
    write_log(tmp_path)
    found = predicted(tmp_path, LOGGED, ("[estimation]", '[estimation]\ninitial = "estimated"'))
    assert {"sigma_u", "u_0[1]"} <= {item.name for item in found.believed}
    assert found.channels[0].bands[4, 0] - found.channels[0].bands[0, 0] == pytest.approx(2 * 1.645 * 0.25, rel=0.1)


def test_a_current_is_part_of_what_is_measured_and_not_of_the_motion(tmp_path):
    """A known vehicle: its record without a current is what the prior expects, and not what it expects in one of 1 m/s."""
    known = (
        (LINEAR, "lower = -1.2101\nupper = -1.2099"),
        (DRAG, "lower = -2.9301\nupper = -2.9299"),
        (THRUST, "lower = 6.2799e-4\nupper = 6.2801e-4"),
    )
    current = (
        ("[prior.X_u]", '[prior.current]\ndistribution = "uniform"\nlower = 0.9999\nupper = 1.0001\n\n[prior.X_u]'),
        ("[estimation]", '[estimation]\ncurrent = "shared"'),
    )
    for name in ("still", "stream"):
        write_log(tmp_path / name)
    still = predicted(tmp_path / "still", LOGGED, *known)
    stream = predicted(tmp_path / "stream", LOGGED, *known, *current)
    assert (still.channels[0].held, stream.channels[0].held) == (pytest.approx(1.0, abs=0.05), 0.0)
    assert np.allclose(still.channels[0].bands, stream.channels[0].bands, atol=1e-3)


def test_priors_that_run_away_are_called_so(tmp_path):
    found = predicted(tmp_path / "most", (LINEAR, "lower = 20.0\nupper = 60.0"), (DRAG, "lower = -0.8\nupper = 0.0"))
    assert found.diverged.mean() > 0.5
    assert np.isnan(found.channels[0].bands).all()
    (alarm,) = prior_alarms(found)
    assert "most draws from the prior diverge" in alarm
    assert "dissipative = true in [prior.X_u]" in alarm
    some = predicted(tmp_path / "some", (LINEAR, "lower = -3.6\nupper = 6.0"), (DRAG, "lower = -0.5\nupper = 0.0"))
    assert 0.01 < some.lost.mean() < 0.5
    assert prior_alarms(some) == []
    assert any(
        "reach no steady speed" in text and "dissipative = true in [prior.X_u]" in text for text in prior_cautions(some)
    )
    assert np.nanmax(np.abs(some.channels[0].single)) <= FASTEST


def test_a_wide_prior_is_called_wide_and_the_coefficient_named(tmp_path):
    wide = '"log-uniform"\nlower = 1.0e-5\nupper = 1.0e-2'
    found = predicted(tmp_path, (LINEAR, "lower = -3.6\nupper = 0.0"), (f'"uniform"\n{THRUST}', wide))
    (caution,) = prior_cautions(found)
    assert "the prior is wide" in caution
    assert "mostly because of T_nabsn" in caution


BOAT = """
[campaign]
name = "boat"
seed = 1
[vehicle]
name = "boat"
mass = "84 kg"
inertia = ["3 kg m^2", "14 kg m^2", "14 kg m^2"]
moves = ["u", "r"]
fixed = { X_udot = -6.5, N_rdot = -9.0, N_tau_N = 1.0, T_nabsn = 0.002 }
trim = { u = "1.2 m/s", n = "1000 rpm", tau_N = "0 N m" }
[structure]
always = ["X_uabsu", "N_rabsr"]
[prior.X_uabsu]
distribution = "uniform"
lower = -20.0
upper = -2.0
[prior.N_rabsr]
distribution = "uniform"
lower = -60.0
upper = -5.0
[sensors.u]
noise = "0.03 m/s"
[sensors.r]
noise = "0.6 deg/s"
[design]
control = "n"
duration = "30 s"
active = "20 s"
sample_time = "0.1 s"
amplitude = { from = "100 rpm", to = "200 rpm", points = 2 }
period = { from = "2 s", to = "20 s", points = 2 }
"""


def test_a_channel_that_the_trial_does_not_move_is_told_with_the_key_that_moves_it(tmp_path):
    (tmp_path / "campaign.toml").write_text(BOAT)
    lines = prior_lines(predict_from_prior(load_campaign(tmp_path)), shown_as_written({}))
    assert (
        "r does not move in this trial, so its priors have no effect: `together` of [design] moves tau_N as well"
        in lines
    )
    assert next(line for line in lines if line.startswith("N_rabsr")).endswith("no motion in this trial")
    assert any(line.startswith("u: 90 % of draws between") for line in lines)
    moved = BOAT.replace("duration =", 'together = { tau_N = "5 N m" }\nduration =')
    (tmp_path / "campaign.toml").write_text(moved)
    lines = prior_lines(predict_from_prior(load_campaign(tmp_path)), shown_as_written({}))
    assert any(line.startswith("r: 90 % of draws between") for line in lines)


def test_vehicles_that_only_the_steps_let_run_away_are_called_so(tmp_path):
    """A Runge-Kutta step of 0.1 s diverges beyond a damping X_u / m of 27.9 per second."""
    found = predicted(tmp_path, (LINEAR, "lower = -1200.0\nupper = 0.0"), (DRAG, "lower = -0.1\nupper = 0.0"))
    assert found.stiff.sum() > 0.9 * found.diverged.sum() > 0
    assert any("too quickly for steps of 0.1 s" in text for text in prior_cautions(found))
    assert any(
        "X_u near the lower end of its prior; narrow [prior.X_u] there" in text for text in prior_cautions(found)
    )
