"""`--json`: one document on standard output that keeps to the schema, whatever the command and however it ends."""

import json
import sys
from pathlib import Path

import pytest

from seatrial.__main__ import COMMANDS, main
from seatrial.campaign.store.stored_result import Store
from seatrial.cli.answer import plain
from seatrial.cli.result_schema import RESULTS, schema
from seatrial.cli.running import NO_RESULT, Exit
from tests.campaign.small import NO_X_U, write_small

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))
from generate import result_schema

SCHEMA = schema()
TYPES = {"string": str, "integer": int, "number": (int, float), "boolean": bool, "null": type(None), "object": dict}


def faults(value, schema, place="document"):
    """What of a value a schema forbids: as much of JSON Schema as ours uses, written here a second time."""
    if "$ref" in schema:
        return faults(value, SCHEMA["$defs"][schema["$ref"].rsplit("/", 1)[1]], place)
    found = []
    if "const" in schema and value != schema["const"]:
        found.append(f"{place} is not {schema['const']}")
    if "enum" in schema and value not in schema["enum"]:
        found.append(f"{place} is none of {schema['enum']}")
    if "anyOf" in schema and all(faults(value, one) for one in schema["anyOf"]):
        found += [f"{place}: {one}" for one in faults(value, schema["anyOf"][0], place)]
    for case in schema.get("allOf", ()):
        if not faults(value, case["if"]):
            found += faults(value, case["then"], place)
    kinds = schema.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if kinds and not any(isinstance(value, list if kind == "array" else TYPES[kind]) for kind in kinds):
        return [f"{place} is {value!r}, no {kinds}"]
    if isinstance(value, bool) and kinds and "boolean" not in kinds:
        found.append(f"{place} is {value}")
    if isinstance(value, list):
        found += [text for i, one in enumerate(value) for text in faults(one, schema.get("items", {}), f"{place}[{i}]")]
    if isinstance(value, dict):
        known, rest = schema.get("properties", {}), schema.get("additionalProperties", {})
        found += [f"{place} lacks {key}" for key in schema.get("required", ()) if key not in value]
        for key, one in value.items():
            if key not in known and rest is False:
                found.append(f"{place} has {key}")
            elif key in known or rest is not False:
                found += faults(one, known.get(key, rest if isinstance(rest, dict) else {}), f"{place}.{key}")
    return found


@pytest.fixture
def ask(monkeypatch, capsys):
    """The document of one command, once it has been found to keep to the schema, and what stands on standard error."""

    def asked(*words, code=Exit.OK):
        monkeypatch.setattr(sys, "argv", ["seatrial", *map(str, words), "--json", "--quiet"])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        document = json.loads(out)
        assert faults(document, SCHEMA) == []
        assert (document["command"], document["exit"]) == (words[0], ended.value.code)
        if code is not None:
            assert document["exit"] == code, err
        return document, err

    return asked


def test_every_command_has_its_document_and_a_place_on_the_page():
    assert set(RESULTS) == set(COMMANDS) - set(NO_RESULT)
    page = result_schema.page()
    assert all(f"\n## {name}\n" in page for name in RESULTS)


def test_a_value_against_the_schema_is_found():
    document = {"schema": 2, "seatrial": "0", "command": "init", "exit": 0, "error": None, "result": {"template": 3}}
    document |= {"files": {}, "cautions": [], "alarms": ["a"], "more": 1}
    said = " ".join(faults(document, SCHEMA))
    assert "document has more" in said
    assert "template is 3" in said
    assert any(text.startswith("document.alarms") for text in faults({**document, "alarms": "a"}, SCHEMA))


def test_no_number_is_null():
    import numpy as np

    assert plain({"a": np.array([1.0, np.nan]), "b": (np.inf, np.int64(2)), "c": Path("x")}) == {
        "a": [1.0, None],
        "b": [None, 2],
        "c": "x",
    }


