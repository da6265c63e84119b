"""Options of `seatrial design`: what they need is looked for before any work, and one that fails does not drop the others."""

import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.cli.commands.plan import _each
from seatrial.cli.running import Answer, Exit
from seatrial.core.errors import InputError, NumericalError
from tests.campaign.small import write_small
from tests.cli.test_cli import results, run

UNBOUNDED = ('[limits.n]\nlower = "0 rpm"\nupper = "1500 rpm"\n', "")
ONE_PERIOD = ('{ from = "2 s", to = "20 s", points = 4 }', '{ from = "5 s", to = "5 s", points = 1 }')


@pytest.mark.parametrize(
    ("option", "changes", "place"),
    [
        (("--free-form", "6"), (UNBOUNDED,), "limits.n"),
        (("--self-oscillation",), (), "design.relay"),
        (("--search", "100"), (ONE_PERIOD,), "design.period"),
        (("--search", "10"), (), "populations of 16"),
    ],
)
def test_what_an_option_needs_is_looked_for_before_any_work(monkeypatch, capsys, tmp_path, option, changes, place):
    write_small(tmp_path, *changes)
    code, out, err = run(monkeypatch, capsys, "design", tmp_path, *option, "--quiet")
    assert code == Exit.BAD_INPUT
    assert place in err
    assert not out
    assert results(tmp_path) == ["campaign.toml"]


def test_an_option_that_fails_does_not_drop_the_others(capsys):
    def fails(error):
        raise error

    first, last = InputError("here", found="a", expected="b", remedy="c"), NumericalError("it diverges")
    with pytest.raises(NumericalError, match="it diverges"):
        _each(Answer(), [lambda: fails(first), lambda: ["one", "two"], lambda: fails(last), lambda: ["three"]])
    said = capsys.readouterr()
    assert said.out == "one\ntwo\nthree\n"
    assert said.err.startswith("error: here\n  found:    a")


def test_the_self_oscillation_that_is_proposed_is_accepted_as_it_stands(monkeypatch, capsys, tmp_path):
    write_small(tmp_path)
    _, _, err = run(monkeypatch, capsys, "design", tmp_path, "--self-oscillation", "--quiet")
    keys = err.partition("add [design.relay] with ")[2].strip().replace(" and threshold", "\nthreshold")
    path = tmp_path / "campaign.toml"
    path.write_text(path.read_text() + f"\n[design.relay]\n{keys}\n")
    relay = load_campaign(tmp_path).design.relay
    assert relay.output == "u"
    assert len(relay.threshold.values()) == 8
