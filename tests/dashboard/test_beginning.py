"""A campaign begun from the page: its values are asked for, and a file is checked before it is written."""

import tomllib

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.templates import template_text
from seatrial.core.errors import InputError
from seatrial.dashboard import model_queries as thinking
from seatrial.dashboard.campaign_paths import CampaignPaths
from seatrial.dashboard.logs import look_into
from seatrial.dashboard.map_draft import MapDraft
from tests.campaign.small import write_small
from tests.campaign.test_vehicle_campaign import log_of


def begun(folder, template, answers=()):
    """Return the text of a new campaign "my boat"."""
    return thinking.edited(str(folder), template_text(template), (*answers, ("campaign.name", "my boat")))[0]


def test_a_form_that_makes_no_campaign_is_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(InputError, match=r"key limits\.n"):
        begun(tmp_path, "design", (("limits.n.lower", "1700 rpm"),))
    with pytest.raises(InputError, match="no such vehicle"):
        thinking.beginning(str(tmp_path), "../design")
    assert list(tmp_path.iterdir()) == []


def test_a_form_asks_for_the_prior_of_each_term(tmp_path):
    text, _ = thinking.beginning(str(tmp_path), "")
    assert text == template_text("design")
    keys = {one.key for one in thinking.asked(text, (("structure.optional", "X_uu"),))}
    assert {"prior.X_uu.lower", "prior.X_uabsu.lower", "vehicle.mass"} <= keys
    assert "prior.X_u.lower" not in keys


def test_limits_of_the_command_are_asked_for_even_if_none_is_stated(tmp_path):
    text, questions = thinking.beginning(str(tmp_path), "bluerov2_heavy")
    assert "limits" not in tomllib.loads(text)
    of = {one.key: one for one in questions}
    assert of["limits.f_1.upper"].default == "none; such as 1 N"
    answers = (("limits.f_1.lower", "-40 N"), ("limits.f_1.upper", "40 N"))
    assert len(thinking.asked(text, answers)) == len(questions)
    text, _ = thinking.edited(str(tmp_path), text, answers)
    assert tomllib.loads(text)["limits"] == {"f_1": {"lower": "-40 N", "upper": "40 N"}}


def test_a_log_is_looked_into_apart_and_kept_in_the_folder_of_its_campaign(tmp_path):
    log, paths = log_of(tmp_path), CampaignPaths.of(tmp_path)
    text, _ = thinking.beginning(str(tmp_path / "new"), "bluerov2_heavy", str(log), "logs/dive.csv")
    assert not (tmp_path / "new").exists()
    paths.begin(tmp_path / "rov", text, paths.log("dive.csv"))
    assert (tmp_path / "rov" / "logs" / "dive.csv").read_bytes() == log.read_bytes()
    assert load_campaign(tmp_path / "rov").imports.files[0].path == "logs/dive.csv"
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "dive.mcap").write_text("a bag")
    paths.begin(tmp_path / "other", text, paths.log("bag"))
    assert (tmp_path / "other" / "logs" / "bag" / "dive.mcap").read_text() == "a bag"
    for written in ("no.csv", "../../etc/passwd"):
        with pytest.raises(InputError, match="--allow-read"):
            paths.log(written)


def test_a_template_begins_a_campaign_of_the_given_name(tmp_path):
    pytest.importorskip("nicegui")
    from seatrial.dashboard.pages.records import is_of_template

    text = begun(tmp_path, "log")
    (tmp_path / "campaign.toml").write_text(text)
    assert is_of_template(tmp_path)  # whose numbers are said to be examples
    text = begun(tmp_path, "remus100")
    (tmp_path / "campaign.toml").write_text(text)
    assert load_campaign(tmp_path).name == "my boat"
    assert not is_of_template(tmp_path)


