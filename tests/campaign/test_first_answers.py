"""First answers: mode and regression of every structure, near the truth, and what they leave out said."""

import re
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.campaign.config.load import check_text, load_campaign
from seatrial.campaign.config.taken_as_exact import taken_as_exact
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.quick_estimates import (
    FirstAnswer,
    _smoothed,
    best_mode,
    keep_mode,
    posterior_modes,
    regressions,
)
from seatrial.campaign.prior.cautions import file_cautions
from seatrial.campaign.store.predictions import Predictions
from seatrial.campaign.store.stored_result import Store, read_result
from seatrial.campaign.workflow import whole_run
from seatrial.campaign.workflow.status import standing
from seatrial.campaign.workflow.steps import LOOP
from seatrial.cli.answer import Answer
from seatrial.cli.commands.loop import _chains_unasked, _report_of_mode
from seatrial.core.dataset_file import open_dataset
from seatrial.core.errors import InputError, NumericalError
from seatrial.core.findings import Finding
from seatrial.core.reporter import SILENT
from seatrial.report.numbers import Digits
from seatrial.selection.structures import Structure
from seatrial.vehicles.simulate import simulate
from tests.campaign.small import NO_X_U, write_small
from tests.campaign.test_profiles import Bars

EXACT = "[estimation]", '[estimation]\ninertia_error = "exact"'
ACCELERATION = ("[limits.n]", '[sensors.udot]\nnoise = "0.01 m/s^2"\n[limits.n]')


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    formulas = "[estimation]", '[estimation]\nforce_error = "exact"'
    campaign = load_campaign(write_small(tmp_path_factory.mktemp("first") / "small", ACCELERATION, formulas))
    return campaign, get_trials(campaign)


def apart(campaign, answer, column):
    """Distance from the truth of each coefficient in standard deviations."""
    truth = campaign.truth
    return [abs(pairs[column][0] - truth[name]) / pairs[column][1] for name, _, pairs in answer.rows if name in truth]


def test_the_mode_and_its_spread(tmp_path):
    campaign = load_campaign(write_small(tmp_path, *NO_X_U))
    bars = Bars()
    (answer,) = posterior_modes(campaign, get_trials(campaign), bars)
    assert bars.begun == ["mode M-0", "compare the modes", "errors of the models"]
    assert answer.structure.label == "M-0"
    assert max(apart(campaign, answer, 0)) < 4
    assert [name for name, _, _ in answer.rows] == ["X_uabsu", "T_nabsn", "sigma_u"]
    assert "log evidence by Laplace" in answer.lines()[0]
    assert [line.split()[0] for line in answer.lines()[1:5]] == ["X_uabsu", "T_nabsn", "noise:", "sigma_u"]
    contents, cause = answer.lines()[5:]
    assert "stated inputs (inertia 5 %, speed scale 1 %, time 0.5 sample), force formulas (7 %)" in contents
    assert cause.strip().startswith(
        "X_uabsu and T_nabsn: most of the ± is from forces along X that depart from their formulas. Add terms"
    )


def test_a_report_after_the_mode_is_a_first_answer_and_names_the_command_that_samples(tmp_path, monkeypatch):
    """Chains that took 6 000 s for the 6 000 samples times states of the demo campaign take 1 s for each here."""
    campaign = load_campaign(write_small(tmp_path, *NO_X_U))
    (record,) = get_trials(campaign).fit
    assert _chains_unasked(campaign) == ""  # nobody asked for the mode
    monkeypatch.setattr(
        whole_run, "learnt", lambda: dict.fromkeys((one.name for one in LOOP), 0.0) | {"estimates": 6000.0}
    )
    Store(tmp_path).mode.write_text("{}")
    remedy = _chains_unasked(campaign)
    minutes = record.time.size * len(campaign.structures) / 60
    said = f"`seatrial run {tmp_path}` samples the whole posterior, compares the models and writes the report, in about"
    assert remedy.startswith(f"{said} {minutes:.0f} min")
    assert _report_of_mode(campaign, SILENT, Answer("report"), remedy) == 0
    (answer,) = posterior_modes(campaign, get_trials(campaign))
    html = (tmp_path / "report.html").read_text()
    digits = Digits.of(*answer.rows[0][2][0])
    assert f">{digits.pair(*answer.rows[0][2][0])}</td>" in html
    assert re.findall('<section id="([a-z]+)"', html) == ["summary", "fit"]
    assert html.count("First answer, without chains") == 1
    assert "These are not the values to quote" in html
    assert f"<code>seatrial run {tmp_path}</code> samples" in html
    assert "`" not in html.partition("<main")[2]
    assert "seatrial-summary" not in html
    assert standing(tmp_path)[-1].state == "missing"
    assert not any(Store(tmp_path).posterior("M-0").parent.glob("*"))


