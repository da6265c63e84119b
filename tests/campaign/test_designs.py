"""Designs of a campaign: several families over one grid, kept on disk, the best first."""

import numpy as np
import pytest

import seatrial as st
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.design.searches import compare_measures, search_design
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import InputError
from tests.campaign.small import SMALL


def campaign(folder, families):
    (folder / "campaign.toml").write_text(SMALL.replace("[design]\n", f"[design]\nfamilies = {families}\n"))
    return load_campaign(folder)


def test_families_share_a_grid_and_the_best_comes_first(tmp_path):
    """A spiral of seventeen levels only fits into 20 s at the shortest period of the grid, a chirp at any."""
    made = campaign(tmp_path, ["step", "repeated-doublet", "chirp", "spiral"])
    found = design_first(made)
    best = [float(np.nanmax(sweep.gain)) for sweep in found.sweeps]
    assert best == sorted(best, reverse=True)
    assert {sweep.family.kind for sweep in found.sweeps} == {"step", "repeated-doublet", "chirp"}
    assert list(found.refused) == ["spiral"]
    assert "to 1.176 s" in found.refused["spiral"]
    again = design_first(made)
    assert again.lines() == found.lines()
    assert found.lines()[0].startswith(found.best.family.words)
    schedule = Store(tmp_path).schedule(Store(tmp_path).design).read_text().splitlines()
    assert schedule[0] == "time_s,n_rpm"


@pytest.mark.parametrize(
    ("families", "message"),
    [
        (["doublets"], 'did you mean "doublet"'),
        (["step", "step"], "each family once"),
        (["spiral"], "to 1.176 s"),
    ],
)
def test_families_that_cannot_be_swept(tmp_path, families, message):
    with pytest.raises(InputError, match=message):
        design_first(campaign(tmp_path, families))


def with_goal(folder, goal):
    (folder / "campaign.toml").write_text(f"{SMALL}\n[goal]\n{goal}\n")
    return load_campaign(folder).goal


def test_a_goal_names_what_is_not_known_well_enough(tmp_path):
    goal = with_goal(tmp_path, 'sd = { X_u = "10 %", T_nabsn = 1e-5, X_uabsu = "0.5 kg/m" }')
    assert goal.unmet({"X_u": (-1.0, 0.2), "T_nabsn": (6e-4, 0.9e-5), "X_uabsu": (-3.0, 0.6)}) == pytest.approx(
        {"X_u": 2.0, "X_uabsu": 1.2}
    )
    assert goal.unmet({"T_nabsn": (6e-4, 2e-5)}) == pytest.approx({"T_nabsn": 2.0})


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ('sd = { X_v = "10 %" }', "goal.sd.X_v"),
        ('sd = { X_u = "ten %" }', 'a percentage such as "10 %"'),
        ('sd = { X_u = "-1 %" }', "a positive standard deviation"),
        ('sd = { X_u = "1 kg" }', "goal.sd.X_u"),
        ("trials = 0", "goal.trials"),
    ],
)
def test_goal_without_meaning_is_refused(tmp_path, goal, message):
    with pytest.raises(InputError, match=message):
        with_goal(tmp_path, goal)


NARROW = SMALL.replace("lower = -3.6\nupper = 1.2", "lower = -1.6\nupper = -0.8").replace(
    "lower = -8.8\nupper = 0.0", "lower = -3.3\nupper = -2.6"
)


def weighed(folder, design="", more=""):
    (folder / "campaign.toml").write_text(NARROW.replace("[design]\n", f"[design]\n{design}\n") + more)
    return design_first(load_campaign(folder))


def fastest(family, amplitude, period, drag, thrust):
    """Largest speed of one vehicle, by Euler steps of a hundredth of a second."""
    _, control = family.manoeuvre(float(amplitude), float(period)).sample(0.1)
    u, most = 1.541862, 0.0
    for n in np.repeat(control, 10):
        u += 0.01 * (drag[0] * u + drag[1] * u * abs(u) + 0.9 * thrust * n * abs(n)) / 31.41
        most = max(most, u)
    return most


def test_limits_of_the_motion_leave_the_gentle_designs(tmp_path):
    """All designs that the fastest vehicle of the priors can run are kept, none that one of ninety in a hundred cannot."""
    sweep = (found := weighed(tmp_path, more="\n[limits.u]\nupper = '2.36 m/s'\n")).best
    grid = [(a, p) for a in sweep.amplitude for p in sweep.period]
    bold, quick = (
        np.reshape([fastest(sweep.family, a, p, drag, thrust) for a, p in grid], sweep.gain.shape) > 2.36
        for drag, thrust in (((-0.8, -2.6), 12e-4), ((-1.2, -2.95), 11e-4))
    )
    allowed = np.isfinite(sweep.gain)
    assert allowed[~bold].all()
    assert not allowed[quick].any()
    assert 0 < allowed.sum() < allowed.size
    assert any("u at most 2.36 m/s: holds in" in line for line in found.safety)