def test_a_log_is_looked_into_and_mapped_before_there_is_an_import(tmp_path):
    from seatrial.dashboard.channel_map import Mapped, with_channel, with_map

    text = begun(tmp_path, "design")
    (tmp_path / "campaign.toml").write_text(text)
    (tmp_path / "dive.csv").write_text(
        "time_s,speed,rpm\n" + "".join(f"{0.1 * i:.1f},1.5,{900 + i}\n" for i in range(99))
    )
    asked = thinking.form_data(str(tmp_path))
    assert (asked.imported, asked.simulated) == (False, False)
    found = look_into(str(tmp_path / "dive.csv"), "dive.csv", asked.channels)
    assert [(one.name, one.spread) for one in found.columns][1:] == [("speed", "1.5 to 1.5"), ("rpm", "900 to 998")]
    assert all(one.picture.startswith("M") for one in found.columns[1:])
    channel_map = []
    for one in found.guesses:
        mapped = Mapped(found.heads[one.table], one.column, {"unit": one.unit, "scale": one.scale})
        channel_map = with_channel(channel_map, one.channel, mapped)
    mapped = with_map(tmp_path, text, "dive", channel_map)
    thinking.check(str(tmp_path), mapped)
    assert tomllib.loads(mapped)["import"]["files"][0]["channels"]["n"]["unit"] == "rpm"
    assert 'channels.n = {column = "rpm"' in mapped
    assert "# [import]" in mapped


def test_small_pictures_are_over_the_rows_until_a_clock_is_known_and_then_over_the_time(tmp_path):
    pytest.importorskip("nicegui")
    from seatrial.dashboard.pages.map_rows import axis_words, columns_of

    stamps = [1000 * i + 100_000 * (i >= 100) for i in range(200)]
    stamps[50] = stamps[49]  # what does not rise in every row is no clock, unless its name says so
    rows = [f"{stamp},{i % 150}" for i, stamp in enumerate(stamps)]
    (tmp_path / "dive.csv").write_text("Zeit,rpm\n" + "\n".join(rows) + "\n")

    def drawn(clocks):
        found = look_into(str(tmp_path / "dive.csv"), "dive.csv", ("n",), clocks)
        path = next(one.picture for one in found.columns if one.name == "rpm")
        return found, [float(point.partition(",")[0]) for point in path.removeprefix("M").split("L")]

    found, across = drawn({})
    draft = MapDraft(tmp_path, logs={"dive.csv": found})
    assert found.heads["rows"]["time"]["column"] == ""
    assert axis_words(draft, "dive.csv", "rows") == "over rows 1 to 200"
    assert "over rows 1 to 200</small>" in columns_of(draft, "dive.csv")
    assert max(np.diff(across)) < 2  # of 100: a row after the other
    draft.logs["dive.csv"], across = drawn({None: "Zeit"})
    of_time, of_n = {"column": "Zeit", "unit": "ms"}, {"column": "rpm", "unit": "rpm"}
    draft.files = [{"path": "dive.csv", "time": of_time, "channels": {"n": of_n}}]
    assert axis_words(draft, "dive.csv", "rows") == "over 299 s of Zeit"  # as the map says, not as the log was guessed
    assert max(np.diff(across)) == pytest.approx(100 / 3, abs=2)  # the hole of a third of the time
    assert drawn({None: "no such column"})[0].axes["rows"].clock == ""


