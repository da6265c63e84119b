"""Nothing outside the folder that is served can be named: traversal, links, odd names."""

import asyncio
import os
import sys

import pytest

from seatrial.core.errors import InputError, SeatrialError
from seatrial.dashboard.campaign_paths import DOWNLOADS, CampaignPaths, logs_of, upload_name
from seatrial.dashboard.logs import receive

SUFFIXES = (".csv", ".csv.gz", ".mat")


@pytest.fixture
def context(tmp_path):
    for name in ("served/one", "served/deep/two", "served/.hidden", "outside"):
        folder = tmp_path / name
        folder.mkdir(parents=True)
        (folder / "campaign.toml").write_text("")
    (tmp_path / "outside" / "report.html").write_text("secret")
    (tmp_path / "served" / "link").symlink_to(tmp_path / "outside")
    return CampaignPaths.of(tmp_path / "served")


def test_campaigns_are_found_and_links_are_not_followed(context):
    assert context.campaigns() == ["deep/two", "one"]
    assert CampaignPaths.of(context.root / "one").campaigns() == ["."]
    assert CampaignPaths.of(context.root / "one" / "campaign.toml").folder(".") == context.root / "one"


@pytest.mark.parametrize(
    "name",
    ["../outside", "one/../../outside", "link", "/etc", "", "one\0", "..", "~", "deep", "x" * 500, "one/../link"],
)
def test_a_campaign_outside_is_none(context, name):
    with pytest.raises(InputError, match="no such campaign"):
        context.folder(name)


@pytest.mark.parametrize(
    "file",
    [
        "../../outside/report.html",
        "/etc/passwd",
        "results/posterior/M-0.nc",
        "",
        "report.html\0",
        "REPORT.HTML",
        "../a.svg",
        "results/a/b_schedule.csv",
    ],
)
def test_only_results_meant_for_it_are_served(context, file):
    with pytest.raises(InputError):
        context.download("one", file)


def test_a_report_that_is_a_link_outside_is_not_served(context):
    os.symlink(context.root.parent / "outside" / "report.html", context.root / "one" / "report.html")
    with pytest.raises(InputError, match="no such file"):
        context.download("one", "report.html")


def test_what_is_there_is_served(context):
    (context.root / "one" / "report.html").write_text("mine")
    path, kind = context.download("one", "report.html")
    assert path.read_text() == "mine"
    assert kind == DOWNLOADS["report.html"]
    (context.root / "one" / "results").mkdir()
    for name in ("prior.svg", "results/free_form_schedule.csv", "results/x.nc"):
        (context.root / "one" / name).write_text("mine")
    made = ["campaign.toml", "prior.svg", "report.html", "results/free_form_schedule.csv"]
    exported = ["export/gz/model.sdf", "export/trial/trial_ros2/metadata.yaml"]
    for name in (*exported, "export/odd name/x.json", "export/a/b/c/d.json"):
        (context.root / "one" / name).parent.mkdir(parents=True)
        (context.root / "one" / name).write_text("mine")
    assert context.files("one") == sorted(made + exported)
    assert context.download("one", exported[1])[1] == "application/octet-stream"
    assert context.download("one", "prior.svg")[1] == "image/svg+xml"


def test_a_folder_that_is_none():
    with pytest.raises(InputError, match="no such folder"):
        CampaignPaths.of(CampaignPaths.__module__ and __import__("pathlib").Path("/nowhere/at/all"))


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="every path there is text")
def test_what_has_a_name_that_is_no_utf_8_has_no_address(context):
    before, name = context.campaigns(), os.fsdecode(b"bo\xffat")
    (context.root / name).mkdir()
    (context.root / name / "campaign.toml").write_text("")
    (context.root / "one" / f"{name}.csv").write_text("x")
    assert context.campaigns() == before
    assert logs_of(context.root / "one", SUFFIXES) == []


