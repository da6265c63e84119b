"""Draws of a posterior, and linear models with them: closed forms, a ship's published constants, differences, python-control."""

import importlib.util
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.stats import chi2

from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.export.ensemble import OF_ONE_MODEL, OUTSIDE, ellipsoid_of, ensemble_of, widths_of
from seatrial.export.linear import linearise, numbers_of, parts_of, poles_of, responses, usual_speeds
from seatrial.export.motion import motion_of
from seatrial.export.targets.control import bode_frequencies
from seatrial.export.vehicle import CoefficientEstimates, PriorRanges
from seatrial.export.write import export_vehicle, make_exporter
from seatrial.vehicles.actuators import Actuator
from tests.export.cases import PROVENANCE, published, rich, with_law, with_terms


def numbers(vehicle, speed, ensemble=None):
    """Every number of every subsystem at a speed, by subsystem and name."""
    (linear,) = linearise(vehicle, (speed,), ensemble)
    size = 0 if ensemble is None else len(ensemble.values)
    return {(part.name, one.name): one for part in parts_of(vehicle, linear) for one in numbers_of(part, size)}


def test_surge_is_the_closed_form_and_its_error_that_of_the_delta_method():
    """-(X_u + 2 X_uu |u|) / (m - X_udot), and the gain at the propeller's speed that holds u."""
    vehicle = with_terms(published("remus100_surge"), X_u=-1.2)
    ensemble, u = ensemble_of(vehicle, 1000), 1.3
    c, mass = vehicle.coefficients, vehicle.hull.mass - vehicle.coefficients["X_udot"]
    slope, share = c["X_u"] + 2 * c["X_uabsu"] * u, 1 - vehicle.hull.thrust_deduction
    turns = np.sqrt(-(c["X_u"] * u + c["X_uabsu"] * u * u) / (share * c["T_nabsn"]))
    found = numbers(vehicle, u, ensemble)
    pole, gain = found["surge", "pole of u"], found["surge", "gain u by n"]
    assert pole.value.real == pytest.approx(slope / mass, rel=1e-9)
    assert found["surge", "time constant of u"].value.real == pytest.approx(-mass / slope, rel=1e-9)
    assert gain.value.real == pytest.approx(-2 * share * c["T_nabsn"] * turns / slope, rel=1e-9)
    assert gain.unit == "m/s per rad/s"
    sd = vehicle.estimated.sd[vehicle.estimated.names.index("X_uabsu")]
    assert pole.sd == pytest.approx(2 * u * sd / mass, rel=4 * 0.042)  # of 1000 draws, by the density at the quantiles


def test_the_mariner_has_its_published_nomoto_constants():
    """T1 = 118 s, T2 = 7.8 s, T3 = 18.5 s, K = 0.185 1/s at 15 knots: Fossen, Guidance and Control of Ocean Vehicles, 1994, table 5.1."""
    found = numbers(replace(published("mariner"), estimated=CoefficientEstimates()), 7.7175)
    assert found["yaw", "time constant of v"].value.real == pytest.approx(118.0, rel=0.005)
    assert found["yaw", "time constant of r"].value.real == pytest.approx(7.8, rel=0.005)
    assert -found["yaw", "Nomoto K"].value.real == pytest.approx(0.185, rel=0.005)
    assert found["yaw", "Nomoto T"].value.real == pytest.approx(118.0 + 7.8 - 18.5, rel=0.005)
    assert found["yaw", "Nomoto K"].sd is None


@pytest.mark.parametrize("speed", [1.0, 1.6])
def test_slopes_are_those_of_the_motion_and_the_trim_is_steady(speed):
    """Central differences of the exporters' motion in NumPy; lags are states of their own."""
    vehicle = replace(rich(), estimated=CoefficientEstimates())
    (linear,) = linearise(vehicle, (speed,), None)
    motion, at = motion_of(vehicle), dict(zip(linear.states, linear.state[0], strict=True))
    held = dict(zip(linear.inputs, linear.control[0], strict=True))
    assert linear.states[-2:] == ("n_act", "delta_r_act")
    assert at["u"] == speed

    def rates(changes):
        known = at | held | changes
        nu = np.array([known[rate] for rate in RATES])
        controls = {name: changes.get(name + "_act", changes.get(name, known[name])) for name in linear.inputs}
        return motion(nu, known["phi"], known["theta"], controls)

    assert np.abs(rates({})).max() < 1e-8
    known, h = at | held, 1e-6
    for i, name in enumerate(linear.states):
        centre = held[name.removesuffix("_act")] if name.endswith("_act") else known[name]
        slope = (rates({name: centre + h}) - rates({name: centre - h})) / (2 * h)
        np.testing.assert_allclose(linear.a[0, :6, i], slope, atol=5e-5, err_msg=name)
    direct = (rates({"delta_s": held["delta_s"] + h}) - rates({"delta_s": held["delta_s"] - h})) / (2 * h)
    np.testing.assert_allclose(linear.b[0, :6, linear.inputs.index("delta_s")], direct, atol=2e-5)
    lag = linear.states.index("n_act")
    assert (linear.a[0, lag, lag], linear.b[0, lag, linear.inputs.index("n")]) == (-2.0, 2.0)