def test_a_channel_changes_and_all_else_of_the_map_is_kept():
    from seatrial.dashboard.channel_map import Mapped, channels_of, with_channel

    before = [
        {
            "path": "a.csv",
            "clock": "even",
            "channels": {
                "n": {"column": "rpm", "unit": "rpm", "own": 3},
                "tau_X": {"sum": "0.1 'left one' - 0.1 right", "unit": "N", "offset": 2},
            },
        }
    ]
    a, b = {"path": "a.csv"}, {"path": "b.csv", "time": {"column": "t", "unit": "s"}}
    after = with_channel(before, "n", Mapped(a, "rps", {"unit": "Hz", "scale": -2.0, "offset": 1.5}))
    lined = with_channel(after, "n", Mapped(a, "rps", {"unit": "Hz", "scale": -2.0, "offset": 1.5, "between": "line"}))
    assert channels_of(lined)["n"]["between"] == "line"
    held = Mapped(a, "rps", {"unit": "Hz", "between": None})
    assert "between" not in channels_of(with_channel(lined, "n", held))["n"]
    after = with_channel(after, "u", Mapped(b, "speed", {"unit": "m/s"}))
    n = {"column": "rps", "unit": "Hz", "own": 3, "scale": -2.0, "offset": 1.5}
    assert after[0] == {**before[0], "channels": {**before[0]["channels"], "n": n}}
    assert after[1] == {**b, "channels": {"u": {"column": "speed", "unit": "m/s"}}}
    moved = with_channel(after, "u", Mapped(a, "v", {"unit": "kn"}))
    assert channels_of(moved)["u"] == {"column": "v", "unit": "kn", "path": "a.csv", "table": None}
    assert len(moved) == 1
    assert "u" not in channels_of(with_channel(moved, "u", None))
    kept = with_channel(before, "tau_X", Mapped(a, "", {"unit": "kN"}))
    assert channels_of(kept)["tau_X"]["sum"] == "0.1 'left one' - 0.1 right"
    assert before[0]["channels"]["n"]["column"] == "rpm"


def test_another_map_of_a_run_leaves_runs_and_ends_as_they_are(tmp_path):
    from seatrial.dashboard.channel_map import with_map

    kept = 'fit = ["a", "b"]\npredict = ["c"]\nstep = "0.1 s"\n[import.trim.b]\nstart = "2 s"\n'
    text = f'[import]\n{kept}[[import.files]]\npath = "{{run}}.csv"\nchannels.u = {{ column = "v", unit = "kn" }}\n'
    new = [{"path": "{run}.csv", "channels": {"u": {"column": "v", "unit": "m/s"}}}]
    found = tomllib.loads(with_map(tmp_path, text, "b", new))["import"]
    assert found.pop("files")[0]["channels"]["u"]["unit"] == "m/s"
    assert found == {"fit": ["a", "b"], "predict": ["c"], "step": "0.1 s", "trim": {"b": {"start": "2 s"}}}
    assert tomllib.loads(with_map(tmp_path, text, "d", new))["import"]["fit"] == ["d"]


COMMENTED = """# of the whole file
[truth]
X_u = -3.0  # gone when a log is there
[import]  # of the import
fit = ["a"]  # the best run
own = 3  # a key of somebody's own
# why this step
step = "0.1 s"

# the motor
[[import.files]]
path = "a.csv"  # from the motor
clock = "even"  # it came in bursts
channels.n = { column = "rpm", unit = "rpm", own = 3 }  # shaft, not propeller
channels.u = { column = "v", unit = "kn" }  # over ground?

# the logger
[[import.files]]
path = "b.csv"
[import.files.channels]
# reversed mount
r = { column = "yaw", unit = "deg/s", scale = -1.0 }  # port

# cuts
[import.trim.a]
start = "2 s"  # after the dive

# the end
[limits.n]
upper = "9 rpm"  # asked for by the owner
"""


def comments(text):
    return [line.partition("#")[2].strip() for line in text.splitlines() if "#" in line]


