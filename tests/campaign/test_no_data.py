"""A campaign without data designs and rehearses; what needs a record says what is missing; a log added later goes on with it."""

import re
import shutil
import tomllib

import numpy as np
import pytest
import xarray as xr

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.schema import CampaignFile
from seatrial.campaign.config.templates import TEMPLATES, init_campaign
from seatrial.campaign.data.no_record import import_example, truth_example
from seatrial.campaign.design.sweep import design_first
from seatrial.campaign.prior.cautions import file_cautions
from seatrial.campaign.rehearsal.run import rehearse
from seatrial.campaign.store.stored_result import Store
from seatrial.campaign.workflow.loop import run_loop
from seatrial.campaign.workflow.status import standing
from seatrial.cli.running import Exit
from seatrial.core.errors import InputError
from seatrial.report.page import write_report
from seatrial.report.sections.designs import trial_section
from tests.campaign.small import NO_X_U, write_small
from tests.cli.test_cli import results, run

TRUTH = "[truth]\nX_uabsu = -2.93\nT_nabsn = 6.28e-4\n"
BY_HAND = (
    'catalogue = "remus100_surge"',
    'mass = "30.48 kg"\nthrust_deduction = 0.1\nfixed = { X_udot = -0.93 }\ntrim = { u = "1.5 m/s", n = "1200 rpm" }',
)
NEEDS_A_RECORD = (
    "simulate",
    "import",
    "estimate",
    "profile",
    "select",
    "criteria",
    "tuning",
    "calibrate",
    "next",
    "report",
)


def write_without_data(folder, *replacements):
    return write_small(folder, *NO_X_U, (TRUTH, ""), *replacements)


def a_log(schedule):
    """Time, speed and propeller of a vehicle that ran a schedule, by Euler's rule in plain Python, with noise."""
    at, rpm = np.loadtxt(schedule, delimiter=",", skiprows=1).T
    noise, u, rows = np.random.default_rng(4), 1.54, []
    for i in range(6000):
        n = np.interp(0.005 * i, at, rpm) * np.pi / 30
        if i % 20 == 0:
            rows.append(f"{0.005 * i:.2f},{u + 0.05 * noise.standard_normal():.4f},{n * 30 / np.pi:.2f}")
        u += 0.005 * (-2.93 * u * abs(u) + 0.9 * 6.28e-4 * n * abs(n)) / (30.48 + 0.93)
    return "time,u,n\n" + "\n".join(rows) + "\n"


@pytest.fixture(scope="module")
def designed(tmp_path_factory):
    folder = write_without_data(tmp_path_factory.mktemp("no_data") / "boat")
    return folder, design_first(load_campaign(folder))


def test_the_design_is_that_of_a_campaign_that_simulates(designed, tmp_path):
    found = design_first(load_campaign(write_small(tmp_path, *NO_X_U)))
    np.testing.assert_array_equal(found.best.gain, designed[1].best.gain)
    assert found.lines() == designed[1].lines()


def test_priors_and_designs_are_told(monkeypatch, capsys, designed, tmp_path):
    shutil.copytree(designed[0], tmp_path / "boat")
    code, out, _ = run(monkeypatch, capsys, "prior", tmp_path / "boat", "--quiet")
    assert code == Exit.OK
    assert "steady speed at n = 1194 rpm" in out
    assert "the best design" in out
    code, out, _ = run(monkeypatch, capsys, "design", tmp_path / "boat", "--quiet", "--sensors", "--trials", 2)
    assert code == Exit.OK
    assert "best design: repeated doublet" in out
    assert "expected precision of each coefficient" in out
    assert out.endswith("add its log to this campaign: `seatrial check " + f"{tmp_path / 'boat'}` explains how\n")
    assert "2 trials together" in out
    assert "u of noise" in out
    code, out, _ = run(monkeypatch, capsys, "export", tmp_path / "boat", "--trial")
    assert code == Exit.OK
    assert "from design_schedule.csv" in out


@pytest.mark.parametrize("command", NEEDS_A_RECORD)
def test_what_needs_a_record_says_what_is_missing(monkeypatch, capsys, tmp_path, command):
    folder = write_without_data(tmp_path)
    Store(folder).results.mkdir()
    Store(folder).record("trial").parent.mkdir()
    Store(folder).record("trial").write_text("left behind by a truth that was removed")
    if command in ("next", "report"):
        monkeypatch.setattr("seatrial.campaign.design.sweep.design_first", lambda campaign, reporter: None)
    code, out, err = run(monkeypatch, capsys, command, folder, "--quiet")
    assert (code, out) == (Exit.BAD_INPUT, "")
    assert "neither [import] nor [truth], so there is no trial" in err
    assert "seatrial design" in err
    assert "seatrial inspect LOG --map" in err