def test_beside_a_standard_deviation_stands_what_makes_it_and_below_how_to_reduce_it(small):
    """The second structure lacks X_u, which the first one has."""
    _, lacking = posterior_modes(*small)
    drag = next(line for line in lacking.lines() if line.startswith("  X_uabsu"))
    assert " model 9" in drag
    assert drag.endswith(": a force X_u")
    remedy = lacking.contains[1]
    assert remedy.startswith("X_uabsu: most of the ± is from ")
    assert remedy.endswith("a force X_u. See `seatrial select`, as other structures have this force")


def test_a_structure_that_lacks_a_needed_term_ends_nothing(tmp_path):
    """Without X_u the data want X_uabsu = -3.7, beyond the bound of its prior; with it they are content, and its evidence tells."""
    strict = ("lower = -8.8", "lower = -3.2"), ('noise = "0.05 m/s"', 'noise = "0.002 m/s"')
    campaign = load_campaign(write_small(tmp_path, *strict))
    full, without = posterior_modes(campaign, get_trials(campaign))
    assert {name: pair[0] for name, _, (pair,) in without.rows}["X_uabsu"] < -3.19
    assert full.log_evidence > without.log_evidence + 20


@pytest.mark.proof
def test_a_prior_that_the_data_contradict_is_told_beside_the_mode(tmp_path):
    """X_uabsu is -2.93; its prior is about -9 ± 0.2."""
    wrong = 'distribution = "uniform"\nlower = -8.8\nupper = 0.0', 'distribution = "normal"\nmean = -9.0\nsd = 0.2'
    campaign = load_campaign(write_small(tmp_path, *NO_X_U, wrong))
    (answer,) = posterior_modes(campaign, get_trials(campaign))
    (found,) = [one for one in answer.cautions if isinstance(one, Finding) and one.code == "prior-contradicted"]
    assert found.subject == ("X_uabsu",)
    assert found.values["value"] < 0


def test_the_mode_predicts_what_was_held_back(tmp_path):
    campaign = load_campaign(write_small(tmp_path, *NO_X_U))
    trials = get_trials(campaign)
    (record,) = trials.fit
    trials = replace(trials, predict=(replace(record, label="2"),))
    (answer,) = posterior_modes(campaign, trials)
    assert answer.held_back is not None
    keep_mode(campaign, trials, answer)
    kept = read_result(Predictions, Store(tmp_path).mode_predictions, "run")
    assert (kept.records, kept.held_back, kept.channels) == (("2",), ("2",), ("u",))
    assert (kept.fits, kept.pooled) == (answer.held_back.fits, answer.held_back.pooled)
    curves = open_dataset(Store(tmp_path).mode_predictions)
    np.testing.assert_array_equal(curves["mean"].values, np.asarray(answer.held_back.curves[0]["mean"]))
    (fit,) = answer.held_back.fits
    values = {name: pairs[0][0] for name, _, pairs in answer.rows}
    model = campaign.model(answer.structure)
    start = jnp.array([record.channel("u")[0] if campaign.estimation.initial == "measured" else 1.54])
    motion = np.asarray(simulate(model, values, jnp.asarray(record.control), jnp.asarray(record.step), start))[:, 0]
    speed = record.channel("u")
    there = np.isfinite(speed)
    explained = 1 - np.sum((speed - motion)[there] ** 2) / np.sum((speed[there] - speed[there].mean()) ** 2)
    assert (fit.record, fit.channel, fit.held_back) == ("2", "u", True)
    assert fit.explained == pytest.approx(explained, abs=0.002)
    assert answer.lines()[-2].startswith("  held-back run 2: u ")
    assert f"{fit.explained:.1%} of the variance explained" in answer.lines()[-2]
    assert answer.lines()[-1].startswith("  held-back runs together: pass; ")