def test_comments_of_other_tables_and_unknown_keys_survive_every_edit_of_the_form(tmp_path):
    from seatrial.dashboard.channel_map import Mapped, files_of, with_channel, with_map, with_shift

    files, a, b = files_of(COMMENTED), {"path": "a.csv"}, {"path": "b.csv"}
    known = COMMENTED.replace("[truth]\nX_u = -3.0", "[known]\nX_u = 3")
    assert with_map(tmp_path, known, "a", files) == known
    edited = with_channel(files, "n", Mapped(a, "rps", {"unit": "Hz", "scale": -1.0}))
    edited = with_channel(edited, "r", Mapped(b, "yaw", {"unit": "rad/s", "scale": None}))
    edited = with_channel(edited, "psi", Mapped(b, "head", {"unit": "deg"}))
    edited = with_shift(edited, "b.csv", None, 12.5)
    text = with_map(tmp_path, COMMENTED, "a", edited)
    of_others = {"of the whole file", "of the import", "the best run", "a key of somebody's own", "why this step"}
    of_others |= {"cuts", "after the dive", "the end", "asked for by the owner", "[truth]", "X_u = -3.0"}
    assert of_others <= {*comments(text)}
    found, expected = tomllib.loads(text), tomllib.loads(COMMENTED)
    expected.pop("truth")
    first, second = expected["import"]["files"]
    first["channels"]["n"] |= {"column": "rps", "unit": "Hz", "scale": -1.0}
    second["channels"] = {
        "r": {"column": "yaw", "unit": "rad/s"},
        "psi": {"column": "head", "unit": "deg"},
    }
    second["shift"] = "12.5 s"
    assert found == expected
    assert with_shift(edited, "b.csv", None, 0.0) == with_shift(
        with_shift(edited, "b.csv", None, 3.0), "b.csv", None, 0
    )

    other = with_map(tmp_path, COMMENTED, "c", [{"path": "c.csv", "channels": {"u": {"column": "u", "unit": "m/s"}}}])
    new = tomllib.loads(other)
    assert new["import"]["fit"] == ["c"]
    assert (new["import"]["own"], new["import"]["step"]) == (3, "0.1 s")
    assert "trim" not in new["import"]
    assert {"of the import", "a key of somebody's own", "asked for by the owner", 'start = "2 s"'} <= {*comments(other)}


def test_an_import_that_is_written_in_one_line_is_left_to_a_text_editor(tmp_path):
    from seatrial.dashboard.channel_map import with_map

    text = 'import = { fit = ["a"], files = [{ path = "a.csv", channels = {} }] }\n'
    with pytest.raises(InputError, match="a key that seatrial cannot edit"):
        with_map(tmp_path, text, "a", [{"path": "c.csv", "channels": {}}])


def test_a_log_whose_time_has_a_strange_name_is_mapped_once_its_column_is_chosen(tmp_path):
    from seatrial.dashboard.channel_map import Mapped, with_channel, with_map, with_time

    text = begun(tmp_path, "design")
    (tmp_path / "campaign.toml").write_text(text)
    stamps = [100 * (i - (i == 50)) for i in range(99)]
    (tmp_path / "dive.csv").write_text("Zeit;Fahrt\n" + "".join(f"{t};{1.5 + 0.0001 * t}\n" for t in stamps))
    found = look_into(str(tmp_path / "dive.csv"), "dive.csv", ("u", "n"))
    assert found.guesses == ()
    assert [(one.name, one.spread) for one in found.columns] == [("Zeit", "0 to 9800"), ("Fahrt", "1.5 to 2.48")]
    head = found.heads["rows"]
    assert head == {"path": "dive.csv", "time": {"column": "", "unit": "s"}}
    with pytest.raises(InputError, match="no column of a log"):
        with_map(tmp_path, text, "dive", [])
    one = with_channel([], "u", Mapped(head, "Fahrt", {"unit": "kn"}))
    (file,) = with_time(one, "dive.csv", None, "Zeit", "ms")
    assert file == {
        "path": "dive.csv",
        "time": {"column": "Zeit", "unit": "ms"},
        "channels": {"u": {"column": "Fahrt", "unit": "kn"}},
    }
    assert with_time(one, "other.csv", None, "Zeit", "ms") == one
    bare = [{"path": "dive.csv", "channels": {"u": {"column": "Fahrt", "unit": "kn"}}}]
    assert with_time(bare, "dive.csv", None, "Zeit", "ms") == [file]


