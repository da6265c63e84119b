"""`seatrial estimate --by`, `profile`, `select` and `criteria` as a user meets them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from seatrial.campaign.config import templates
from seatrial.campaign.selection import evidence
from seatrial.cli.running import Exit
from seatrial.messages import structures as messages
from seatrial.selection.verdict import Evidence
from tests.campaign.small import write_small
from tests.cli.test_cli import results, run

MISTAKES = {
    "an unknown way": (["estimate", "--by", "magic"], ["magic", "equation-error"]),
    "a window for nothing": (["estimate", "--window", "2 s"], ["--window", "--by chains", "leave --window out"]),
    "a window without unit": (["estimate", "--by", "equation-error", "--window", "2"], ["--window", "remedy"]),
    "a block that is no time": (["criteria", "--block", "2 m"], ["--block", "remedy"]),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_said_before_any_work(monkeypatch, capsys, tmp_path, name):
    (command, *options), words = MISTAKES[name]
    write_small(tmp_path)
    code, out, err = run(monkeypatch, capsys, command, tmp_path, *options)
    assert (code, out) == (Exit.BAD_INPUT, "")
    for word in words:
        assert word in err
    assert results(tmp_path) == ["campaign.toml"]


def test_a_regression_is_printed_and_not_kept(monkeypatch, capsys, tmp_path):
    write_small(tmp_path)
    code, out, err = run(monkeypatch, capsys, "estimate", tmp_path, "--by", "equation-error", "--window", "2 s", "-q")
    assert (code, err) == (Exit.OK, "")
    for word in ("M-0", "M-1", "plain", "refined", "X_uabsu", "first answers: a regression"):
        assert word in out
    assert not [path for path in results(tmp_path) if "posterior" in path]


def write_slow(folder):
    """Write the log template, filled in, and a log of 200 s at 10 Hz: white noise of 0.1 with a slow error of 0.03 m/s over 5 s."""
    text = (Path(templates.__file__).parent / "log.toml").read_text()
    text = text[: text.index("# The next trial is chosen")] + text[text.index("# If the report says") :]
    for place, name in (("LOG_", "log_"), ("TIME COLUMN", "t"), ("SPEED COLUMN", "u"), ("PROPELLER COLUMN", "n")):
        text = text.replace(place, name)
    (folder / "campaign.toml").write_text(text)
    rng, rho, u, slow, rows = np.random.default_rng(1), np.exp(-0.02), 1.5, 0.0, []
    for k, rpm in enumerate(np.repeat(rng.uniform(600, 1200, 20), 100)):
        slow = rho * slow + np.sqrt(1 - rho**2) * rng.normal()
        rows.append((0.1 * k, u + 0.1 * rng.normal() + 0.03 * slow, rpm))
        for _ in range(10):
            u += 0.01 * (0.9 * 12e-4 * (rpm * np.pi / 30) ** 2 - 6 * u * abs(u)) / 31
    np.savetxt(folder / "log_1.csv", rows, delimiter=",", header="t,u,n", comments="", fmt="%.6f")


@pytest.mark.proof
def test_a_slow_error_fitted_as_white_is_an_alarm_of_select_and_its_remedy_works_as_written(
    monkeypatch, capsys, tmp_path
):
    """Evidences are given, so that the mode is all that is computed; what the alarm asks for is put into the file word by word."""
    given = {"method": "given", "diagnostics": {"methods": {}, "notes": []}, "status": ""}
    monkeypatch.setattr(evidence, "_evidences", lambda *_: [Evidence(x, 0.01, **given) for x in (5.0, 0.0)])
    monkeypatch.setattr(messages, "agreement_words", lambda _: "")
    write_slow(tmp_path)
    code, out, err = run(monkeypatch, capsys, "select", tmp_path, "-q")
    assert code == Exit.ALARMS
    assert "these probabilities hold for the noise that is modelled, which the residuals contradict" in out
    (alarm,) = (line for line in err.splitlines() if line.startswith("alarm: "))
    assert "the probabilities of models and terms mean nothing: run 1: residuals of u are correlated (" in alarm
    assert 'Set estimation.residuals = "drifting"' in alarm
    code, out, _ = run(monkeypatch, capsys, "select", tmp_path, "-q", "--json")
    assert code == Exit.ALARMS
    assert ["alarm: " + text for text in json.loads(out)["alarms"]] == [alarm]
    sections = re.findall(r"\[(prior\.\w+)\][^[]*?distribution = (\S+), lower = (\S+) and upper = ([\d.]+)", alarm)
    assert [name for name, *_ in sections] == ["prior.drift_u", "prior.drift_time_u"]
    text = (tmp_path / "campaign.toml").read_text().replace('residuals = "white"', 'residuals = "drifting"')
    for name, kind, lower, upper in sections:
        text += f"\n[{name}]\ndistribution = {kind}\nlower = {lower}\nupper = {upper}\n"
    (tmp_path / "campaign.toml").write_text(text)
    code, out, err = run(monkeypatch, capsys, "select", tmp_path, "-q")
    assert (code, "alarm" in err) == (Exit.OK, False), err
    assert "these probabilities hold" not in out


@pytest.mark.thorough
def test_modes_and_chains_of_every_structure(monkeypatch, capsys, tmp_path):
    write_small(tmp_path)
    code, out, err = run(monkeypatch, capsys, "estimate", tmp_path, "--by", "mode", "-q")
    assert code == Exit.OK, err
    assert out.count("log evidence by Laplace") == 2
    code, out, err = run(monkeypatch, capsys, "estimate", tmp_path, "-q")
    assert code == Exit.OK, err
    assert out.count("strongest correlation") == 2
    assert "known/M-1.json" in " ".join(results(tmp_path))