def test_a_regression_of_measured_accelerations_is_plain_and_refined(small):
    full, _ = regressions(*small)
    assert full.heads == ("plain", "refined")
    assert max(apart(small[0], full, 1)) < 5
    assert "measured accelerations" in full.lines()[0]
    smoothed, _ = regressions(*small, window=2.0)
    assert "smoothed by cubics over 2 s" in smoothed.lines()[0]
    assert np.isfinite([pair for _, _, pairs in smoothed.rows for pair in pairs]).all()
    with pytest.raises(InputError, match="choose another window"):
        regressions(*small, window=0.1)


def test_gaps_are_bridged_and_what_lies_inside_long_ones_is_left_out(small):
    campaign, trials = small
    (record,) = trials.fit
    measurement = record.measurement.copy()
    measurement[1::2] = np.nan
    measurement[100:150] = np.nan
    gappy = replace(trials, fit=(replace(record, measurement=measurement),))
    full, _ = regressions(campaign, gappy, window=2.0)
    assert max(apart(campaign, full, 1)) < 5
    model = campaign.model(campaign.structures[0])
    found = _smoothed(model, gappy.fit[0], 2.0)
    left_out = np.flatnonzero(np.isnan(found.acceleration)) + found.memory // 2
    # Sample 98 is the last one before the gap, 150 the first after it; a quarter of the window is 5 samples.
    assert left_out.tolist() == list(range(104, 145))


def test_what_a_regression_leaves_out_is_said(tmp_path):
    campaign = load_campaign(
        write_small(
            tmp_path,
            ("[sensors.u]", '[prior.delay]\ndistribution = "uniform"\nlower = 0.0\nupper = 1.0\n[sensors.u]'),
        )
    )
    full, _ = regressions(campaign, get_trials(campaign))
    assert "a regression of accelerations ignores delay, which biases its values" in " ".join(full.cautions)


def test_masses_and_known_forces_with_which_all_coefficients_scale_are_named(tmp_path):
    assert (
        taken_as_exact(load_campaign(write_small(tmp_path / "stated"))) == ""
    )  # the ± contains an error of the inertia
    campaign = load_campaign(write_small(tmp_path / "small", EXACT))
    assert taken_as_exact(campaign).startswith(
        "assumed exact, not in the ±: a mass of 30.48 kg and X_udot = -0.93 kg (all"
    )
    example = 'catalogue = "remus100_surge"', 'name = "YOUR VEHICLE"\nmass = "30 kg"\nfixed = { X_udot = -1.0 }'
    held = "[structure]", '[vehicle.trim]\nu = "1.5 m/s"\nn = "1194 rpm"\n[structure]'
    left = load_campaign(write_small(tmp_path / "example", example, held, EXACT))
    assert left.example_vehicle == file_cautions(left)[0]
    assert taken_as_exact(left).endswith(f"scale with them). {left.example_vehicle}")
    known = ('catalogue = "remus100_surge"', 'mass = "30 kg"\nfixed = { X_udot = -1.0, T_nabsn = 6e-4 }')
    no_thrust = 'always = ["X_uabsu", "T_nabsn"]', 'always = ["X_uabsu"]'
    prior = ('[prior.T_nabsn]\ndistribution = "uniform"\nlower = 2.0e-4\nupper = 12.0e-4\n', "")
    trim = ("[structure]", "[structure]"), ("T_nabsn = 6.28e-4\n", "")
    text = write_small(tmp_path / "forced", known, no_thrust, prior, EXACT, *trim) / "campaign.toml"
    text.write_text(text.read_text().replace("fixed = {", 'trim = { u = "1.5 m/s", n = "1194 rpm" }\nfixed = {'))
    both = "a mass of 30 kg, X_udot = -1 kg and T_nabsn = 0.0006 kg m/rad^2 (all coefficients of X scale with them)"
    assert both in taken_as_exact(load_campaign(tmp_path / "forced"))