def test_a_second_log_with_the_same_columns_becomes_another_run(tmp_path):
    from seatrial.dashboard.channel_map import FurtherRun, further_run, with_further_run

    text = (
        '[import]\nfit = ["run_a"]  # the first\n\n[[import.files]]\npath = "logs/run_a.csv"  # of the logger\n'
        'channels.u = { column = "u", unit = "m/s" }\n'
    )
    run = further_run(text, "logs/run_b.csv")
    assert run == FurtherRun("run_b", "logs/{run}.csv")
    assert further_run(text, "logs/run_a.csv") is None
    assert further_run(text, "run_b.csv") is None
    assert further_run("", "logs/run_b.csv") is None
    both = with_further_run(tmp_path, text, run, "predict")
    found = tomllib.loads(both)["import"]
    assert (found["fit"], found["predict"]) == (["run_a"], ["run_b"])
    assert found["files"][0]["path"] == "logs/{run}.csv"
    assert "the first" in comments(both)
    third = with_further_run(tmp_path, both, further_run(both, "logs/run_c.csv"), "fit")
    assert tomllib.loads(third)["import"]["fit"] == ["run_a", "run_c"]
    assert further_run(both, "logs/run_b.csv") is None
    other = text.replace("logs/run_a.csv", "logs/dive.csv")
    assert further_run(other, "logs/run_b.csv") is None


def test_a_run_gets_a_map_of_its_own_and_the_others_keep_theirs(tmp_path):
    from seatrial.dashboard.channel_map import files_of, map_of_run, runs_reading, with_own_map

    text = (
        '[import]\nfit = ["1"]  # the first\n\n[[import.files]]\npath = "log_1.csv"  # of the logger\n'
        'channels.u = { column = "speed", unit = "kn" }\n'
    )
    own = [{"path": "log_2.csv", "channels": {"u": {"column": "v", "unit": "m/s"}}}]
    both = with_own_map(tmp_path, text, "log_2", "fit", own)
    found = tomllib.loads(both)["import"]
    assert found["fit"] == ["1", "log_2"]
    assert [(one["path"], one["runs"]) for one in found["files"]] == [("log_1.csv", ["1"]), ("log_2.csv", ["log_2"])]
    assert "the first" in comments(both)
    assert runs_reading(both, "log_2.csv") == ("log_2",)
    mine, others = map_of_run(files_of(both), "log_2")
    assert ([one["path"] for one in mine], [one["path"] for one in others]) == (["log_2.csv"], ["log_1.csv"])
    third = with_own_map(tmp_path, both, "log_3", "predict", [{**own[0], "path": "log_3.csv"}])
    found = tomllib.loads(third)["import"]
    assert (found["fit"], found["predict"]) == (["1", "log_2"], ["log_3"])
    assert [one["runs"] for one in found["files"]] == [["1"], ["log_2"], ["log_3"]]
    shared = text.replace('["1"]', '["1", "2", "3"]').replace("log_1.csv", "log_{run}.csv")
    assert runs_reading(shared, "log_2.csv") == ("2",)
    found = tomllib.loads(with_own_map(tmp_path, shared, "2", "predict", own))["import"]
    assert (found["fit"], "predict" in found) == (["1", "2", "3"], False)
    assert [(one["path"], one["runs"]) for one in found["files"]] == [
        ("log_{run}.csv", ["1", "3"]),
        ("log_2.csv", ["2"]),
    ]
    own[0]["channels"]["u"]["unit"] = "cm/s"
    again = files_of(with_own_map(tmp_path, both, "log_2", "fit", own))
    assert [one["channels"]["u"]["unit"] for one in again] == ["kn", "cm/s"]  # one of log_2, the newer