def test_python_control_reads_the_module_and_agrees(tmp_path):
    """Poles, steady gain and frequency response of the files by another package."""
    control = pytest.importorskip("control")
    vehicle = replace(published(), actuators={"n": Actuator(0.4), "delta_r": Actuator(0.1), "delta_s": Actuator(0.0)})
    exporter = make_exporter("control", speeds=(1.0, 1.5), count=8)
    _, paths = export_vehicle(exporter, vehicle, PROVENANCE, tmp_path)
    spec = importlib.util.spec_from_file_location("linear_models", tmp_path / "linear_models.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    ensemble = ensemble_of(vehicle, 8)
    linear = linearise(vehicle, (1.0, 1.5), ensemble)[1]
    surge, yaw, *_ = parts_of(vehicle, linear)
    small, whole = module.model(1.5, part="yaw"), module.model(1.5)
    assert (small.state_labels, whole.input_labels) == (["v", "r"], list(vehicle.controls))
    np.testing.assert_allclose(np.sort(small.poles()), np.sort(poles_of(yaw.a)[0]), rtol=1e-9)
    known = {one.name: one.value.real for one in numbers_of(yaw, 8)}
    assert control.dcgain(small)[1].item() == pytest.approx(known["Nomoto K"])
    # The second-order transfer function by python-control: its zero gives T3.
    transfer = control.ss2tf(module.model(1.5, part="yaw")[1, 0])
    lead = transfer.num[0][0][-2] / transfer.num[0][0][-1]
    slow = -np.sum(1.0 / small.poles().real)
    assert known["Nomoto T"] == pytest.approx(slow - lead)
    frequency = np.array([0.05, 0.5, 5.0])
    for draw, row in ((None, 0), (3, 4)):
        result = module.model(1.5, draw)(1j * frequency)
        expected = responses(linear, surge, frequency)[row]
        np.testing.assert_allclose(result[whole.output_labels.index("u"), 0], expected, rtol=1e-7)
    assert len(module.ensemble(1.0, "surge")) == 8
    for path in paths:
        if path.suffix == ".svg":
            ElementTree.fromstring(path.read_text())
    assert {path.name for path in paths} == {"linear_models.py", "linear_models.mat", "bode_surge.svg", "bode_yaw.svg"}


def test_the_mat_file_has_names_units_and_arrays_that_end_in_draws_and_speeds(tmp_path):
    vehicle = published("bluerov2_heavy")
    exporter = make_exporter("control", count=5)
    export_vehicle(exporter, vehicle, PROVENANCE, tmp_path)
    data = loadmat(tmp_path / "linear_models.mat", simplify_cells=True)
    assert [str(x) for x in data["input_units"]] == ["kg m/s^2"] * 8
    assert data["ensemble_A"].shape == (10, 10, 5, 3)
    assert data["B"].shape == (10, 8, 3)
    hover, slow, fast = linearise(vehicle, usual_speeds(vehicle), ensemble_of(vehicle, 5))
    assert (hover.speed, fast.speed) == (0.0, 1.0)
    np.testing.assert_array_equal(data["ensemble_A"][:, :, 2, 1], slow.a[3])
    np.testing.assert_array_equal(data["A"][:, :, 2], fast.a[0])
    assert "abc123" in str(data["about"])
    # In hover the thrusters carry W - B, 0.982 N, and surge has only its linear damping.
    assert -hover.control[0, 4:].sum() == pytest.approx(-0.982, abs=1e-6)
    assert numbers(vehicle, 0.0)["surge", "pole of u"].value.real == pytest.approx(-13.7 / (13.5 + 6.36))


def test_modes_without_data_are_named():
    vehicle = published()
    wide = replace(vehicle.estimated, sd=40 * vehicle.estimated.sd, covariance=1600 * vehicle.estimated.covariance)
    known = numbers(vehicle, 1.5, ensemble_of(vehicle, 64))
    assert known["surge", "pole of u"].verdict == ""
    assert known["roll", "pole of p 1" if ("roll", "pole of p 1") in known else "pole of p"].verdict == "published"
    bounds = PriorRanges(np.array([-np.inf, 0.0]), np.array([0.0, np.inf]), 2 * wide.sd)
    unsure = replace(vehicle, estimated=replace(wide, prior=bounds))
    known = numbers(unsure, 1.5, ensemble_of(unsure, 64))
    derived = [known["surge", name] for name in ("pole of u", "time constant of u", "gain u by n")]
    assert [one.verdict for one in derived] == ["undetermined"] * 3
    assert min((one.sd or 0.0) / abs(one.value) for one in derived) < 0.5, "by its mode, whatever its own ± is"


def test_speeds_that_no_control_holds_say_what_holds_them_or_are_refused():
    vehicle = published("mariner")
    assert linearise(vehicle, (5.0,), None)[0].balance != 0
    with pytest.raises(InputError, match="no steady motion ahead at this speed"):
        linearise(replace(published(), hull=replace(published().hull, weight=400.0)), (0.05,), None)
    with pytest.raises(InputError, match="speeds"):
        make_exporter("control", speeds=(-1.0,)).check(published())


def test_draws_have_the_moments_stated_and_are_the_same_again():
    vehicle = published()
    count, sd = 1000, vehicle.estimated.sd
    ensemble = ensemble_of(vehicle, count, 3)
    assert ensemble.replaced == {}
    covariance = vehicle.estimated.covariance
    assert (np.abs(ensemble.values.mean(0) - vehicle.estimated.mean) < 4 * sd / np.sqrt(count)).all()
    error = np.sqrt((np.outer(sd**2, sd**2) + covariance**2) / count)  # of a covariance of normal draws
    assert (np.abs(np.cov(ensemble.values.T) - covariance) < 4 * error).all()
    again = ensemble_of(replace(vehicle), count, 3)
    np.testing.assert_array_equal(again.values, ensemble.values)
    inside = ellipsoid_of(vehicle.estimated).holds(ensemble.values)
    away = ensemble.values - vehicle.estimated.mean
    squared = np.einsum("ni,ij,nj->n", away, np.linalg.inv(vehicle.estimated.covariance), away)
    np.testing.assert_array_equal(inside, squared <= chi2.ppf(0.9, 2))
    assert inside.mean() == pytest.approx(0.9, abs=4 * np.sqrt(0.9 * 0.1 / count))


def test_impossible_draws_are_counted_and_replaced(tmp_path):
    """Drag that gives energy, mass that is none, and a thrust outside its prior: none is left, each is reported."""
    vehicle = with_terms(published(), Y_vdot=-2.0)
    names, mean = ("X_uabsu", "T_nabsn", "Y_vdot"), np.array([-2.93, 6.28e-4, -2.0])
    covariance = np.diag(np.array([2.0, 4e-4, 20.0]) ** 2)
    prior = PriorRanges(np.array([-9.0, 0.0, -np.inf]), np.array([9.0, np.inf, np.inf]), np.array([4.0, 4.1e-4, 80.0]))
    sd = np.sqrt(np.diag(covariance))
    vehicle = replace(vehicle, estimated=CoefficientEstimates(names, mean, sd, covariance, prior=prior))
    ensemble = ensemble_of(vehicle, 200)
    assert set(ensemble.replaced) == {OUTSIDE, "X_uabsu", "Y_vdot"}
    assert (ensemble.values[:, 0] < 0).all()
    assert (ensemble.values[:, 1] > 0).all()
    assert (vehicle.hull.mass - ensemble.values[:, 2] > 0).all()
    first, thrust, sway = widths_of(vehicle.estimated)
    assert (first.by_data, thrust.by_data, sway.by_data) == (True, False, True)
    statement, paths = export_vehicle(make_exporter("draws", count=200), vehicle, PROVENANCE, tmp_path)
    text = "\n".join(statement.lines)
    assert f"{sum(ensemble.replaced.values())} others were impossible and replaced" in text
    assert "T_nabsn = 0.000628 kg m/rad^2 by 65 % (0.00041 kg m/rad^2): the data did not inform it" in text
    data = np.load(next(path for path in paths if path.suffix == ".npz"))
    assert "abc123" in str(data["about"])
    assert data["weights"].sum() == pytest.approx(1.0)
    rows = np.loadtxt(next(path for path in paths if path.suffix == ".csv"), delimiter=",", comments="#", skiprows=1 + sum(
        line.startswith("#") for line in (tmp_path / "draws.csv").read_text().splitlines()
    ))  # fmt: skip
    np.testing.assert_array_equal(rows[:, 1:], data["draws"])


def test_published_values_have_no_draws_and_hopeless_ones_are_refused():
    bare = replace(published(), estimated=CoefficientEstimates())
    with pytest.raises(InputError, match="nothing to draw from"):
        make_exporter("draws").check(bare)
    vehicle = published()
    prior = PriorRanges(np.array([0.0, 0.0]), np.array([1.0, 1.0]), vehicle.estimated.sd)
    with pytest.raises(InputError, match="0 of 200 draws that can be a vehicle"):
        ensemble_of(replace(vehicle, estimated=replace(vehicle.estimated, prior=prior)), 10)
    with pytest.raises(InputError, match="whole number, 2 or more"):
        ensemble_of(vehicle, 1)


def test_estimated_gains_of_thrusters_are_in_the_slopes():
    """The command of each thruster counts by its gain, less astern; a lag is a state, so its command enters there."""
    law = replace(with_law(), actuators={}, estimated=CoefficientEstimates())
    (ours,), (stated,) = (linearise(one, (0.5,), None) for one in (law, replace(law, numbers={})))
    column, value = ours.inputs.index("f_3"), {name: one.value for name, one in law.numbers.items()}
    row = np.abs(stated.b[0, :, column]).argmax()
    gain = value["gain_f"] * value["gain_f_3"] * (value["reverse_f"] if ours.control[0, column] < 0 else 1.0)
    assert ours.b[0, row, column] == pytest.approx(gain * stated.b[0, row, column], rel=1e-9)
    assert any("dead_f" in line for line in make_exporter("control").carries(law).lost)


def test_a_propeller_that_stands_still_has_no_gain():
    """n|n| has no slope at 0 rad/s, where the search ends beside it; the pole is that of linear drag."""
    found = numbers(with_terms(published("remus100_surge"), X_u=-1.2), 0.0)
    assert found["surge", "gain u by n"].value == 0.0
    (linear,) = linearise(with_terms(published("remus100_surge"), X_u=-1.2), (0.0,), None)
    assert (linear.control == 0.0).all()


def test_a_bode_plot_has_the_natural_frequencies():
    vehicle = replace(rich(), estimated=CoefficientEstimates())
    (linear,) = linearise(vehicle, (1.5,), None)
    part = next(part for part in parts_of(vehicle, linear) if part.name == "yaw")
    frequency, poles = bode_frequencies(linear, part), np.linalg.eigvals(linear.a[0])
    natural = np.abs(poles[poles.imag > 0])
    inside = natural[(natural > frequency[0]) & (natural < frequency[-1])]
    assert inside.size
    assert np.isclose(frequency[:, None], inside, rtol=1e-12).any(0).all()


def test_cautions_of_an_undecided_model_and_of_speeds_without_records():
    vehicle = published()
    undecided = replace(vehicle, estimated=replace(vehicle.estimated, quoted="averaged"))
    exporter = make_exporter("control", speeds=(1.0, 1.5), count=50)
    lines = exporter.notes(undecided, replace(PROVENANCE, speeds=(1.2, 1.8)))
    cautions = [line for line in lines if line.startswith("caution")]
    assert cautions[0].startswith(f"caution: {OF_ONE_MODEL}")
    assert cautions[1:] == ["caution: 1 m/s lies outside the speeds of the fitted records, 1.2 to 1.8 m/s"]
    few = make_exporter("control", speeds=(1.0,), count=9).notes(vehicle, replace(PROVENANCE, speeds=None))
    assert [line for line in few if line.startswith("caution")] == [
        "caution: a ± of 9 draws is itself uncertain by 25 %",
        "caution: the speeds of the fitted records are not known, because u was not measured",
    ]
    assert not any("caution" in line for line in exporter.notes(vehicle, replace(PROVENANCE, speeds=(0.5, 2.0))))
    assert f"caution: {OF_ONE_MODEL}" in make_exporter("draws", count=8).notes(undecided, PROVENANCE)
