"""Nothing outside the folder that is served can be named: traversal, links, odd names."""

import asyncio
import os

import pytest

from seatrial.apps.dashboard.places import DOWNLOADS, Places, logs_of, upload_name
from seatrial.apps.dashboard.uploads import receive
from seatrial.core.errors import InputError

SUFFIXES = (".csv", ".csv.gz", ".mat")


@pytest.fixture
def house(tmp_path):
    for name in ("served/one", "served/deep/two", "served/.hidden", "outside"):
        folder = tmp_path / name
        folder.mkdir(parents=True)
        (folder / "campaign.toml").write_text("")
    (tmp_path / "outside" / "report.html").write_text("secret")
    (tmp_path / "served" / "link").symlink_to(tmp_path / "outside")
    return Places.of(tmp_path / "served")


def test_campaigns_are_found_and_links_are_not_followed(house):
    assert house.campaigns() == ["deep/two", "one"]
    assert Places.of(house.root / "one").campaigns() == ["."]
    assert Places.of(house.root / "one" / "campaign.toml").folder(".") == house.root / "one"


@pytest.mark.parametrize(
    "name",
    ["../outside", "one/../../outside", "link", "/etc", "", "one\0", "..", "~", "deep", "x" * 500, "one/../link"],
)
def test_a_campaign_outside_is_none(house, name):
    with pytest.raises(InputError, match="no such campaign"):
        house.folder(name)


@pytest.mark.parametrize(
    "file", ["../../outside/report.html", "/etc/passwd", "results/posterior/M-0.nc", "", "report.html\0", "REPORT.HTML"]
)
def test_only_results_meant_for_it_are_served(house, file):
    with pytest.raises(InputError):
        house.download("one", file)


def test_a_report_that_is_a_link_outside_is_not_served(house):
    os.symlink(house.root.parent / "outside" / "report.html", house.root / "one" / "report.html")
    with pytest.raises(InputError, match="no such file"):
        house.download("one", "report.html")


def test_what_is_there_is_served(house):
    (house.root / "one" / "report.html").write_text("mine")
    path, kind = house.download("one", "report.html")
    assert path.read_text() == "mine"
    assert kind == DOWNLOADS["report.html"]


def test_a_folder_that_is_none():
    with pytest.raises(InputError, match="no such folder"):
        Places.of(Places.__module__ and __import__("pathlib").Path("/nowhere/at/all"))


def test_logs_are_listed_without_results_and_links(house):
    folder = house.root / "one"
    for name in ("a.csv", "logs/b.mat", "results/c.csv", ".git/d.csv", "notes.txt"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("x")
    os.symlink(house.root.parent / "outside" / "report.html", folder / "e.csv")
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


def test_an_upload_is_whole_or_not_there(house):
    folder = house.root / "one"
    assert send(folder, "run 1.csv", b"a,b\n", b"1,2\n") == "logs/run 1.csv"
    assert (folder / "logs" / "run 1.csv").read_bytes() == b"a,b\n1,2\n"
    for name, chunks in (("big.csv", [b"x" * 60] * 2), ("none.csv", []), ("run 1.csv", [b"again"])):
        with pytest.raises(InputError):
            send(folder, name, *chunks)
    assert sorted(path.name for path in (folder / "logs").iterdir()) == ["run 1.csv"]
    assert (folder / "logs" / "run 1.csv").read_bytes() == b"a,b\n1,2\n"


def test_an_upload_that_breaks_off_leaves_nothing(house):
    async def body():
        yield b"half"
        raise ConnectionError("gone")

    with pytest.raises(ConnectionError):
        asyncio.run(receive(body(), house.root / "one", "half.csv", SUFFIXES, 100))
    assert list((house.root / "one" / "logs").iterdir()) == []


def test_an_upload_through_a_link_is_refused(house):
    folder = house.root / "one"
    (folder / "logs").symlink_to(house.root.parent / "outside")
    with pytest.raises(InputError, match="link"):
        send(folder, "a.csv", b"x")
    assert not (house.root.parent / "outside" / "a.csv").exists()


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
def test_a_new_campaign_has_a_plain_name(house, name):
    before = sorted(house.root.rglob("*"))
    with pytest.raises(InputError, match=r"letters, digits, dots"):
        house.new_folder(name)
    assert sorted(house.root.rglob("*")) == before


@pytest.mark.parametrize("name", ["one", "deep", "link", "dangling"])
def test_a_new_campaign_overwrites_nothing(house, name):
    os.symlink(house.root.parent / "nowhere", house.root / "dangling")
    with pytest.raises(InputError, match="a file or folder of that name"):
        house.new_folder(name)


def test_a_campaign_is_begun_once(house):
    folder = house.new_folder(" re\u0301cif 1 ")
    assert folder == house.root / "r\u00e9cif 1"
    house.begin(folder, "text")
    assert (folder / "campaign.toml").read_text() == "text"
    assert folder.name in house.campaigns()
    with pytest.raises(InputError, match="nothing was changed"):
        house.begin(folder, "another")
    assert (folder / "campaign.toml").read_text() == "text"


def test_no_campaign_is_begun_inside_another(house):
    with pytest.raises(InputError, match="serve the folder above it"):
        Places.of(house.root / "one").new_folder("two")