def test_a_log_takes_the_place_of_one_of_which_it_has_every_column_or_channel(tmp_path):
    from seatrial.dashboard.channel_map import channels_of, with_newer_log

    names = {
        "again.csv": "time_s,speed,rpm,yaw",
        "other.csv": "t,u_kn,prop_rpm",
        "half.csv": "time_s,speed",
    }
    looked = {}
    for name, head in names.items():
        rows = [",".join([f"{0.1 * k:.1f}", *[str(900 + k)] * head.count(",")]) for k in range(30)]
        (tmp_path / name).write_text("\n".join([head, *rows]) + "\n")
        looked[name] = look_into(str(tmp_path / name), name, ("u", "n"))
    u, n = {"column": "speed", "unit": "cm/s", "scale": -1.0}, {"sum": "0.5 rpm + 0.5 rpm", "unit": "rpm"}
    time = {"column": "time_s", "unit": "s"}
    before = [{"path": "run_a.csv", "time": time, "channels": {"u": u, "n": n}}]
    after, gone = with_newer_log(before, "again.csv", looked["again.csv"], ("a",))
    assert (after, gone) == ([{**before[0], "path": "again.csv"}], ("run_a.csv",))
    assert with_newer_log(after, "again.csv", looked["again.csv"], ("a",)) == (after, ())
    after, gone = with_newer_log(before, "other.csv", looked["other.csv"], ())
    assert (channels_of(after), gone) == ({}, ("run_a.csv",))
    assert with_newer_log(before, "half.csv", looked["half.csv"], ()) == (before, ())
    of_runs = [{**before[0], "path": "{run}.csv"}]
    assert with_newer_log(of_runs, "again.csv", looked["again.csv"], ("again",)) == (of_runs, ())
    motor = {"path": "motor.csv", "channels": {"n": {"column": "rpm", "unit": "rpm"}}}
    two = [{**before[0], "channels": {"u": u}}, motor]
    after, gone = with_newer_log(two, "again.csv", looked["again.csv"], ())
    assert gone == ("run_a.csv", "motor.csv")
    assert [(one["path"], [*one["channels"]]) for one in after] == [("again.csv", ["u"])]


def test_a_log_is_what_its_columns_and_the_campaign_say(tmp_path):
    text = (
        '[import]\nfit = ["a", "b"]\n\n[[import.files]]\npath = "run_{run}.csv"\ntime = { column = "t", unit = "s" }\n'
        'channels.u = { column = "speed", unit = "m/s" }\n'
    )
    (tmp_path / "campaign.toml").write_text(text)
    heads = {"run_a.csv": "t,speed", "run_b.csv": "t,dvl_speed", "dive.csv": "t,speed,rpm", "motor.csv": "t,rpm"}
    for name, head in heads.items():
        rows = [",".join([f"{0.1 * k:.1f}", *[str(900 + k)] * head.count(",")]) for k in range(30)]
        (tmp_path / name).write_text("\n".join([head, *rows]) + "\n")

    def drafted(name, purpose=None):
        draft = MapDraft(tmp_path)
        draft.add(name, look_into(str(tmp_path / name), name, ("u", "n")), purpose)
        return draft

    found = {name: (draft.purpose, draft.label) for name in heads for draft in [drafted(name)]}
    assert found == {
        "run_a.csv": ("change", "a"),
        "run_b.csv": ("fit", "b"),  # it lacks a column of the shared map
        "dive.csv": ("fit", "dive"),
        "motor.csv": ("file", "a"),  # it has other channels than the map
    }
    there = drafted("run_a.csv")
    assert there.named("run_a.csv") == "run_{run}.csv"
    assert there.is_saved(there.files)
    assert not there.is_saved([{**there.files[0], "clock": "even"}])
    there.label = "another run"
    assert not there.is_saved(there.files)
    assert drafted("run_b.csv").replaced() == "Saving gives run b this map instead of that of run_b.csv."
    assert drafted("motor.csv").replaced() == ""
    only = drafted("dive.csv", "instead")
    assert only.replaced().startswith(
        "Saving removes run a, b from the campaign file, with the map of run_a.csv, run_b.csv."
    )
    imports = tomllib.loads(only.text())["import"]
    assert (imports["fit"], [one["path"] for one in imports["files"]]) == (["dive"], ["dive.csv"])