def test_logs_are_listed_without_results_and_links(context):
    folder = context.root / "one"
    for name in ("a.csv", "logs/b.mat", "results/c.csv", ".git/d.csv", "notes.txt"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("x")
    os.symlink(context.root.parent / "outside" / "report.html", folder / "e.csv")
    assert logs_of(folder, SUFFIXES) == ["a.csv", "logs/b.mat"]


@pytest.mark.parametrize(
    "name",
    [
        "../a.csv",
        "a/b.csv",
        "..\\a.csv",
        ".hidden.csv",
        "a\0.csv",
        "",
        "a.csv\n",
        "CON\x07.csv",
        "x" * 200 + ".csv",
        "a.exe",
        "bomb.zip",
        "page.html",
        "-rf.csv",
        "å" * 110 + ".csv",
        "a\u202egnp.csv",
        "a\u2215b.csv",
    ],
)
def test_names_of_uploads_are_plain_and_logs_names(name):
    with pytest.raises(InputError):
        upload_name(name, SUFFIXES)


def test_accents_are_letters():
    assert upload_name("Va\u030ager 3.csv", SUFFIXES) == "V\u00e5ger 3.csv"


def send(folder, name, *chunks, most=100):
    async def body():
        for chunk in chunks:
            yield chunk

    return asyncio.run(receive(body(), folder, name, SUFFIXES, most))


def test_an_upload_is_whole_or_not_there(context):
    folder = context.root / "one"
    assert send(folder, "run 1.csv", b"a,b\n", b"1,2\n") == ("logs/run 1.csv", False)
    assert (folder / "logs" / "run 1.csv").read_bytes() == b"a,b\n1,2\n"
    for name, chunks in (("big.csv", [b"x" * 60] * 2), ("none.csv", []), ("run 1.csv", [b"again"])):
        with pytest.raises(SeatrialError):
            send(folder, name, *chunks)
    assert sorted(path.name for path in (folder / "logs").iterdir()) == ["run 1.csv"]
    assert (folder / "logs" / "run 1.csv").read_bytes() == b"a,b\n1,2\n"


def test_an_upload_that_breaks_off_leaves_nothing(context):
    async def body():
        yield b"half"
        raise ConnectionError("gone")

    with pytest.raises(ConnectionError):
        asyncio.run(receive(body(), context.root / "one", "half.csv", SUFFIXES, 100))
    assert list((context.root / "one" / "logs").iterdir()) == []


def test_an_upload_through_a_link_is_refused(context):
    folder = context.root / "one"
    (folder / "logs").symlink_to(context.root.parent / "outside")
    with pytest.raises(InputError, match="link"):
        send(folder, "a.csv", b"x")
    assert not (context.root.parent / "outside" / "a.csv").exists()


@pytest.mark.parametrize(
    "name",
    [
        "",
        " ",
        "../evil",
        "a/b",
        "/etc/evil",
        ".hidden",
        "..",
        "~",
        "a\0b",
        "x" * 121,
        "é" * 110,
        "a.",
        "a\nb",
        "link\\x",
    ],
)
def test_a_new_campaign_has_a_plain_name(context, name):
    before = sorted(context.root.rglob("*"))
    with pytest.raises(InputError, match=r"letters, digits, spaces and \. _ - \+ \( \), 120"):
        context.new_folder(name)
    assert sorted(context.root.rglob("*")) == before


def test_a_name_that_is_too_long_is_told_so_and_an_underscore_is_allowed(context):
    with pytest.raises(InputError, match="300 characters, 300 bytes"):
        context.new_folder("x" * 300)
    with pytest.raises(InputError, match="110 characters, 220 bytes"):
        context.new_folder("é" * 110)
    with pytest.raises(InputError, match="304 characters, 304 bytes"):
        upload_name("x" * 300 + ".csv", (".csv",))
    with pytest.raises(InputError, match="a path, or characters"):
        context.new_folder("a/b")
    assert context.new_folder("my_boat (2)").name == "my_boat (2)"


@pytest.mark.parametrize("name", ["one", "deep", "link", "dangling"])
def test_a_new_campaign_overwrites_nothing(context, name):
    os.symlink(context.root.parent / "nowhere", context.root / "dangling")
    with pytest.raises(InputError, match="a file or folder of that name"):
        context.new_folder(name)


def test_a_campaign_is_begun_once(context):
    folder = context.new_folder(" re\u0301cif 1 ")
    assert folder == context.root / "r\u00e9cif 1"
    context.begin(folder, "text")
    assert (folder / "campaign.toml").read_text() == "text"
    assert folder.name in context.campaigns()
    with pytest.raises(InputError, match="nothing was changed"):
        context.begin(folder, "another")
    assert (folder / "campaign.toml").read_text() == "text"


def test_no_campaign_is_begun_inside_another(context):
    with pytest.raises(InputError, match="serve the folder above it"):
        CampaignPaths.of(context.root / "one").new_folder("two")
