"""The best next trial by priors or draws: that of the sweep it rests on, and better known than before."""

from dataclasses import replace

import numpy as np
import pytest

import seatrial as st
from seatrial.design import trial_design
from seatrial.design.sweep import sweep_family
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.numerics.gaussian import Gaussian
from seatrial.vehicles.discretise import discretise

RPM = 2 * np.pi / 60
MODEL = st.load_vehicle("remus100_surge").build(free=["X_uabsu", "T_nabsn"])
FAMILY = st.Family("n", 1200 * RPM, duration=20.0, active=16.0, sample_time=0.1, kind="repeated-doublet")
PRIORS = {"T_nabsn": st.Normal(6.3e-4, 5e-5), "X_uabsu": st.Normal(-3.0, 0.5)}
GRID = np.array([100.0, 250.0]) * RPM, [4.0, 8.0]


def design(**more):
    return st.design_trial(problem(**more))


def problem(**more):
    asked = {"belief": PRIORS, "families": FAMILY, "start": {"u": 1.5}, "noise": {"u": 0.05}} | more
    return st.make_design_problem(MODEL, asked.pop("belief"), asked.pop("families"), *GRID, asked.pop("noise"), **asked)


@pytest.fixture(scope="module")
def found():
    return design()


def test_against_the_sweep_itself(found):
    """Coefficients in units of their own size, as the filter likes them, give what SI units give."""
    mean, sd = np.array([1.5, -3.0, 6.3e-4]), np.diag([0.05, 0.5, 5e-5])
    space = discretise(MODEL, ["u"], Gaussian(mean, sd), np.zeros(3), np.array([0.05]))
    sweep = sweep_family(space, FAMILY, *map(np.asarray, GRID))
    np.testing.assert_allclose(found.sweeps[0].gain, sweep.gain, rtol=1e-6)
    assert found.gain == pytest.approx(np.nanmax(sweep.gain))
    after = sweep.final_sd[sweep.best]
    assert found.sd_after == pytest.approx(dict(zip(("X_uabsu", "T_nabsn"), after, strict=True)), rel=1e-6)
    assert found.sd_before == pytest.approx({"X_uabsu": 0.5, "T_nabsn": 5e-5})


def test_the_best_is_named_as_a_campaign_names_it(found):
    heading = "repeated doublet of ±250 rpm about 1200 rpm in n, period 8 s: "
    assert repr(found).startswith(heading)
    assert heading in found._repr_html_()


def test_the_schedule_is_that_of_the_best(found):
    best = found.sweeps[0]
    row, column = best.best
    expected = FAMILY.schedule(float(best.amplitude[row]), float(best.period[column]))
    assert np.array_equal(found.schedule.controls["n"], expected.controls["n"])
    assert np.array_equal(found.schedule.time, expected.time)
    assert f"period {best.period[column]:.3g} s: {found.gain:.2f} nat" in str(found)


def test_slower_sensors_and_limits_count(found, monkeypatch):
    assert design(rates={"u": 1.0}).gain < found.gain
    inside = design(limits=Limits(upper=1350 * RPM))
    assert np.isnan(inside.sweeps[0].gain[1]).all()
    with pytest.raises(st.InputError, match="no design of 4 inside the limits"):
        design(limits=Limits(upper=1250 * RPM))
    monkeypatch.setattr(trial_design, "LANES", 2)
    row_by_row = trial_design.design_trial(problem(limits=Limits(upper=1350 * RPM)), trial_design.GridSearch())
    for name in ("gain", "peak_speed", "final_sd"):
        np.testing.assert_allclose(getattr(row_by_row.sweeps[0], name)[0], getattr(inside.sweeps[0], name)[0])
        assert getattr(row_by_row.sweeps[0], name).shape == getattr(inside.sweeps[0], name).shape


def test_own_utility_is_averaged_over_the_belief():
    """The D criterion, written by hand, is worth what the one of the library is."""
    covariance = np.cov(problem().draws.T)

    def entropy(information):
        return 0.5 * np.linalg.slogdet(np.eye(2) + covariance @ information)[1]

    entropy.unit = "nat"
    own, theirs = design(utility=entropy), design(utility="fisher-d")
    np.testing.assert_allclose(own.sweeps[0].worth, theirs.sweeps[0].worth, rtol=1e-9)
    assert str(own).splitlines()[0] == str(theirs).splitlines()[0]


