"""The study from items to `paper.json`."""

import json

import pytest

from seatrial import __version__
from seatrial.core.errors import InputError
from studies.remus100.run import check_folder, choose_reading, run_paper
from studies.remus100.tests.studies import TINY, A, B

ITEMS = ("equations-3", "figure-4")
PARTS = ["chosen-doublet.nc", "equations.nc"]
VERDICTS = {"reproduced", "not comparable", "contradicted"}


class Heard:
    """A reporter that remembers."""

    def __init__(self):
        self.said, self.titles = [], []

    def say(self, text):
        self.said.append(text)

    def progress(self, title):
        self.titles.append(title)
        return lambda done, total: None


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    return folder, run_paper(folder, A, TINY, ITEMS)[1]


def refuse(constant):
    raise AssertionError(f"{constant} is no JSON")


def test_everything_is_in_paper_json(finished):
    folder, judged = finished
    content = json.loads((folder / "paper.json").read_text(), parse_constant=refuse)
    assert (content["seatrial_version"], content["reading"], content["seed"]) == (__version__, "A", 0)
    assert content["sizes"]["draws"] == TINY.draws
    assert content["vehicle"]["thrust"] == "6.28e-2 N/(rev/s)^2"
    assert [item["key"] for item in content["items"]] == [item.key for item in judged] == list(ITEMS)
    for written, item in zip(content["items"], judged, strict=True):
        assert written["verdict"] in VERDICTS
        assert written["words"].startswith(written["verdict"])
        assert written["because"] in written["words"]
        assert written["settings"]["reading"] == "A"
        assert len(written["numbers"]) == len(item.numbers) > 0
        for found, number in zip(written["numbers"], item.numbers, strict=True):
            assert found == {
                "name": number.name,
                "printed": number.printed,
                "found": number.found,
                "error": number.error,
            }


def test_only_what_is_needed_is_computed(finished):
    folder, _ = finished
    assert sorted(path.name for path in (folder / "results").iterdir()) == PARTS


def test_a_second_run_computes_nothing(finished):
    folder, judged = finished
    before = {path: path.stat().st_mtime_ns for path in (folder / "results").iterdir()}
    heard = Heard()
    _, again = run_paper(folder, A, TINY, ITEMS, heard)
    assert before == {path: path.stat().st_mtime_ns for path in (folder / "results").iterdir()}
    assert again == judged
    assert heard.titles == []
    assert heard.said[-1].startswith("2 items judged in")


def test_a_folder_of_another_study_is_refused(finished, tmp_path):
    folder, _ = finished
    check_folder(folder, A)
    check_folder(tmp_path / "new", A)
    with pytest.raises(InputError, match="name another folder"):
        check_folder(folder, B)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="a file"):
        check_folder(tmp_path / "file", A)


def test_an_item_without_parts(tmp_path):
    _, judged = run_paper(tmp_path, B, TINY, ["figure-5"])
    assert [item.verdict for item in judged] == ["reproduced"]
    assert [path.name for path in tmp_path.iterdir()] == ["paper.json"]


@pytest.mark.parametrize(("name", "expected"), [("A", A), ("b", B)])
def test_readings_by_name(name, expected):
    assert choose_reading(name) is expected


@pytest.mark.parametrize("name", ["C", ""])
def test_no_such_reading(name):
    with pytest.raises(InputError, match="--reading") as raised:
        choose_reading(name)
    assert raised.value.expected == "A or B"
