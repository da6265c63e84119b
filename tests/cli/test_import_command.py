"""`seatrial import` with other ends: written to the campaign file where they leave a record, and not where they do not."""

import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import import_trials
from seatrial.cli.main import app
from seatrial.core.errors import InputError
from tests.campaign.small import write_small

IMPORT = """
[import]
fit = ["1", "2"]
end = "18 s"  # for all

[[import.files]]
path = "log_{run}.csv"
time = { column = "t", unit = "s" }
channels.n = { column = "rpm", unit = "rpm", offset = 10.0 }
channels.u = { column = "north", unit = "m/s" }
"""


@pytest.fixture
def folder(tmp_path):
    place = write_small(tmp_path / "small")
    path = place / "campaign.toml"
    text = path.read_text()
    before, after = text.index("[truth]"), text.find("\n[", text.index("[truth]") + 1)
    path.write_text(text[:before] + (text[after + 1 :] if after > 0 else "") + IMPORT)
    for run in (1, 2):
        rows = [f"{0.1 * i:.1f},{1200 + 200 * (i // 50 % 2)},{1.5 + 0.001 * i * run}" for i in range(200)]
        (place / f"log_{run}.csv").write_text("t,rpm,north\n" + "\n".join(rows) + "\n")
    return place


def run(folder, *words):
    return CliRunner().invoke(app, ["import", str(folder), "--quiet", *words])


def test_ends_are_written_for_one_run_or_all(folder):
    assert run(folder, "--run", "2", "--start", "2 s", "--end", "5000 ms").exit_code == 0
    for_all = run(folder, "--start", "1 s")
    assert for_all.exit_code == 0
    assert "run 2 has a separate start and end" in for_all.output
    content = tomllib.loads((folder / "campaign.toml").read_text())["import"]
    assert content["trim"] == {"2": {"start": "2 s", "end": "5000 ms"}}
    assert (content["start"], content["end"]) == ("1 s", "18 s")
    assert "# for all" in (folder / "campaign.toml").read_text()
    first, second = import_trials(load_campaign(folder)).fit
    assert [round(record.time[-1], 9) for record in (first, second)] == [17.0, 3.0]
    assert first.channel("u")[0] == pytest.approx(1.51)
    assert second.channel("u")[0] == pytest.approx(1.54)
    assert first.channel("n")[0] * 60 / 6.283185307179586 == pytest.approx(1210.0)


def test_a_map_of_two_runs_is_not_corrected_for_one(folder):
    log = folder / "log_2.csv"
    log.write_text(log.read_text().replace("north", "north_ms"))
    said = run(folder)
    assert 'did you mean "north_ms"? Run 1 has this map too: if only run 2 has other columns, write' in str(
        said.exception
    )


def test_a_run_with_other_columns_has_a_map_of_its_own(folder):
    """What `runs` says is followed by the import, by what is missing, and by what a name that is none is told."""
    log, path = folder / "log_2.csv", folder / "campaign.toml"
    whole = import_trials(load_campaign(folder)).fit
    log.write_text(log.read_text().replace("t,rpm,north", "stamp,shaft,dvl_x"))
    text, files = path.read_text(), IMPORT[IMPORT.index("[[import.files]]") :]
    own = files.replace('"t"', '"stamp"').replace('"rpm", unit', '"shaft", unit').replace('"north"', '"dvl_x"')
    both = text.replace(files, files + 'runs = ["1"]\n' + own + 'runs = ["2"]\n')
    path.write_text(both)
    again = import_trials(load_campaign(folder)).fit
    for one, other in zip(whole, again, strict=True):
        np.testing.assert_array_equal(one.channel("u"), other.channel("u"))
        np.testing.assert_array_equal(one.channel("n"), other.channel("n"))
    for change, told in (
        (('runs = ["2"]', 'runs = ["3"]'), r'files\[1\]\.runs[^$]*run "3"[^$]*one of 1, 2'),
        (('runs = ["2"]', 'runs = ["1"]'), 'no log of run "2"'),
        (('channels.n = { column = "shaft"', '# { column = "shaft"'), "no column for n[^$]*for run 2"),
    ):
        assert change[0] in both
        path.write_text(both.replace(*change))
        with pytest.raises(InputError, match=told):
            import_trials(load_campaign(folder))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--run", "3", "--start", "1 s"], ("import.trim.3", 'run "3"', "one of 1, 2")),
        (["--run", "2", "--start", "30 s"], ("key import.end", "18 s, with a start at 30 s")),
        (["--start", "5 s", "--end", "4 s"], ("5 s to 4 s", "a start before the end")),
        (["--start", "5 m"], ("--start", 'a unit like "s"')),
        (["--run", "2", "--end", "900 s"], ("--end", "run 2 at 19.9 s", "an end inside the run")),
        (["--end", "900 s"], ("--end", "run 1 at 19.9 s, run 2 at 19.9 s")),
        (["--run", "2"], ("--run", "--start or --end with it")),
    ],
)
def test_what_leaves_no_record_changes_nothing(folder, words, told):
    before = (folder / "campaign.toml").read_text()
    result = run(folder, *words)
    assert result.exception is not None
    for part in told:
        assert part in str(result.exception)
    assert (folder / "campaign.toml").read_text() == before


def test_a_run_that_is_shorter_than_the_others_is_told(folder):
    log = folder / "log_2.csv"
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:101]))
    told = run(folder, "--end", "15 s")
    assert told.exit_code == 0
    assert "the files of some runs end before --end, so these runs end there: run 2 at 9.9 s" in told.output
    path = folder / "campaign.toml"
    path.write_text(path.read_text() + '\n[import.trim.2]\nend = "900 s"\n')
    assert 'run 2, its files end at 9.9 s, before its end = "900 s", so it ends there' in run(folder).output


def test_a_control_without_a_column_is_named_before_a_log_is_opened(folder):
    path = folder / "campaign.toml"
    path.write_text(path.read_text().replace("channels.n =", "# channels.n ="))
    (folder / "log_1.csv").unlink()
    result = run(folder)
    assert "import.files" in str(result.exception)
    assert "no column for n\n  expected: a column for n, which is an input of the model" in str(result.exception)


def test_a_simulated_campaign_has_no_ends(tmp_path):
    result = run(write_small(tmp_path / "small"), "--start", "1 s")
    assert "a simulated vehicle" in str(result.exception)
