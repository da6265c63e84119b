"""Rehearsal of a campaign: paired noise, stopping at the goal, resuming to the same bits, and numbers computed another way."""

from xml.etree import ElementTree

import jax
import numpy as np
import pytest
import xarray as xr

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.rehearsal import run as module
from seatrial.campaign.rehearsal.result import Rehearsal
from seatrial.campaign.rehearsal.run import design_space, rehearse
from seatrial.campaign.rehearsal.vehicles import draw_vehicle, run_trial
from seatrial.campaign.store.stored_result import Store
from seatrial.cli.running import Exit
from seatrial.core.errors import InputError
from seatrial.vehicles.catalogue import load_surge
from tests.campaign.small import NO_X_U, write_small
from tests.cli.test_cli import results, run

pytestmark = pytest.mark.proof

VEHICLES = 3
EXACT = "[estimation]", '[estimation]\ninertia_error = "exact"\nscale_error = "exact"'
GOAL = ("[truth]", '[goal]\nsd = { X_uabsu = "2.5 %", T_nabsn = "2.5 %" }\ntrials = 3\n\n[truth]')


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return load_campaign(write_small(tmp_path_factory.mktemp("rehearsal") / "small", *NO_X_U, EXACT, GOAL))


@pytest.fixture(scope="module")
def space(small):
    return design_space(small, design_first(small))


@pytest.fixture(scope="module")
def found(small):
    return rehearse(small, VEHICLES)


def speed(control, drag, thrust, step=0.1):
    """The small vehicle's speed by Runge-Kutta in plain Python: (m + a) du/dt = X u|u| + (1 - t) T n|n|, from trim."""
    hull = load_surge("remus100_surge").hull
    assert hull.mass is not None
    mass, share = hull.mass - hull.fixed["X_udot"], 1.0 - hull.thrust_deduction

    def rate(u, n):
        return (drag * u * abs(u) + share * thrust * n * abs(n)) / mass

    u, shown = hull.trim["u"], []
    for n in control:
        shown.append(u)
        a = rate(u, n)
        b = rate(u + 0.5 * step * a, n)
        c = rate(u + 0.5 * step * b, n)
        d = rate(u + step * c, n)
        u = u + step * (a + 2 * b + 2 * c + d) / 6
    return np.array(shown)


def information(control, values, noise=0.05):
    """Fisher information about drag and thrust by central differences of that speed."""
    slopes = []
    for i in range(2):
        step = 1e-4 * abs(values[i]) * np.eye(2)[i]
        slopes.append((speed(control, *(values + step)) - speed(control, *(values - step))) / (2 * step[i]))
    return np.array(slopes) @ np.array(slopes).T / noise**2


def test_the_noise_of_a_trial_does_not_depend_on_the_design(small, space):
    vehicle = draw_vehicle(small, space.plan, space.trying, jax.random.key(1))
    truth = vehicle.values["X_uabsu"], vehicle.values["T_nabsn"]
    noise = {}
    for number in (1, 2):
        for design in (space.design(0), space.random(0, number)):
            record = run_trial(small, vehicle, number, design.control)
            noise.setdefault(number, []).append(record.channel("u") - speed(design.control[:, 0], *truth))
    for one, other in noise.values():
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)
    assert np.abs(np.corrcoef(noise[1][0], noise[2][0])[0, 1]) < 4 / np.sqrt(300)
    assert noise[1][0].std() == pytest.approx(0.05, rel=4 / np.sqrt(2 * 300))


def test_every_strategy_stops_at_the_goal_and_not_before(found):
    """Relative sds of the goal computed from what is stored."""
    data = found.data
    assert found.strategies == ("adaptive", "fixed", "random")
    good = (data["sd"] / np.abs(data["estimate"]) <= 0.025).all("coefficient").values
    ran = np.isfinite(data["sd"].values[..., 0])
    for vehicle, strategy in np.ndindex(*found.needed.shape):
        n = found.needed[vehicle, strategy]
        assert ran[vehicle, strategy].tolist() == [k < n for k in range(found.most)]
        assert not good[vehicle, strategy, : n - 1].any()
        assert good[vehicle, strategy, n - 1] == found.met[vehicle, strategy]
        assert found.met[vehicle, strategy] or n == found.most
    assert found.met.any()
    assert (found.needed > 1).any()