def test_commands_without_a_campaign(ask, tmp_path):
    names = {one["name"] for one in ask("vehicle")[0]["result"]["vehicles"]}
    assert "remus100_surge" in names
    page = ask("vehicle", "remus100_surge")[0]["result"]["vehicle"]
    assert {one["name"]: one["unit"] for one in page["coefficients"]}["X_uabsu"] == "kg/m"
    made = ask("init", tmp_path / "new")[0]
    assert made["files"] == {"campaign": str(tmp_path / "new" / "campaign.toml")}
    error = ask("init", tmp_path / "new", code=Exit.BAD_INPUT)[0]["error"]
    assert "a campaign already" in error["found"]
    assert error["remedy"]
    (tmp_path / "log.csv").write_text("t [s],u [m/s]\n" + "".join(f"{i / 10},{i % 7}\n" for i in range(50)))
    log = ask("inspect", tmp_path / "log.csv")[0]["result"]
    assert [one["name"] for one in log["tables"][0]["columns"]] == ["t", "u"] or log["tables"][0]["rows"] == 50
    both = ask("inspect", tmp_path / "log.csv", tmp_path / "log.csv")[0]["result"]["logs"]
    assert both[0] == log
    assert both[1]["tables"] == log["tables"]
    assert "channels.u" not in both[1]["map"]


def test_a_campaign_says_what_its_lines_say(ask, tmp_path):
    folder = write_small(tmp_path / "small")
    (record,) = ask("simulate", folder)[0]["result"]["records"]
    again, _ = ask("simulate", folder)
    assert again["result"]["records"] == [record]  # a kept answer has its result
    assert record["measured"] == ["u"]
    checked = ask("check", folder, code=None)[0]["result"]["records"]
    assert checked[0]["label"] == record["label"]


@pytest.mark.proof
def test_a_plan_is_of_the_trials_that_remain(ask, tmp_path):
    exact = "[estimation]", '[estimation]\ninertia_error = "exact"\nscale_error = "exact"'
    folder = write_small(tmp_path / "small", *NO_X_U, exact)
    file = folder / "campaign.toml"
    file.write_text(f'{file.read_text()}\n[goal]\nsd = {{ X_uabsu = 0.07 }}\ntrials = 9\n[plan]\ntime = "10 min"\n')
    before = ask("plan", folder)[0]["result"]
    ask("simulate", folder)
    after = ask("plan", folder)[0]["result"]
    assert (before["basis"], after["basis"]) == ("the priors", "1 trial so far")
    assert len(after["steps"]) < len(before["steps"])
    assert json.loads((folder / "results" / "plan_1_schedule.json").read_text())["control"] == "n"


@pytest.mark.proof
def test_every_command_of_a_campaign(ask, tmp_path):
    folder = write_small(tmp_path / "small")
    ran = ask("run", folder, code=None)[0]["result"]
    rows = (Store(folder).quote.read_text()).splitlines()
    assert rows[0] == "name,unit,mean,sd,lower_95,upper_95,noise,stated,runs,model,terms,cause,inclusion"
    by_name = {one["name"]: one for one in ran["averaged"]}
    chosen = {one["name"]: one for one in ran["coefficients"]}
    lone = [one for one in by_name.values() if one["inclusion"] < 1]
    assert {line.split(",")[0] for line in rows[1:]} == set(by_name) >= set(chosen)
    assert all(one["inclusion"] == pytest.approx(1.0) for one in by_name.values() if one not in lone)
    structures = {line.split(",")[0] for line in Store(folder).coefficients.read_text().splitlines()[1:]}
    assert structures == {one["label"] for one in ran["structures"]}
    for words in (
        ("prior",),
        ("design", "--free-form", "4", "--trials", "2", "--sensors", "--search", "20"),
        ("estimate",),
        ("estimate", "--by", "mode"),
        ("estimate", "--by", "equation-error"),
        ("profile",),
        ("select",),
        ("criteria",),
        ("crossvalidate",),
        ("tuning",),
        ("calibrate", "--replicates", "20"),
        ("next",),
        ("report",),
        ("export", "--to", "json"),
        ("export", "--trial"),
    ):
        name, *options = words
        document = ask(name, folder, *options, code=None)[0]
        assert document["error"] is None, words
        assert document["result"], words
