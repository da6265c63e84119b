"""What a campaign file names is found in one way, and kept within folders where that is asked for."""

import os
import shutil
from typing import get_args

import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.named_files import VARIABLE, find, folders_outside, keep_within
from seatrial.campaign.config.schema import CampaignFile
from seatrial.campaign.data.import_logs import import_trials, read_untrimmed
from seatrial.cli.running import Exit, with_campaign
from seatrial.core.errors import InputError
from tests.campaign.small import LOGGED, write_small, write_summary

LOG = "".join(f"{0.1 * k:.1f},{1500 + k % 7},{1 + 0.01 * (k % 5)},{1400 + k % 9}\n" for k in range(200))
FILE = """
[import]
fit = ["a"]
[[import.files]]
path = "{path}"
time = {{ column = "t", unit = "s" }}
[import.files.channels]
u = {{ column = "u", unit = "m/s" }}
n = {{ column = "pwm", unit = "rpm", curve = "{curve}" }}
"""
NAMED = {
    "log": ("{there}/log.csv", "curve.csv"),
    "curve": ("log.csv", "{there}/curve.csv"),
    "log by a link": ("linked.csv", "curve.csv"),
    "curve by a link": ("log.csv", "linked.csv"),
    "log by steps up": ("../../elsewhere/log.csv", "curve.csv"),
    "curve by steps up": ("log.csv", "../../elsewhere/curve.csv"),
    "log by a variable": ("${{THERE}}/log.csv", "curve.csv"),
    "curve by a variable": ("log.csv", "$THERE/curve.csv"),
    "log at home": ("~/log.csv", "curve.csv"),
    "curve at home": ("log.csv", "~/curve.csv"),
}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Logs and curves in a campaign's folder and elsewhere; no limit on where they lie."""
    there = tmp_path / "elsewhere"
    for folder in (tmp_path / "served" / "boat", there):
        folder.mkdir(parents=True)
        (folder / "log.csv").write_text("t,pwm,u,x\n" + LOG)
        (folder / "curve.csv").write_text("pwm,rpm\n1000,-1000\n2000,1000\n")
    monkeypatch.setenv("THERE", str(there))
    monkeypatch.setenv("HOME", str(there))
    monkeypatch.delenv(VARIABLE, raising=False)
    return tmp_path


def boat(place, path="log.csv", curve="curve.csv"):
    folder = place / "served" / "boat"
    named = FILE.format(path=path, curve=curve)
    return write_small(folder, (LOGGED[0], named))


@pytest.mark.parametrize("name", NAMED)
def test_a_file_outside_is_read_in_a_shell_and_refused_where_files_are_kept_within(here, name):
    there = here / "elsewhere"
    path, curve = (text.format(there=there) for text in NAMED[name])
    (here / "served" / "boat" / "linked.csv").symlink_to(there / ("log.csv" if "log" in name else "curve.csv"))
    campaign = load_campaign(boat(here, path, curve))
    assert read_untrimmed(campaign, "a").time.size == 200
    assert folders_outside(campaign.folder, campaign.priors_from, campaign.imports) == [str(there)]
    keep_within([here / "served"])
    for use in (import_trials, lambda one: read_untrimmed(one, "a")):
        with pytest.raises(InputError, match="which lies outside") as refused:
            use(campaign)
        assert ("curve" in refused.value.where) == ("curve" in name)
        assert "--allow-read" in refused.value.remedy
    keep_within([here / "served", there])
    assert read_untrimmed(campaign, "a").time.size == 200


@pytest.mark.parametrize(
    "written", ["/dev/zero", "../../../../../../dev/zero", "pipe", "nothing.csv", "a\0b", "a" * 5000, ""]
)
def test_what_is_no_file_is_never_opened(here, written):
    os.mkfifo(here / "served" / "boat" / "pipe")
    folder = here / "served" / "boat"
    for limits in ([], [here / "served"]):
        if limits:
            keep_within(limits)
        if written == "":
            assert find(folder, written, "here") == folder
            continue
        with pytest.raises(InputError, match="here"):
            find(folder, written, "here")


def test_who_is_kept_within_folders_is_not_told_what_variables_hold(here, monkeypatch):
    monkeypatch.setenv("SECRET", "hunter2")
    folder = here / "served" / "boat"
    keep_within([folder])
    for written in ("$SECRET", "logs/${SECRET}.csv", "/$SECRET", "../$SECRET"):
        with pytest.raises(InputError) as refused:
            find(folder, written, "here")
        assert "hunter2" not in str(refused.value)


def test_a_label_is_no_place_for_variables_and_homes(here):
    folder = here / "served" / "boat"
    (folder / "$THERE").mkdir()
    (folder / "$THERE" / "~.csv").write_text("")
    assert find(folder, "{run}/~.csv", "here", "$THERE") == folder / "$THERE" / "~.csv"


def test_an_earlier_campaign_outside_is_refused_and_so_is_one_by_a_link(here):
    boat_folder = write_small(here / "served" / "boat")
    earlier = here / "elsewhere" / "results"
    earlier.mkdir()
    write_summary(earlier.parent, ("X_u",), X_u=(-1.0, 0.1))
    shutil.copytree(earlier.parent, here / "served" / "surge")
    write_small(boat_folder, ("[vehicle]\n", '[vehicle]\npriors_from = ["../../elsewhere"]\n'))
    assert load_campaign(boat_folder).priors_from == ("../../elsewhere",)
    keep_within([here / "served"])
    with pytest.raises(InputError, match=r"vehicle\.priors_from"):
        load_campaign(boat_folder)
    write_small(boat_folder, ("[vehicle]\n", '[vehicle]\npriors_from = ["../surge"]\n'))
    load_campaign(boat_folder)
    summary = here / "served" / "surge" / "results" / "summary.json"
    summary.unlink()
    summary.symlink_to(earlier / "summary.json")
    with pytest.raises(InputError, match=r"vehicle\.priors_from"):
        load_campaign(boat_folder)


def test_a_command_says_where_it_reads_outside(here, capsys):
    folder = boat(here, f"{here}/elsewhere/log.csv")
    with_campaign(folder, False, lambda *_: Exit.OK)
    assert str(here / "elsewhere") in "".join(capsys.readouterr().err.split())
    with_campaign(boat(here), False, lambda *_: Exit.OK)
    assert "outside" not in capsys.readouterr().err


SCHEDULES = ("DesignTable.schedule", "ImportTable.schedule")


def test_every_key_that_names_a_file_is_known():
    """A new key of text whose name says that it names a file has to go through `find`."""
    words = ("path", "file", "folder", "curve", "priors_from", "schedule", "directory")
    found, waiting = set(), [CampaignFile]
    while waiting:
        table = waiting.pop()
        for name, field in table.model_fields.items():
            text = str(field.annotation)
            waiting += _tables(field.annotation)
            if any(word in name for word in words) and "Table" not in text:
                found.add(f"{table.__name__}.{name}")
    assert found == {
        "FileTable.path",
        "KeepTable.path",
        "ColumnTable.curve",
        "ThrustLawTable.curve",
        "VehicleTable.priors_from",
        *SCHEDULES,
    }


def _tables(annotation):
    if hasattr(annotation, "model_fields"):
        return [annotation]
    return [one for part in get_args(annotation) for one in _tables(part)]
