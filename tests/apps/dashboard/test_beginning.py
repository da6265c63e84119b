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
    from seatrial.apps.dashboard.edits import with_map

    text = thinking.begun(str(tmp_path), "design", "my boat", "")
    (tmp_path / "campaign.toml").write_text(text)
    (tmp_path / "dive.csv").write_text(
        "time_s,speed,rpm\n" + "".join(f"{0.1 * i:.1f},1.5,{900 + i}\n" for i in range(99))
    )
    asked = thinking.form_data(str(tmp_path))
    assert (asked.imported, asked.simulated) == (False, False)
    found = look_into(str(tmp_path / "dive.csv"), "dive.csv", asked.channels)
    assert [(one.name, one.spread) for one in found.columns][1:] == [("speed", "1.5 to 1.5"), ("rpm", "900 to 998")]
    mapped = with_map(tmp_path, text, "dive", found.map)
    thinking.check(str(tmp_path), mapped)
    assert tomllib.loads(mapped)["import"]["files"][0]["channels"]["n"]["unit"] == "rpm"
    assert 'channels.n = { column = "rpm"' in mapped
    assert "# [import]" in mapped
