"""The tables of a campaign file: units that depend on a name, former names of keys, and the schema for editors."""

import tomllib
from math import pi

import numpy as np
import pytest
from pydantic import ValidationError

from seatrial.campaign.config.design_table import RangeTable
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.quantities import RENAMED
from seatrial.campaign.config.schema import CampaignFile, EstimationTable, json_schema
from seatrial.campaign.config.sensor_table import SensorTable
from seatrial.campaign.config.templates import TEMPLATES, template_text
from seatrial.core.errors import InputError
from tests.campaign.small import write_small


def test_unit_follows_the_name_of_its_table():
    text = """
[campaign]
name = "a"
seed = 1
[vehicle]
trim = { n = "60 rpm", psi = "90 deg" }
[structure]
[sensors]
psi = { noise = "180 deg", rate = "5 Hz" }
u = { noise = "10 cm/s" }
[limits]
delta_r = { rate = "180 deg/s" }
[design]
control = "delta_r"
duration = "1 min"
active = "30 s"
sample_time = "100 ms"
amplitude = { from = "0 deg", to = "180 deg", points = 2 }
period = { from = "1 s", to = "1 min", points = 2 }
together = { n = "60 rpm" }
""".replace('"0 deg"', '"90 deg"')
    file = CampaignFile.model_validate(tomllib.loads(text.replace("cm/s", "kn")), context={})
    assert file.vehicle.trim == pytest.approx({"n": 2 * pi, "psi": pi / 2})
    assert (file.sensors["psi"].noise, file.sensors["psi"].rate) == pytest.approx((pi, 5.0))
    assert file.sensors["u"].noise == pytest.approx(10 * 1852 / 3600)
    assert file.limits["delta_r"].rate == pytest.approx(pi)
    assert file.design is not None
    assert file.design.amplitude.values() == pytest.approx((pi / 2, pi))
    assert file.design.period.values() == pytest.approx((1.0, 60.0))
    assert file.design.together["n"].amplitude == pytest.approx(2 * pi)


def test_table_in_python_is_in_si():
    assert SensorTable(noise=0.05).noise == 0.05
    assert RangeTable(**{"from": 1, "to": 2.0, "points": 3}).values() == (1.0, 1.5, 2.0)
    with pytest.raises(ValidationError, match="20 draws or more"):
        EstimationTable(draws=100, thin=10)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[vehicle]\n", '[vehicle]\nknown_from = ["a"]\n'),
        ("[vehicle]\n", '[vehicle]\npublished_to = "30 %"\n'),
        ("[vehicle]\n", '[vehicle]\ngiven = ["u"]\n'),
        ("[sensors.u]\n", '[sensors.u]\nover = "water"\n'),
        ("[prior.X_u]\n", "[prior.X_u]\nphysical = true\n"),
    ],
)
def test_former_name_of_a_key_is_refused_with_the_new_one(tmp_path, old, new):
    former = new.removeprefix(old).partition(" ")[0]
    with pytest.raises(InputError) as raised:
        load_campaign(write_small(tmp_path, (old, new)))
    assert raised.value.found == f'unknown key "{former}"'
    assert raised.value.remedy == f'write "{RENAMED[former]}", its new name'


@pytest.mark.parametrize("template", sorted(TEMPLATES))
def test_schema_for_editors_knows_every_key_of_a_template(template):
    schema, text = json_schema(), template_text(template)
    assert text.startswith("#:schema campaign.schema.json\n")
    _check_known(tomllib.loads(text), schema, schema["$defs"])


def _check_known(content, schema, tables):
    for key, value in content.items():
        inner = schema.get("properties", {}).get(key, schema.get("additionalProperties"))
        assert isinstance(inner, dict), key
        options = [inner, *inner.get("anyOf", ())]
        options += [option["items"] for option in options if "items" in option]
        options = [tables[option["$ref"].rpartition("/")[2]] if "$ref" in option else option for option in options]
        kind = {str: "string", bool: "boolean", int: "integer", float: "number", list: "array", dict: "object"}[
            type(value)
        ]
        kinds = {one for option in options for one in np.atleast_1d(option.get("type", kind)).tolist()}
        assert kind in kinds or {kind, *kinds} <= {"integer", "number", "string"}, (key, kinds)
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, dict):
                _check_known(part, next(one for one in options if one.get("type") == "object"), tables)
