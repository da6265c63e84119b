"""Folders of strangers: a link never leads a command to write outside, and a pipe never makes it wait."""

import os
import shutil
import signal
from contextlib import contextmanager

import pytest
from typer.testing import CliRunner

from seatrial.campaign.live.session_files import LAST_LOOK, LOOK, Kept, last_look
from seatrial.campaign.store.stored_result import Store, load_checkpoint, save_checkpoint, write_stamped_json
from seatrial.cli.campaign_lock import FILE_NAME, LOCK_NAME, occupant_of, occupying
from seatrial.cli.main import app
from seatrial.core.errors import InputError, file_error
from seatrial.core.files import begin_file, open_regular, write_json, write_text
from seatrial.dashboard.jobs import Jobs, log_of
from seatrial.dashboard.session_worker import _printing_to
from tests.campaign.small import NO_X_U, write_small

OUTSIDE = b"of somebody else"


def link(path, outside):
    """Put a link to a file outside in the place of a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    outside.write_bytes(OUTSIDE)
    path.symlink_to(outside)


def pipe(path, outside):
    """Put a pipe in the place of a file."""
    link(path, outside)
    path.unlink()
    os.mkfifo(path)


@contextmanager
def within(seconds):
    """Fail where the block waits for ever, as an opened pipe does."""

    def fail(*_):
        raise AssertionError(f"it still waits after {seconds} s")

    before = signal.signal(signal.SIGALRM, fail)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


class Silent:
    """A process that never starts the command."""

    is_busy, is_usable = False, True

    def start(self, words, log):
        with _printing_to(str(log)):
            os.write(1, b"printed\n")


def hold(folder):
    with occupying(folder) as held:
        assert held is not None
        held.progress("x")(2, 2)
        there = occupant_of(folder)
        assert there is not None
        assert there.work


def start(word):
    def work(folder):
        jobs = Jobs()
        jobs.sessions[folder] = Silent()
        jobs.start(folder, word)
        assert log_of(folder).read_text().endswith("printed\n")

    return work


def show(folder):
    kept = Kept(type("Any", (), {"folder": folder}), ".received.csv", ["u"])
    kept.show(dict.fromkeys(LOOK), force=True)
    kept.close()
    assert last_look(folder) is not None


WRITES = {
    FILE_NAME: hold,
    "results/last_command.txt": start("design"),
    str(LAST_LOOK): show,
    "report.html": lambda folder: write_text(folder / "report.html", "page"),
    "results/design_schedule.json": lambda folder: write_json(folder / "results/design_schedule.json", {}),
    "results/summary.json": lambda folder: write_stamped_json(Store(folder).summary, {}, "k"),
    "results/checkpoints/a.npz": lambda folder: save_checkpoint(Store(folder).checkpoint("a"), "k", {}),
}


@pytest.mark.parametrize("put", [link, pipe])
@pytest.mark.parametrize("name", WRITES)
def test_what_is_written_takes_the_place_of_a_link_or_a_pipe(tmp_path, name, put):
    folder, outside = tmp_path / "boat", tmp_path / "outside"
    put(folder / name, outside)
    with within(20):
        WRITES[name](folder)
    assert outside.read_bytes() == OUTSIDE
    assert not (folder / name).is_symlink()
    assert not (folder / name).is_fifo()


READS = {
    FILE_NAME: lambda folder: occupant_of(folder),
    "results/last_command.txt": lambda folder: Jobs().look(folder).command or None,
    str(LAST_LOOK): last_look,
    "results/summary.json": lambda folder: None if Store(folder).summary.is_file() else refused(folder),
    "results/checkpoints/a.npz": lambda folder: load_checkpoint(Store(folder).checkpoint("a"), "k"),
}


def refused(folder):
    with pytest.raises(InputError, match="a pipe, a socket or a device"):
        open_regular(Store(folder).summary, links=True)


@pytest.mark.parametrize("put", [link, pipe])
@pytest.mark.parametrize("name", READS)
def test_what_is_read_is_not_waited_for_nor_shown_from_outside(tmp_path, name, put):
    put(tmp_path / "boat" / name, tmp_path / "outside")
    with within(20):
        assert READS[name](tmp_path / "boat") is None


@pytest.mark.parametrize("put", [link, pipe])
def test_output_is_added_to_no_link_and_no_pipe(tmp_path, put):
    put(tmp_path / "log", tmp_path / "outside")
    with within(20), pytest.raises(InputError, match=r"found: +a (link|pipe)"), _printing_to(str(tmp_path / "log")):
        os.write(1, b"printed\n")
    assert (tmp_path / "outside").read_bytes() == OUTSIDE


@pytest.mark.parametrize("put", [link, lambda path, _: path.mkdir()])
@pytest.mark.parametrize("name", [LOCK_NAME, FILE_NAME])
def test_neither_a_link_nor_a_folder_turns_the_lock_off(tmp_path, name, put):
    folder = tmp_path / "boat"
    folder.mkdir()
    put(folder / name, tmp_path / "outside")
    if put is link and name == FILE_NAME:
        hold(folder)
        return
    with pytest.raises(OSError, match=name) as error, occupying(folder):
        pass
    assert "has the name of a needed file" in file_error(error.value).remedy


def test_a_pipe_for_a_lock_still_locks(tmp_path):
    os.mkfifo(tmp_path / LOCK_NAME)
    with within(20), occupying(tmp_path), pytest.raises(InputError, match="one at a time"), occupying(tmp_path):
        pass


def test_a_file_that_is_begun_is_new(tmp_path):
    (tmp_path / "a").write_bytes(OUTSIDE)
    os.link(tmp_path / "a", tmp_path / "b")
    with begin_file(tmp_path / "b") as stream:
        stream.write(b"1")
    assert (tmp_path / "a").read_bytes() == OUTSIDE


COMMANDS = (["run"], ["prior"], ["check"], ["criteria"], ["export", "--to", "json"], ["export", "--trial"])


@pytest.mark.proof
@pytest.mark.parametrize("put", [link, pipe])
def test_no_command_writes_through_a_link_or_waits_for_a_pipe(tmp_path, finished, put):
    """Every file that these commands make is a link to a file outside, or a pipe, when they run again."""
    folder, made = tmp_path / "boat", finished
    write_small(folder, *SHORT)
    outside = {}
    for number, name in enumerate([*made, FILE_NAME]):
        outside[name] = tmp_path / str(number)
        put(folder / name, outside[name])
    for words in COMMANDS:
        with within(120):
            CliRunner().invoke(app, [words[0], str(folder), *words[1:]])
    assert {name: path.read_bytes() for name, path in outside.items()} == dict.fromkeys(outside, OUTSIDE)
    assert not [name for name in made if not (folder / name).is_file() or (folder / name).is_symlink()]


SHORT = (
    *NO_X_U,
    ("chains = 16\nwarmup = 500\ndraws = 1000", "chains = 4\nwarmup = 100\ndraws = 100"),
    ("particles = 256", "particles = 64"),
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Files that the commands make."""
    folder = write_small(tmp_path_factory.mktemp("made") / "boat", *SHORT)
    for words in COMMANDS:
        CliRunner().invoke(app, [words[0], str(folder), *words[1:]])
    made = [str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()]
    shutil.rmtree(folder)
    assert len(made) > 20
    return sorted({*made} - {"campaign.toml"})
