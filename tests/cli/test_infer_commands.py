"""`seatrial estimate --by`, `profile`, `select` and `criteria` as a user meets them."""

import re

import pytest

from seatrial.cli.running import Exit
from tests.campaign.small import write_small
from tests.cli.test_cli import results, run

MISTAKES = {
    "an unknown way": (["estimate", "--by", "magic"], ["magic", "equation-error"]),
    "a window for nothing": (["estimate", "--window", "2 s"], ["--window", "--by chains", "leave --window out"]),
    "a window without unit": (["estimate", "--by", "equation-error", "--window", "2"], ["--window", "remedy"]),
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


@pytest.mark.thorough
def test_modes_and_chains_of_every_structure(monkeypatch, capsys, tmp_path):
    write_small(tmp_path)
    code, out, err = run(monkeypatch, capsys, "estimate", tmp_path, "--by", "mode", "-q")
    assert code == Exit.OK, err
    assert out.startswith("M-0, the most probable of 2 structures (log evidence by Laplace ")
    assert len(re.findall(r"\n  M-1  without X_u  \d+\.\d nats  no caution\n", out)) == 1
    code, out, err = run(monkeypatch, capsys, "estimate", tmp_path, "--by", "mode", "-q", "--verbose")
    assert out.count("log evidence by Laplace") == 2
    code, out, err = run(monkeypatch, capsys, "estimate", tmp_path, "-q")
    assert code == Exit.OK, err
    assert (out.count("strongest correlation"), out.count("± contains")) == (1, 1)
    assert out.index("  X_u ") < out.index("  noise:\n    sigma_u ") < out.index("other structures, with")
    assert len(out.splitlines()) <= 25
    _, out, _ = run(monkeypatch, capsys, "estimate", tmp_path, "-q", "--verbose")
    assert out.count("strongest correlation") == 2
    assert "known/M-1.json" in " ".join(results(tmp_path))