def test_own_utility_keeps_a_number_for_each_design():
    with pytest.raises(st.InputError, match="a number for each matrix"):
        design(utility=lambda information: information.sum())


def test_families_compete(found):
    step = st.Family("n", 1200 * RPM, duration=20.0, active=16.0, sample_time=0.1, kind="step")
    both = design(families=[step, FAMILY])
    assert both.gain == found.gain
    assert {sweep.family.kind for sweep in both.sweeps} == {"step", "repeated-doublet"}


def test_draws_are_a_belief_too():
    rng = np.random.default_rng(0)
    values = rng.normal([6.3e-4, -3.0], [5e-5, 0.5], (4, 500, 2))
    draws = st.Draws(values, values[..., 0], 0.5, 0, ("T_nabsn", "X_uabsu"), ("kg m/rad^2", "kg/m"), values)
    assert design(belief=draws).gain == pytest.approx(design().gain, rel=0.05)


def test_a_family_without_a_design_inside_the_limits_is_refused_by_name(found):
    high = replace(FAMILY, trim=1300 * RPM, kind="step")
    limits = Limits(upper=1390 * RPM)
    both = design(families=[high, FAMILY], limits=limits)
    assert [sweep.family.kind for sweep in both.sweeps] == ["repeated-doublet"]
    assert both.gain == pytest.approx(float(found.sweeps[0].gain[0].max()), rel=1e-9)
    assert list(both.refused) == ["step"]
    assert "no design of 4" in both.refused["step"]
    with pytest.raises(st.InputError, match="at least one design inside the limits") as caught:
        design(families=[high, replace(high, kind="repeated-doublet")], limits=limits)
    assert "step: " in caught.value.found
    assert "repeated-doublet: " in caught.value.found


def test_sensors_give_every_so_many_samples():
    """At 10 samples a second: all without a rate or at a higher one, every third at three a second."""
    asked = replace(problem(), noise={"u": 0.1, "udot": 0.2, "n": 0.3}, rates={"udot": 3.0, "n": 40.0})
    mask = asked.measured(FAMILY.time().size, FAMILY.sample_time)
    assert mask.shape == (200, 3)
    assert mask[:, [0, 2]].all()
    np.testing.assert_array_equal(np.flatnonzero(mask[:, 1]), np.arange(0, 200, 3))


def test_controls_that_are_not_driven_are_held(found):
    trim = replace(problem(), trim={"delta_r": 0.1, "n": 5.0}).trim_of(FAMILY)
    assert trim == (("delta_r", 0.1), ("n", 1200 * RPM))
    schedule = replace(found, sweeps=(replace(found.sweeps[0], trim=trim),)).schedule
    np.testing.assert_array_equal(schedule.controls["n"], found.schedule.controls["n"])
    np.testing.assert_array_equal(schedule.controls["delta_r"], 0.1)


@pytest.mark.parametrize("other", [None, -0.2], ids=["of its own vehicle", "of another"])
def test_controls_of_a_sweep_s_designs_are_those_of_their_schedules(found, other):
    """Beside the driven one the rudder is held where the sweep's vehicle has it, or another one."""
    held = 0.1 if other is None else other
    sweep = replace(found.sweeps[0], trim=(("n", 1200 * RPM), ("delta_r", 0.1)))
    trim = None if other is None else (("n", 1200 * RPM), ("delta_r", other))
    rows, columns, every = sweep.inside(trim)
    assert list(zip(rows, columns, strict=True)) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    for row, column, control in zip(rows, columns, every, strict=True):
        shown = FAMILY.schedule(float(GRID[0][row]), GRID[1][column], delta_r=held).controls
        wanted = np.column_stack([shown["n"], shown["delta_r"]])
        np.testing.assert_allclose(control, wanted)
        np.testing.assert_allclose(sweep.controls(row, column, trim), wanted)
    np.testing.assert_array_equal(sweep.best_controls(trim), sweep.controls(*sweep.best, trim))