def test_thrust_laws_are_named_but_of_thrusters_whose_gain_is_sought():
    """The gain of the third thruster of the example has a prior; the others drive X and N by their law."""
    said = taken_as_exact(load_campaign(Path(__file__).parents[2] / "examples" / "thruster_rov"))
    assert "the thrust law of f_1, f_2 and f_4 (all coefficients of X scale with them)" in said


def test_the_inertia_by_which_all_of_yaw_scales_is_named(tmp_path):
    text = """
[estimation]
inertia_error = "exact"
[campaign]
name = "turns"
seed = 1
[vehicle]
name = "own"
mass = "62 kg"
inertia = ["0.4 kg m^2", "6.8 kg m^2", "6.8 kg m^2"]
moves = ["u", "r"]
fixed = { X_udot = -2.6, N_rdot = -5.5 }
trim = { u = "1.6 m/s", n = "1200 rpm", delta_r = "0 deg" }
[structure]
always = ["X_uabsu", "T_nabsn", "N_ur", "N_uudelta_r"]
[sensors.u]
noise = "0.03 m/s"
[sensors.r]
noise = "0.5 deg/s"
"""
    names = {"X_uabsu": (-20, -3), "T_nabsn": (5e-4, 3e-3), "N_ur": (-25, 0), "N_uudelta_r": (-15, 0)}
    for name, (low, high) in names.items():
        text += f'[prior.{name}]\ndistribution = "uniform"\nlower = {low}\nupper = {high}\n'
    text += '[design]\ncontrol = "n"\nduration = "60 s"\nactive = "40 s"\nsample_time = "0.1 s"\n'
    text += 'amplitude = { from = "50 rpm", to = "300 rpm", points = 3 }\nperiod = { from = "2 s", to = "40 s", points = 3 }\n'
    said = "a moment of inertia of 6.8 kg m^2 and N_rdot = -5.5 kg m^2 (all coefficients of N scale with them)"
    assert taken_as_exact(check_text(tmp_path, text)).endswith(f"coefficients of X and T scale with them); {said}")
    held = text.replace("fixed = {", "fixed = { N_uudelta_r = -6.5,").replace('"N_ur", "N_uudelta_r"]', '"N_ur"]')
    held = held.replace('[prior.N_uudelta_r]\ndistribution = "uniform"\nlower = -15\nupper = 0\n', "")
    said = "N_rdot = -5.5 kg m^2 and N_uudelta_r = -6.5 kg/rad (all coefficients of N scale with them)"
    assert said in taken_as_exact(check_text(tmp_path, held))


def test_the_most_probable_mode_counts_the_prior_of_its_structure():
    """The first is 1 nat ahead in evidence and 2 nats behind in the prior; the third has no mode."""
    one, two, lost = (Structure(f"M-{index}", ()) for index in range(3))
    answers = [
        FirstAnswer(one, log_evidence=1.0, log_prior=-3.0),
        FirstAnswer(two, log_evidence=0.0, log_prior=-1.0),
        FirstAnswer(lost, alarm="no mode"),
    ]
    assert best_mode(answers).structure is two
    with pytest.raises(NumericalError, match="no mode"):
        best_mode(answers[2:])