def test_the_examples_of_what_is_missing_can_be_pasted(tmp_path):
    for make in (import_example, truth_example):
        folder = write_without_data(tmp_path / make.__name__)
        example = make(load_campaign(folder))
        with (folder / "campaign.toml").open("a") as file:
            file.write(f"\n{example}\n")
        assert load_campaign(folder).has_records
    assert truth_example(load_campaign(folder)) == "[truth]\nX_uabsu = -4.4\nT_nabsn = 0.0007"


def test_check_says_where_a_campaign_without_records_stands(monkeypatch, capsys, designed):
    code, out, err = run(monkeypatch, capsys, "check", designed[0], "--quiet")
    assert (code, err) == (Exit.OK, "")
    assert "is valid; there is no record to check yet" in out
    assert "design: current; import: missing" in out
    assert "[[import.files]]" in out


def test_check_says_which_terms_may_be_one_and_that_a_start_is_not_held(monkeypatch, capsys, tmp_path):
    """By hand: -X_uabsu u^2 = 0.9 T_nabsn n^2 at n = 1200 rpm, for both priors at their means, is a speed of 1.5 m/s."""
    write_without_data(tmp_path / "good", BY_HAND)
    assert file_cautions(load_campaign(tmp_path / "good")) == []
    fast = (BY_HAND[0], BY_HAND[1].replace("1.5 m/s", "5 m/s"))
    terms = ('always = ["X_uabsu", "T_nabsn"]', 'always = ["X_uabsu", "X_uu", "T_nabsn"]')
    prior = ("[sensors.u]", '[prior.X_uu]\ndistribution = "uniform"\nlower = -1.0\nupper = 0.0\n\n[sensors.u]')
    write_without_data(tmp_path / "bad", fast, terms, prior)
    one, held = file_cautions(load_campaign(tmp_path / "bad"))
    assert one.startswith("X_uabsu and X_uu differ only when u changes its sign")
    low, high = map(
        float,
        re.search(
            r"begins at 5 m/s, but by 90 % of the prior n = 1200 rpm gives ([\d.]+) to ([\d.]+) m/s", held
        ).groups(),
    )
    assert low < 1.5 < high < 5
    code, _, said = run(monkeypatch, capsys, "check", tmp_path / "bad")
    assert code == Exit.OK
    assert all(f"caution: {text}" in said for text in (one, held))


def test_a_limit_far_beyond_the_trim_is_doubted(tmp_path):
    folder = write_without_data(tmp_path, BY_HAND)
    path = folder / "campaign.toml"
    before = path.read_text()
    upper = tomllib.loads(before)["limits"]["n"]["upper"]
    path.write_text(before.replace(f'"{upper}"', '"1.2e30 rpm"'))
    (said,) = file_cautions(load_campaign(folder))
    assert said.startswith("the upper limit of n is 1.2e+30 rpm, 1e+27 times the trim: it limits nothing")


@pytest.mark.parametrize(
    ("trim", "key", "words"),
    [
        ("", "vehicle.trim.u", '"0 m/s" begins at rest'),
        ('trim = { n = "1200 rpm" }', "vehicle.trim.u", "the speed at which a trial begins"),
        ('trim = { u = "1.5 m/s" }', "vehicle.trim.n", 'add n = "1200 rpm" to the trim'),
    ],
)
def test_where_a_trial_begins_has_to_be_stated(tmp_path, trim, key, words):
    stated = BY_HAND[1].replace('trim = { u = "1.5 m/s", n = "1200 rpm" }', trim)
    measured = ("chains = 16", 'initial = "measured"\nchains = 16')
    folder = write_without_data(tmp_path, (BY_HAND[0], stated), measured)
    lines = (folder / "campaign.toml").read_text().splitlines()
    line = 1 + lines.index(trim or "[vehicle]")
    with pytest.raises(InputError) as raised:
        load_campaign(folder)
    assert f"campaign.toml:{line}, key {key}" in str(raised.value)
    assert words in str(raised.value)


def test_a_trial_may_begin_at_rest_or_with_a_trim_of_its_own(tmp_path):
    trim = 'trim = { u = "1.5 m/s", n = "1200 rpm" }'
    load_campaign(write_without_data(tmp_path, (BY_HAND[0], BY_HAND[1].replace(trim, 'trim = { u = "0 m/s" }'))))
    own = (BY_HAND[0], BY_HAND[1].replace(trim, 'trim = { u = "1.5 m/s" }'))
    load_campaign(write_without_data(tmp_path, own, ('control = "n"', 'control = "n"\ntrim = "1200 rpm"')))


