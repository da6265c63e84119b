"""What a command loads before it answers: nothing heavy on the way to help, a new campaign, or an answer that is still true."""

import json
import subprocess
import sys

import pytest

from seatrial.__main__ import COMMANDS
from seatrial.campaign.store.stored_result import Store
from seatrial.cli.running import Exit
from tests.campaign.small import write_small

HEAVY = ("jax", "jaxlib", "scipy", "pandas", "xarray", "matplotlib", "arviz_stats", "blackjax", "pint")
DRIVER = """
import io, json, sys
from contextlib import redirect_stdout
from seatrial import __main__ as command_line
from seatrial.cli import running
def said(*arguments):
    sys.argv, out = ["seatrial", *arguments], io.StringIO()
    with redirect_stdout(out):
        try:
            command_line.main()
        except SystemExit as end:
            return [end.code, out.getvalue(), [name for name in HEAVY if name in sys.modules]]
"""
ASKED = sorted(name for name, one in COMMANDS.items() if one.makes and name not in ("export", "import"))
"""Commands about a simulated campaign, `report` before `run`, whose answer it would repeat."""


def fresh(lines, *arguments):
    """What lines say as JSON, after `said` is defined, in a process of their own."""
    script = f"HEAVY = {HEAVY}\n{DRIVER}\n{lines}"
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """A campaign of which every command has said the arguments that it was given."""
    folder = write_small(tmp_path_factory.mktemp("told") / "small")
    work = "running._worked = lambda home, reporter, work, answer: answer.say(' '.join(sys.argv)) or running.Exit(3)"
    fresh(f"{work}\nprint(json.dumps([said(name, sys.argv[-1]) for name in {ASKED}]))", str(folder))
    return folder


LIGHT = [["--help"], ["--version"], ["run", "--help"], ["init", "new"]]


def test_help_and_a_new_campaign_load_nothing_heavy(tmp_path):
    new = [[*words[:-1], str(tmp_path / "new")] if words[0] == "init" else words for words in LIGHT]
    for words, (code, out, heavy) in zip(
        new, fresh(f"print(json.dumps([said(*words) for words in {new}]))"), strict=True
    ):
        assert (code, heavy) == (Exit.OK, []), words
        assert out


def test_an_answer_that_is_still_true_loads_nothing_heavy(told):
    found = fresh(f"folder = sys.argv[-1]\nprint(json.dumps([said(name, folder) for name in {ASKED}]))", str(told))
    for name, (code, out, heavy) in zip(ASKED, found, strict=True):
        assert (code, out, heavy) == (Exit.ALARMS, f"seatrial {name} {told}\n", []), name


def test_a_report_says_what_a_run_has_said_but_not_the_other_way_round(told):
    store = Store(told)
    store.answer("report").rename(store.answer("another"))
    assert fresh(f"print(json.dumps(said('report', {str(told)!r})))")[:2] == [Exit.ALARMS, f"seatrial run {told}\n"]
    store.answer("run").unlink()
    store.answer("another").rename(store.answer("report"))
    lines = "running._worked = lambda *_: running.Exit(4)\nprint(json.dumps([said(name, sys.argv[-1]) for name in ('run', 'report')]))"
    assert [code for code, *_ in fresh(lines, str(told))] == [4, Exit.ALARMS]


def test_other_options_are_another_question(told):
    lines = "running._worked = lambda *_: running.Exit(4)\nprint(json.dumps([said(*words) for words in {}]))"
    words = [
        ["design", str(told), "--trials", "2"],
        ["prior", str(told), "-q"],
    ]
    words += [
        ["simulate", str(told), "--design", "next"],
        ["next", str(told), "--run"],
        ["estimate", str(told), "--by", "mode"],
    ]
    assert [code for code, *_ in fresh(lines.format(words))] == [4, Exit.ALARMS, 4, 4, 4]


def test_first_answers_stand_beside_the_whole_one(told):
    lines = "running._worked = lambda home, reporter, work, answer: answer.say('anew') or running.Exit(0)\nfolder = sys.argv[-1]\n"
    asked = [["--by", "equation-error"], [], ["--by", "equation-error"]]
    found = fresh(f"{lines}print(json.dumps([said('estimate', folder, *by) for by in {asked}]))", str(told))
    assert [out for _, out, _ in found] == ["anew\n", f"seatrial estimate {told}\n", "anew\n"]
    assert Store(told).answer("estimate-equation-error").is_file()


def test_an_edited_campaign_is_looked_at_anew(told):
    (told / "campaign.toml").write_text((told / "campaign.toml").read_text() + "\n# a thought\n")
    lines = "running._worked = lambda *_: running.Exit(4)\nprint(json.dumps(said('report', sys.argv[-1])))"
    assert fresh(lines, str(told))[0] == 4


@pytest.mark.parametrize(("asked_for", "device"), [(None, "cpu"), ("cuda,cpu", "cuda,cpu")])
def test_commands_compute_on_the_processor_unless_asked(monkeypatch, asked_for, device):
    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    if asked_for:
        monkeypatch.setenv("JAX_PLATFORMS", asked_for)
    show = "said('--version')\nimport os\nprint(json.dumps(os.environ['JAX_PLATFORMS']))"
    assert fresh(show) == device