def test_a_utility_and_a_battery_change_what_is_best(tmp_path):
    plain = weighed(tmp_path)
    thrifty = weighed(
        tmp_path,
        'utility = "fisher-d"\nper = "joule"',
        '\n[power]\nhotel = "0 W"\npropulsion = "40 W"\nat = "1500 rpm"\n',
    )
    assert plain.best.utility is not None
    assert np.array_equal(plain.best.worth[np.isfinite(plain.best.gain)], plain.best.gain[np.isfinite(plain.best.gain)])
    row, column = thrifty.best.best
    control = thrifty.best.best_manoeuvre().sample(0.1)[1]
    joules = 0.1 * 40.0 * np.sum((control / (1500 * np.pi / 30)) ** 3)
    assert thrifty.best.worth[row, column] * joules == pytest.approx(plain.best.gain[row, column], rel=0.1)
    assert "nat/J" in thrifty.lines()[0]


def test_energy_needs_a_propeller_and_its_power(tmp_path):
    with pytest.raises(InputError, match="without"):
        weighed(tmp_path, 'per = "joule"')
    force = NARROW.replace("T_nabsn", "X_tau_X").replace("2.0e-4", "0.5").replace("12.0e-4", "1.5")
    force = force.replace('control = "n"', 'control = "tau_X"\nper = "joule"').replace("limits.n", "limits.tau_X")
    for rpm, newtons in (("1500", "30"), ("100", "5"), ("200", "20"), ("0", "-30")):
        force = force.replace(f"{rpm} rpm", f"{newtons} N")
    (tmp_path / "campaign.toml").write_text(force.replace("T_nabsn = 6.28e-4", "X_tau_X = 1.0"))
    with pytest.raises(InputError, match="the propeller n"):
        load_campaign(tmp_path)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("[limits.v]\nupper = '1 m/s'", "a control, a state or a track: n, u, distance, advance"),
        ("[limits.u]\nrate = '1 m/s^2'", "rates are limited of controls only"),
        ("[limits.u]", "no bound"),
        ("[limits.u]\nlower = '2 m/s'\nupper = '1 m/s'", "lower below upper"),
        ("[limits.distance]\nlower = '2 m'", "expected: upper"),
        ("[limits.u]\nupper = '1 m/s'", "at least one design that keeps all limits"),
    ],
)
def test_limits_of_the_motion_that_cannot_be_kept(tmp_path, more, message):
    with pytest.raises(InputError, match=message):
        weighed(tmp_path, more=f"\n{more}\n")


@pytest.mark.proof
def test_cheap_measures_are_held_against_the_expected_gain(tmp_path):
    """Vehicles known to a few per cent: the posterior is normal, so that all measures of information are nearly one."""
    (tmp_path / "campaign.toml").write_text(NARROW)
    found = compare_measures(load_campaign(tmp_path), 6)
    gain, error = found.data["expected information gain"].values, found.data["error"].values
    over_draws = found.data["fisher-d over 32 draws"].values
    assert gain.size >= 5
    assert np.abs(gain - over_draws).max() < 0.5
    assert (error < 0.02 * gain).all()
    assert "has the largest expected information gain" in found.lines()[0]
    assert len(found.agreements) == 6
    assert all(-1 <= one.correlation <= 1 for one in found.agreements)


def test_library_designs_the_trial_of_a_campaign(tmp_path):
    """Without a folder, by public functions, to the last bit."""
    made = campaign(tmp_path, ["step", "repeated-doublet"])
    model = made.model(made.full)
    problem = st.make_design_problem(
        model,
        {name: made.priors[name] for name in made.full.terms},
        made.families,
        *made.design.grid(),
        made.noise,
        start=dict(zip(model.states, made.state_trim(model), strict=True)),
        limits=made.control_limits,
        key=made.seed,
    )
    ours, theirs = st.design_trial(problem), design_first(made)
    assert [sweep.family for sweep in ours.sweeps] == [sweep.family for sweep in theirs.sweeps]
    for one, other in zip(ours.sweeps, theirs.sweeps, strict=True):
        np.testing.assert_array_equal(one.gain, other.gain)
        np.testing.assert_array_equal(one.final_sd, other.final_sd)
    assert ours.lines() == theirs.lines()
    assert st.design_trial(problem, st.GlobalSearch(32), ours) == search_design(made, 32)[0]