def test_all_begin_with_the_same_vehicle_and_two_with_the_same_trial(found):
    first = found.data["estimate"].values[:, :, 0]
    np.testing.assert_array_equal(first[:, 0], first[:, 1])
    assert (first[:, 2] != first[:, 1]).all()
    inside = np.abs(first - found.data["truth"].values[:, None]) < 5 * found.data["sd"].values[:, :, 0]
    assert inside.all()


def test_the_sd_is_that_of_the_information_of_all_trials(small, found, space):
    """Priors are flat inside their bounds, so that the precision is the sum of every trial's information and nothing else."""
    vehicle = int(np.argmax(found.needed[:, 1]))
    trials = found.needed[vehicle, 1]
    assert trials > 1
    designs = design_first(small)
    control = space.best_of(designs, designs.best.family.kind).control[:, 0]
    values = found.data["estimate"].values[vehicle, 1, trials - 1]
    expected = np.sqrt(np.diag(np.linalg.inv(trials * information(control, values))))
    np.testing.assert_allclose(found.data["sd"].values[vehicle, 1, trials - 1], expected, rtol=0.1)


def test_gains_of_the_designs(space):
    """0.5 ln |1 + P I| by the information of the plain simulation; the largest is chosen."""
    values, cov = np.array([-3.0, 6e-4]), np.array([[0.09, -1e-5], [-1e-5, 4e-9]])
    gains = space.gains(values, cov)
    for i in (0, len(gains) // 2, len(gains) - 1):
        expected = 0.5 * np.linalg.slogdet(np.eye(2) + cov @ information(space.control[i, :, 0], values))[1]
        assert gains[i] == pytest.approx(expected, rel=1e-4)
    chosen = space.most_informative(values, cov)
    np.testing.assert_array_equal(chosen.control, space.control[np.argmax(gains)])


def test_random_steps_are_new_in_every_trial_and_inside_the_limits(small, space):
    drawn = [space.random(vehicle, number).control for vehicle in (0, 1) for number in (1, 2)]
    assert len({control.tobytes() for control in drawn}) == 4
    for control in (one[:, 0] for one in drawn):
        assert not small.limits.excess(control, small.family.sample_time)
        assert np.abs(control - small.family.trim).max() <= space.swing
        assert space.trying[0].min() <= control.min() <= control.max() <= space.trying[1].max()


def test_resumes_to_the_same_bits_and_grows(small, found, monkeypatch):
    """Killed at the second vehicle, run again, and asked for more and for fewer."""
    path, real, done = Store(small.folder).rehearsal, module._rehearse_one, []

    def dies(*arguments):
        done.append(arguments[-1])
        if done == [0, 1]:
            raise KeyboardInterrupt
        return real(*arguments)

    path.unlink()
    monkeypatch.setattr(module, "_rehearse_one", dies)
    with pytest.raises(KeyboardInterrupt):
        rehearse(small, VEHICLES)
    assert rehearse(small, 2).data.equals(found.data.isel(vehicle=slice(2)))
    again = rehearse(small, VEHICLES)
    assert done == [0, 1, 1, 2]
    assert again.data.equals(found.data)
    assert rehearse(small, 2).data.equals(found.data.isel(vehicle=slice(2)))


def made_up():
    """Four vehicles, two strategies, three trials, one coefficient of which the truth is 0."""
    trials = np.array([[1, 3], [2, 3], [1, 2], [2, 2]])
    sd = np.where(np.arange(3) < trials[..., None], 1.0 / np.arange(1, 4), np.nan)[..., None]
    return Rehearsal(
        xr.Dataset(
            {
                "trials": (("vehicle", "strategy"), trials),
                "met": (("vehicle", "strategy"), np.array([[1, 0], [1, 1], [1, 1], [1, 1]])),
                "sd": (("vehicle", "strategy", "trial", "coefficient"), sd),
                "estimate": (("vehicle", "strategy", "trial", "coefficient"), sd * np.array([1.0, 1.7])[:, None, None]),
                "truth": (("vehicle", "coefficient"), np.zeros((4, 1))),
                "refused": ("vehicle", np.array([0, 2, 0, 0])),
            },
            {"strategy": ["adaptive", "random"], "coefficient": ["X_u"]},
        )
    )


def test_censored_vehicles_are_counted_and_said():
    found = made_up()
    assert found.trials_of("random") == pytest.approx((2.5, np.sqrt(1 / 3 / 4)))
    assert found.saved_against("random") == pytest.approx((1.0, np.sqrt(2 / 3 / 4)))
    assert found.share_met("random")[0].tolist() == [0.0, 0.5, 0.75]
    low, high = found.share_met("random")[1]
    assert (low < [1e-2, 0.5, 0.75]).all()
    assert (high > [0.0, 0.5, 0.75]).all()
    np.testing.assert_allclose(found.median_sd("adaptive")[:, 0], [1.0, 0.75, 0.75])
    assert found.honest_share("adaptive").value == 1.0
    assert found.honest_share("random").value == 0.0
    text = "\n".join(found.lines())
    assert "against random: redesigning each trial saves 1.00 ± 0.41 trials of 2.5" in text
    assert "ot meet the goal counts as 3 trials, although it needs more" in text
    assert "2 of 6 draws from the prior diverged" in text
    assert [alarm.split(":")[0] for alarm in found.alarms()] == ["random"]


def capped(met, vehicles):
    """Every strategy runs all its two trials; only whether the goal was met then differs."""
    data = made_up().data.isel(vehicle=np.full(vehicles, 1), trial=slice(2)).copy(deep=True)
    data["trials"][:], data["met"][:] = 2, np.array(met)
    return Rehearsal(data)


def test_strategies_that_the_cap_makes_alike_are_told_apart_by_what_they_reached():
    found = capped([[1, 0]] * 8 + [[1, 1]] * 4, 12)
    assert found.more_often("random")[1] == pytest.approx(2 / 2**8)
    (words,) = (line for line in found.verdicts() if line.startswith("against"))
    assert "in 100% of the vehicles and this in 33%, +67 ± 14 points" in words
    assert "chance" not in words
    assert "which may be chance" in capped([[1, 0]] * 3 + [[1, 1]] * 4, 7).verdicts()[0]
    assert "no difference beyond chance" in capped([[1, 1]] * 4, 4).verdicts()[0]


def test_the_share_of_honest_intervals_of_few_vehicles_has_a_binomial_interval():
    """All of twelve: 0.025^(1/12) at least."""
    found = capped([[1, 1]] * 12, 12)
    assert found.honest_band("adaptive") == pytest.approx((0.025 ** (1 / 12), 1.0))
    assert any("1.00 (0.74 to 1.00)" in line for line in found.lines())


@pytest.mark.parametrize("goal", ["", "[goal]\ntrials = 3\n\n"])
def test_without_a_goal_there_is_nothing_to_rehearse(tmp_path, goal):
    campaign = load_campaign(write_small(tmp_path, ("[truth]", f"{goal}[truth]")))
    with pytest.raises(InputError, match=r'\[goal\] with sd = \{ X_uabsu = "10 %" \}'):
        rehearse(campaign, VEHICLES)


def test_the_command_tells_and_draws(small, found, monkeypatch, capsys):
    code, out, _ = run(monkeypatch, capsys, "plan", small.folder, "--vehicles", VEHICLES, "--quiet")
    assert code in (Exit.OK, Exit.ALARMS)
    for word in ("adaptive saves", "against fixed", "against random", "rehearsal.svg"):
        assert word in out
    ElementTree.parse(small.folder / "rehearsal.svg")
    assert "rehearsal.svg" in results(small.folder)
