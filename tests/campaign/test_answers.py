"""Answers that are given again: only while every file that they rest on is what it was."""

import os

import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import import_trials
from seatrial.campaign.store.answer_cache import keep, key_of_answer, recall
from seatrial.campaign.store.stored_result import Store, write_stamped_json
from seatrial.core.files import depend_on, is_there, sha256_of, watching_files, write_text
from tests.campaign.small import NO_X_U, hearing_of_files, write_small

ASKED = {"command": "report"}


@pytest.fixture
def told(tmp_path):
    """A folder with an answer that rests on a file that was read, one that was written, and one that was not there."""
    (tmp_path / "results").mkdir()
    (tmp_path / "log.csv").write_text("t,u\n0,1\n")
    with watching_files() as seen:
        sha256_of(tmp_path / "log.csv")
        write_text(tmp_path / "report.html", "page")
        assert not is_there(tmp_path / "results" / "sequence.json")
    keep(Store(tmp_path).answer("report"), key(tmp_path), ["as it was"], seen)
    return tmp_path


def key(folder, text="[campaign]", asked=ASKED):
    return key_of_answer(folder, text, asked)


def said(folder, **other):
    return recall(Store(folder).answer("report"), key(folder, **other))


def test_answer_is_recalled_while_no_file_changes(told):
    assert said(told) == ["as it was"]
    os.utime(told / "log.csv", (1, 1))
    assert said(told) == ["as it was"]


def edited_in_place(folder):
    """Other bytes of the same length at the same time in the same file."""
    before = (folder / "log.csv").stat()
    with (folder / "log.csv").open("r+b") as stream:
        stream.write(b"t,v")
    os.utime(folder / "log.csv", ns=(before.st_atime_ns, before.st_mtime_ns))
    after = (folder / "log.csv").stat()
    assert (after.st_size, after.st_mtime_ns, after.st_ino) == (before.st_size, before.st_mtime_ns, before.st_ino)


CHANGES = {
    "an input is edited": lambda folder: (folder / "log.csv").write_text("t,u\n0,2\n"),
    "an input is edited, which its size and time do not tell": edited_in_place,
    "an input is removed": lambda folder: (folder / "log.csv").unlink(),
    "a folder stands for an input": lambda folder: [(folder / "log.csv").unlink(), (folder / "log.csv").mkdir()],
    "a pipe stands for an input": lambda folder: [(folder / "log.csv").unlink(), os.mkfifo(folder / "log.csv")],
    "what was written is damaged": lambda folder: (folder / "report.html").write_text("pag"),
    "what was written is removed": lambda folder: (folder / "report.html").unlink(),
    "what was not there is": lambda folder: (folder / "results" / "sequence.json").write_text("{}"),
    "the answer is damaged": lambda folder: Store(folder).answer("report").write_bytes(b"{"),
    "the answer is another's": lambda folder: write_stamped_json(Store(folder).answer("report"), {}, key(folder)),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_has_changed_is_noticed(told, name):
    CHANGES[name](told)
    assert said(told) is None


def test_probabilities_that_another_command_adds_to_the_coefficients_leave_an_answer_true(tmp_path):
    def written(*rows):
        return write_text(Store(tmp_path).coefficients, "\n".join(["structure,probability,name,mean", *rows, ""]))

    with watching_files() as seen:
        written("M-0,,X_u,-1.5", "M-1,,X_u,-1.25")
    keep(Store(tmp_path).answer("report"), key(tmp_path), "fitted", seen)
    written("M-0,0.25,X_u,-1.5", "M-1,0.75,X_u,-1.25")
    assert said(tmp_path) == "fitted"
    written("M-0,0.25,X_u,-1.5", "M-1,0.75,X_u,-1.26")
    assert said(tmp_path) is None


def test_another_question_gets_no_answer(told, monkeypatch, tmp_path_factory):
    assert said(told, asked={"command": "report", "block": "2 s"}) is None
    assert said(told, text="[campaign] ") is None
    elsewhere = tmp_path_factory.mktemp("copy") / "campaign"
    os.rename(told, elsewhere)
    assert said(elsewhere) is None


def test_variables_in_the_names_of_files_count(told, monkeypatch):
    monkeypatch.setenv("LOGS", "one")
    first = key(told, text='path = "$LOGS/1.csv"')
    monkeypatch.setenv("LOGS", "two")
    assert key(told, text='path = "$LOGS/1.csv"') != first


def test_another_version_gets_no_answer(told, monkeypatch):
    monkeypatch.setattr("seatrial.campaign.store.stored_result.__version__", "0.0.1")
    assert said(told) is None


def test_what_others_change_meanwhile_is_not_kept(tmp_path):
    (tmp_path / "log.csv").write_text("0")
    with watching_files() as seen:
        sha256_of(tmp_path / "log.csv")
        (tmp_path / "log.csv").write_text("12")
    keep(Store(tmp_path).answer("report"), key(tmp_path), [], seen)
    assert not Store(tmp_path).results.exists()


def test_checkpoints_are_no_part_of_it(tmp_path):
    checkpoint = Store(tmp_path).checkpoint("M-0")
    with watching_files() as seen:
        write_text(checkpoint, "half")
        checkpoint.unlink()
    keep(Store(tmp_path).answer("report"), key(tmp_path), [], seen)
    assert said(tmp_path) == []


def test_a_folder_of_files_is_its_names(tmp_path):
    bag = tmp_path / "bag"
    bag.mkdir()
    with watching_files() as seen:
        depend_on(bag)
    keep(Store(tmp_path).answer("report"), key(tmp_path), [], seen)
    assert said(tmp_path) == []
    (bag / "more.mcap").write_text("")
    assert said(tmp_path) is None


def test_a_folder_that_takes_no_answer_is_no_error(tmp_path):
    Store(tmp_path).results.write_text("a file stands where results would be")
    keep(Store(tmp_path).answer("report"), key(tmp_path), [], {})
    assert said(tmp_path) is None


def test_nobody_watches_after_the_block(tmp_path):
    with watching_files() as outer:
        with watching_files() as inner:
            depend_on(tmp_path / "a")
        depend_on(tmp_path / "b")
    depend_on(tmp_path / "c")
    assert [path.name for path in inner] == ["a"]
    assert [path.name for path in outer] == ["a", "b"]


def test_records_rest_on_logs_and_curves(tmp_path):
    folder = write_small(
        tmp_path / "small",
        *NO_X_U,
        (
            "[truth]\nX_uabsu = -2.93\nT_nabsn = 6.28e-4",
            """[import]
fit = ["1"]
[[import.files]]
path = "log_{run}.csv"
time = { column = "t", unit = "s" }
channels.u = { column = "speed", unit = "m/s" }
channels.n = { column = "rpm", unit = "rpm", curve = "curve.csv" }
""",
        ),
    )
    (folder / "log_1.csv").write_text(
        "t,speed,rpm\n" + "".join(f"{0.1 * i:.1f},{1 + i / 50},{900 + i}\n" for i in range(50))
    )
    (folder / "curve.csv").write_text("read,true\n0,0\n2000,1900\n")
    for _ in range(2):
        with watching_files() as seen, hearing_of_files(folder) as opened:
            import_trials(load_campaign(folder))
        assert {"campaign.toml", "log_1.csv", "curve.csv", "1.nc"} <= {path.name for path in opened}
        assert opened <= set(seen)