@pytest.mark.parametrize("touch", [None, "purpose", "name", "channel"])
def test_a_second_run_of_two_logs_keeps_its_first_log_and_its_purpose(tmp_path, touch):
    text = """[import]
fit = ["a"]

[[import.files]]
path = "nav_a.csv"
time = { column = "t", unit = "s" }
channels.u = { column = "dvl kn", unit = "kn" }
channels.r = { column = "yaw_rate", unit = "deg/s" }

[[import.files]]
path = "drive_a.csv"
shift = "1000 s"
time = { column = "t_ms", unit = "ms" }
channels.n = { column = "Schraube", unit = "rpm" }  # of the propeller
"""
    (tmp_path / "campaign.toml").write_text(text)
    heads = {"nav": "t,dvl kn,yaw_rate", "drive": "t_ms,Schraube,gyro_z"}
    for name in ("nav_a", "drive_a", "nav_b", "drive_b", "dive_c"):
        head = heads.get(name[:-2], "t,dvl kn,yaw_rate,Schraube")
        rows = [",".join([f"{0.1 * k:.1f}", *[str(900 + k)] * head.count(",")]) for k in range(30)]
        (tmp_path / f"{name}.csv").write_text("\n".join([head, *rows]) + "\n")

    def add(draft, name):
        draft.add(name, look_into(str(tmp_path / name), name, ("u", "r", "n")))

    draft = MapDraft(tmp_path)
    add(draft, "nav_b.csv")
    assert (draft.purpose, draft.is_begun) == ("fit", False)
    if touch == "purpose":
        assert draft.choose("predict")
        assert draft.channels.keys() == {"u", "r"}
    elif touch == "name":
        draft.label = "the second"
    elif touch == "channel":
        draft.files = [{**draft.files[0], "clock": "even"}]
    add(draft, "drive_b.csv")
    assert list(draft.logs) == ["nav_b.csv", "drive_b.csv"]
    assert draft.dropped == ()
    assert draft.purpose == ("predict" if touch == "purpose" else "fit")
    assert draft.label == ("the second" if touch == "name" else "nav_b")
    assert {name: (one["path"], one["column"]) for name, one in draft.channels.items()} == {
        "u": ("nav_b.csv", "dvl kn"),
        "r": ("nav_b.csv", "yaw_rate"),
        "n": ("drive_b.csv", "Schraube"),
    }
    draft.choose("predict")
    imports = tomllib.loads(draft.text())["import"]
    assert (imports["fit"], imports["predict"]) == (["a"], [draft.label])
    assert [(one["path"], one["runs"]) for one in imports["files"]] == [
        ("nav_a.csv", ["a"]),
        ("drive_a.csv", ["a"]),
        ("nav_b.csv", [draft.label]),
        ("drive_b.csv", [draft.label]),
    ]
    add(draft, "nav_a.csv")  # of run a: what was begun is not kept, which is said
    assert (draft.purpose, draft.label, draft.dropped) == ("change", "a", ("nav_b.csv", "drive_b.csv"))


def test_a_log_that_lacks_nothing_is_a_run_of_its_own_beside_one_that_nobody_changed(tmp_path):
    text = '[import]\nfit = ["a"]\n\n[[import.files]]\npath = "a.csv"\ntime = { column = "t", unit = "s" }\n'
    (tmp_path / "campaign.toml").write_text(text + 'channels.u = { column = "speed", unit = "m/s" }\n')
    for name, head in (("a", "t,speed"), ("b", "t,speed"), ("c", "t,speed,rpm")):
        rows = [",".join([f"{0.1 * k:.1f}", *[str(900 + k)] * head.count(",")]) for k in range(30)]
        (tmp_path / f"{name}.csv").write_text("\n".join([head, *rows]) + "\n")
    draft = MapDraft(tmp_path)
    for name in ("b.csv", "c.csv"):
        draft.add(name, look_into(str(tmp_path / name), name, ("u", "n")))
    assert (draft.purpose, draft.label, [*draft.logs], draft.dropped) == ("fit", "c", ["c.csv"], ("b.csv",))


def test_the_placeholders_of_a_template_are_no_map(tmp_path):
    text = begun(tmp_path, "log")
    (tmp_path / "campaign.toml").write_text(text)
    rows = "".join(f"{100 * i};{0.1 * i:.1f}\n" for i in range(30))
    (tmp_path / "nav day 2.csv").write_text("time_s;prop_rpm\n" + rows)  # no column seems to be the speed
    draft = MapDraft(tmp_path)
    draft.add("nav day 2.csv", look_into(str(tmp_path / "nav day 2.csv"), "nav day 2.csv", ("n", "u")))
    assert draft.channels.keys() == {"n"}
    assert "COLUMN" not in str(draft.files)
    assert draft.label == "nav_day_2"


