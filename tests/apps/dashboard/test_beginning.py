"""Beginning a campaign from the page: texts that load, the campaign's name, and only vehicles of which a template can be."""

import tomllib

import pytest

from seatrial.apps.dashboard import model_queries as thinking
from seatrial.apps.dashboard.logs import look_into
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.templates import TEMPLATES
from seatrial.core.errors import InputError


def test_every_template_can_be_begun_from_with_each_vehicle_that_is_offered(tmp_path):
    found = {one.template: one.vehicles for one in thinking.beginnings()}
    assert list(found) == list(TEMPLATES)
    assert found["design"] == ()
    assert found["remus100"] == ("remus100_surge",)
    assert found["steering"] == ("remus100_hall_anstee", "remus100_prestero")
    for template, vehicles in found.items():
        for vehicle in vehicles or ("",):
            text = thinking.begun(str(tmp_path), template, "my boat", vehicle)
            (tmp_path / "campaign.toml").write_text(text)
            campaign = load_campaign(tmp_path)
            assert (campaign.name, campaign.vehicle.catalogue) == ("my boat", vehicle)


def test_a_vehicle_that_a_template_cannot_be_of_is_refused(tmp_path):
    with pytest.raises(InputError):
        thinking.begun(str(tmp_path), "steering", "my boat", "bluerov2_heavy")
    with pytest.raises(InputError, match="no such template"):
        thinking.begun(str(tmp_path), "../design", "my boat", "")
    assert list(tmp_path.iterdir()) == []


def test_a_log_is_looked_into_and_mapped_before_there_is_an_import(tmp_path):
    from seatrial.apps.dashboard.edits import Mapped, with_channel, with_map

    text = thinking.begun(str(tmp_path), "design", "my boat", "")
    (tmp_path / "campaign.toml").write_text(text)
    (tmp_path / "dive.csv").write_text(
        "time_s,speed,rpm\n" + "".join(f"{0.1 * i:.1f},1.5,{900 + i}\n" for i in range(99))
    )
    asked = thinking.form_data(str(tmp_path))
    assert (asked.imported, asked.simulated) == (False, False)
    found = look_into(str(tmp_path / "dive.csv"), "dive.csv", asked.channels)
    assert [(one.name, one.spread) for one in found.columns][1:] == [("speed", "1.5 to 1.5"), ("rpm", "900 to 998")]
    assert all(one.picture.startswith("M") for one in found.columns[1:])
    channel_map = ""
    for one in found.guesses:
        mapped = Mapped(one.channel, found.heads[one.table], one.column, one.unit, one.scale, 0.0)
        channel_map = with_channel(channel_map, one.channel, mapped)
    mapped = with_map(tmp_path, text, "dive", channel_map)
    thinking.check(str(tmp_path), mapped)
    assert tomllib.loads(mapped)["import"]["files"][0]["channels"]["n"]["unit"] == "rpm"
    assert 'channels.n = { column = "rpm"' in mapped
    assert "# [import]" in mapped


def test_a_channel_changes_and_all_else_of_the_map_is_kept():
    from seatrial.apps.dashboard.edits import Mapped, channels_of, with_channel

    before = """
[[import.files]]
path = "a.csv"
clock = "even"
channels.n = { column = "rpm", unit = "rpm", own = 3 }
channels.tau_X = { sum = "0.1 'left one' - 0.1 right", unit = "N", offset = 2 }
"""
    head = '[[import.files]]\npath = "b.csv"\ntime = { column = "t", unit = "s" }\n'
    after = with_channel(before, "n", Mapped("n", '[[import.files]]\npath = "a.csv"', "rps", "Hz", -2.0, 1.5))
    after = with_channel(after, "u", Mapped("u", head, "speed", "m/s", 1.0, 0.0))
    files = tomllib.loads(after)["import"]["files"]
    assert files[0] == {
        "path": "a.csv",
        "clock": "even",
        "channels": {
            "n": {"column": "rps", "unit": "Hz", "own": 3, "scale": -2.0, "offset": 1.5},
            "tau_X": {"sum": "0.1 'left one' - 0.1 right", "unit": "N", "offset": 2},
        },
    }
    assert files[1] == {
        "path": "b.csv",
        "time": {"column": "t", "unit": "s"},
        "channels": {"u": {"column": "speed", "unit": "m/s"}},
    }
    moved = with_channel(after, "u", Mapped("u", '[[import.files]]\npath = "a.csv"', "v", "kn", 1.0, 0.0))
    assert channels_of(moved)["u"] == {"column": "v", "unit": "kn", "path": "a.csv", "table": None}
    assert len(tomllib.loads(moved)["import"]["files"]) == 1
    assert "u" not in channels_of(with_channel(moved, "u", None))
    kept = with_channel(before, "tau_X", Mapped("tau_X", '[[import.files]]\npath = "a.csv"', "", "kN", 1.0, 0.0))
    assert channels_of(kept)["tau_X"]["sum"] == "0.1 'left one' - 0.1 right"


def test_another_map_of_a_run_leaves_runs_and_ends_as_they_are(tmp_path):
    from seatrial.apps.dashboard.edits import with_map

    kept = 'fit = ["a", "b"]\npredict = ["c"]\nstep = "0.1 s"\n[import.trim.b]\nstart = "2 s"\n'
    text = f'[import]\n{kept}[[import.files]]\npath = "{{run}}.csv"\nchannels.u = {{ column = "v", unit = "kn" }}\n'
    new = '[[import.files]]\npath = "{run}.csv"\nchannels.u = { column = "v", unit = "m/s" }\n'
    found = tomllib.loads(with_map(tmp_path, text, "b", new))["import"]
    assert found.pop("files")[0]["channels"]["u"]["unit"] == "m/s"
    assert found == {"fit": ["a", "b"], "predict": ["c"], "step": "0.1 s", "trim": {"b": {"start": "2 s"}}}
    assert tomllib.loads(with_map(tmp_path, text, "d", new))["import"]["fit"] == ["d"]