def test_where_every_other_control_is_held_has_to_be_stated(tmp_path):
    path = init_campaign(tmp_path, "steering")
    path.write_text(path.read_text().replace(', n = "1194 rpm"', ""))
    with pytest.raises(InputError, match=r'toml:\d+, key vehicle.trim.n(.|\n)*for example n = "0 rpm"'):
        load_campaign(tmp_path)


def required(model, path=()):
    """Paths of all keys that a table has to have, those of the tables below it too."""
    for name, field in model.model_fields.items():
        here = (*path, field.alias or name)
        if field.is_required():
            yield here
            if hasattr(field.annotation, "model_fields"):
                yield from required(field.annotation, here)


@pytest.mark.parametrize("key", [".".join(key) for key in required(CampaignFile)])
def test_a_missing_key_is_asked_for_with_a_line_to_copy(tmp_path, key):
    path = init_campaign(tmp_path, "design")
    content = place = tomllib.loads(path.read_text())
    *tables, last = key.split(".")
    for name in tables:
        place = place[name]
    del place[last]
    path.write_text("\n".join(toml(content)))
    with pytest.raises(InputError) as raised:
        load_campaign(tmp_path)
    assert f"key {key}\n" in str(raised.value)
    copied = str(raised.value).partition("for example")[2].strip()
    assert (tables or [last])[-1] in copied or last in copied
    tomllib.loads(copied)


def toml(content, path=""):
    """Lines of TOML of tables, strings, numbers, truths and lists of strings."""
    import json

    yield from (f"{name} = {json.dumps(value)}" for name, value in content.items() if not isinstance(value, dict))
    for name, value in content.items():
        if isinstance(value, dict):
            yield f"[{path}{name}]"
            yield from toml(value, f"{path}{name}.")


def test_every_template_is_named_when_one_is_written(monkeypatch, capsys, tmp_path):
    code, out, _ = run(monkeypatch, capsys, "init", tmp_path / "boat", "--template", "design")
    assert code in (Exit.OK, None)
    assert f"then: seatrial design {tmp_path / 'boat'}" in out
    for name, meaning in TEMPLATES.items():
        assert meaning in out
        assert name == "design" or f"--template {name}" in out
    assert results(tmp_path) == ["boat/campaign.toml"]


@pytest.fixture(scope="module")
def gone_on(designed, tmp_path_factory):
    """The same campaign after its trial: the log and its map are all that is new."""
    folder = tmp_path_factory.mktemp("gone_on") / "boat"
    shutil.copytree(designed[0], folder)
    store = Store(folder)
    before = store.design.read_bytes(), store.schedule(store.design).read_bytes()
    (folder / "log_1.csv").write_text(a_log(store.schedule(store.design)))
    example = import_example(load_campaign(folder))
    with (folder / "campaign.toml").open("a") as file:
        file.write(f"\n{example}\n")
    return folder, before, run_loop(load_campaign(folder))


@pytest.mark.proof
def test_a_log_goes_on_with_the_design(gone_on):
    folder, before, outcome = gone_on
    store = Store(folder)
    assert (store.design.read_bytes(), store.schedule(store.design).read_bytes()) == before
    assert [record.label for record in outcome.trials.fit] == ["1"]
    for name, true in (("X_uabsu", -2.93), ("T_nabsn", 6.28e-4)):
        row = outcome.chosen.data.sel(parameter=name)
        assert abs(float(row["mean"]) - true) < 4 * float(row["sd"])
        assert float(row["sd"]) < 0.3 * float(row["prior_sd"])
    assert outcome.next.basis == "the posterior of M-0"
    assert outcome.summary.next_trial.best.gain_nat < outcome.first.best.gain[outcome.first.best.best]
    assert xr.load_dataset(store.next_design, engine="h5netcdf").attrs["basis"] == outcome.next.basis
    states = {step.name: step.state for step in standing(folder)}
    assert states == {
        "design": "current",
        "import": "current",
        **dict.fromkeys(["estimate", "select", "predict", "next"], "current"),
        "report": "missing",
    }


@pytest.mark.proof
def test_the_report_has_both_the_design_and_the_log(gone_on):
    section, page = trial_section(gone_on[2]), write_report(gone_on[2]).read_text()
    assert ["<i>n</i>" in row["label"] for row in section["design"]["rows"]] == [False, True]
    for words in (
        "The first trial, designed without data",
        "Real records",
        "Measured u against control n",
    ):
        assert words in page


@pytest.mark.proof
def test_vehicles_of_the_priors_rehearse_it(tmp_path):
    goal = ("[estimation]", '[goal]\nsd = { X_uabsu = "6 %" }\ntrials = 2\n\n[estimation]')
    found = rehearse(load_campaign(write_without_data(tmp_path, goal)), 2)
    assert found.vehicles == 2
    assert "adaptive" in found.strategies