def test_two_logs_are_lined_up_and_drawn_by_a_map_that_is_not_saved(tmp_path):
    from seatrial.dashboard.channel_map import with_map, with_shift
    from seatrial.dashboard.logs import column_of, line_up

    folder = write_small(tmp_path / "boat")
    before = (folder / "campaign.toml").read_text()
    time = 0.1 * np.arange(600)
    turn = np.interp(time, 2.0 * np.arange(31), np.random.default_rng(2).normal(size=31))
    for name, late, column, values in (
        ("motor", 0, "rpm", 1200 + 50 * turn),
        ("doppler", 900.0, "speed", 1.5 + 0.1 * turn),
    ):
        rows = "".join(f"{t + late:.1f},{v:.5f},{r:.5f}\n" for t, v, r in zip(time, values, turn, strict=True))
        (folder / f"{name}.csv").write_text(f"time_s,{column},yaw\n{rows}")
    looked = {name: look_into(str(folder / f"{name}.csv"), f"{name}.csv", ()) for name in ("motor", "doppler")}
    ends = [column_of(str(folder / f"{name}.csv"), "yaw", one.heads["rows"], 0.0) for name, one in looked.items()]
    found = line_up(*ends)
    assert found.shift == pytest.approx(-900.0, abs=1e-3)
    assert found.correlation == pytest.approx(1.0, abs=1e-3)

    channel_map = [
        {"path": "motor.csv", "channels": {"n": {"column": "rpm", "unit": "rpm"}}},
        {"path": "doppler.csv", "channels": {"u": {"column": "speed", "unit": "m/s"}}},
    ]
    lined = with_shift(channel_map, "doppler.csv", None, found.shift)
    apart, together = (with_map(folder, before, "dive", one) for one in (channel_map, lined))
    about = thinking.axis_about(str(folder), apart, "dive", ())
    assert dict(zip(about.names, about.logs, strict=True)) == {"u": "doppler.csv", "n": "motor.csv"}
    np.testing.assert_allclose(about.spans, [(900.0, 959.9), (0.0, 59.9)], atol=1e-9)
    assert not about.overlaps
    asked = str(folder), together, "dive", (), (ends[0], ends[1]._replace(shift=found.shift))
    about = thinking.axis_about(*asked)
    assert about.names == ("yaw · motor.csv", "yaw · doppler.csv", "u", "n")
    np.testing.assert_allclose(about.spans, [(0.0, 59.9)] * 4, atol=1e-3)
    np.testing.assert_allclose(about.interval, (0.0, 59.9), atol=1e-3)
    seen = thinking.axis_view(*asked, 10.0, 20.0, 720)
    np.testing.assert_allclose(seen["yaw · motor.csv"].least[3:90], seen["yaw · doppler.csv"].least[3:90], atol=1e-4)
    there = np.isin(np.round(time, 1), np.round(seen["u"].time, 1))
    np.testing.assert_allclose(seen["u"].least, 1.5 + 0.1 * turn[there], atol=1e-4)
    np.testing.assert_allclose(seen["n"].greatest, 1200 + 50 * turn[there], atol=1e-2)
    assert (folder / "campaign.toml").read_text() == before
    bad = with_map(folder, before, "dive", [{**channel_map[0], "shift": "3 kg"}])
    with pytest.raises(InputError, match=r"import\.files\[0\]\.shift"):
        thinking.check(str(folder), bad)


def test_the_unit_of_a_text_stamp_is_said_in_words(tmp_path):
    rows = "\n".join(f"2026-05-04T09:12:{second:02d}Z,{second / 10}" for second in range(20))
    (tmp_path / "dive.csv").write_text(f"stamp,u\n{rows}\n")
    found = look_into(str(tmp_path / "dive.csv"), "dive.csv", ("u",))
    assert {one.name: one.unit for one in found.columns}["stamp"] == "date and time"
    assert [head["time"] for head in found.heads.values()] == [{"column": "stamp", "unit": "ns"}]
