"""`seatrial prior`: a table and plain words on standard output, a picture in the folder, an exit code that tells."""

from xml.etree import ElementTree

from seatrial.cli.running import Exit
from tests.campaign.small import write_small
from tests.cli.test_cli import results, run


def test_the_priors_are_shown_in_metres_per_second(monkeypatch, capsys, tmp_path):
    write_small(tmp_path, ("lower = -3.6\nupper = 1.2", "lower = -3.6\nupper = 1.2\ndissipative = true"))
    code, out, err = run(monkeypatch, capsys, "prior", tmp_path, "--quiet")
    assert code == Exit.OK
    assert err.startswith("caution: the prior is wide")
    for word in ("X_uabsu", "kg/m", "steady speed at n = 1194 rpm", "time constant", "diverge: 0%", "prior.svg"):
        assert word in out
    assert results(tmp_path) == ["campaign.toml", "prior.svg", "results/answers/prior.json"]
    picture = (tmp_path / "prior.svg").read_text()
    ElementTree.fromstring(picture)
    assert "90 % of draws" in picture
    run(monkeypatch, capsys, "prior", tmp_path, "--quiet")
    assert (tmp_path / "prior.svg").read_text() == picture
