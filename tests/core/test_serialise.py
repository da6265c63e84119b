"""Results read and written by their types: as JSON, as NetCDF, and their JSON Schema."""

import json
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import pytest
from jaxtyping import Float
from pydantic import computed_field

from seatrial.campaign.store.stored_result import FORMAT, StoredResult, read_json, write_stamped_json
from seatrial.core.errors import InputError
from seatrial.core.findings import Finding, Message
from seatrial.core.serialise import AS_LIST, from_dataset, from_plain, schema_of, to_dataset, to_plain


@dataclass(frozen=True)
class Part:
    """One part of a result."""

    name: str
    value: float
    pairs: tuple[tuple[str, float], ...] = ()

    @computed_field
    @property
    def twice(self) -> float:
        """Two times the value."""
        return 2 * self.value


@dataclass(frozen=True, eq=False)
class Grid:
    """Arrays over labelled dimensions, and other fields."""

    families: Annotated[tuple[str, ...], "family"]
    period: Float[np.ndarray, " period"]
    gain: Float[np.ndarray, "family period"] = field(metadata={"units": "nat"})
    parts: tuple[Part, ...]
    basis: str
    duration: float | None = None


@dataclass(frozen=True, eq=False)
class Curve:
    """An array that is kept as JSON, and messages."""

    values: Annotated[Float[np.ndarray, " n"], AS_LIST]
    messages: tuple[Message, ...] = ()


PART = Part("X_u", float("-inf"), (("Y_v", 0.1),))
GRID = Grid(("doublet", "chirp"), np.array([1.0, 2.0]), np.array([[1.0, np.nan], [2.0, 3.0]]), (PART,), "the priors")


def test_what_is_no_number_survives_a_file_and_is_null_for_others():
    stored = json.loads(json.dumps(to_plain(PART), allow_nan=False))
    assert from_plain(Part, stored) == PART
    assert "twice" not in stored
    assert to_plain(PART, stored=False) == {"name": "X_u", "value": None, "pairs": [["Y_v", 0.1]], "twice": None}


def test_arrays_are_variables_with_the_dimensions_of_their_annotations():
    dataset = to_dataset(GRID)
    assert dataset["gain"].dims == ("family", "period")
    assert dataset["gain"].attrs == {"units": "nat"}
    assert float(dataset["gain"].sel(family="chirp", period=2.0)) == 3.0
    again = from_dataset(Grid, dataset)
    np.testing.assert_array_equal(again.gain, GRID.gain)
    assert (again.families, again.parts, again.basis, again.duration) == (GRID.families, (PART,), "the priors", None)


@pytest.mark.parametrize("name", ["result.json", "result.nc"])
def test_a_result_of_another_format_is_refused_and_its_command_named(tmp_path, name):
    kept = StoredResult(tmp_path / name, "key", Part if name.endswith("json") else Grid, "seatrial design demo")
    result = PART if name.endswith("json") else GRID
    kept.write(result)
    assert kept.is_current()
    assert type(kept.read()) is type(result)
    if name.endswith("json"):
        content = read_json(kept.path, "")
        assert content["format"] == FORMAT
        del content["sha256_of_content"]
        write_stamped_json(kept.path, {**content, "format": FORMAT - 1}, "key")
        with pytest.raises(InputError, match="format 1") as refused:
            kept.read()
        assert refused.value.remedy == "run `seatrial design demo` to make it again"


def test_a_file_with_another_type_of_field_names_it(tmp_path):
    kept = StoredResult(tmp_path / "part.json", "key", Part)
    write_stamped_json(kept.path, {"name": "X_u", "value": "wide"}, "key")
    with pytest.raises(InputError, match=r"other fields.*value: Input should be a valid number"):
        kept.read()


def test_findings_and_sentences_are_told_apart():
    finding = Finding("clock-shift", "caution", ("u",), {"shift": 0.5, "runs": ("1", "2")}, ("align",))
    curve = Curve(np.array([1.0, np.inf]), (finding, "a sentence"))
    again = from_plain(Curve, json.loads(json.dumps(to_plain(curve), allow_nan=False)))
    assert again.messages == curve.messages
    np.testing.assert_array_equal(again.values, curve.values)


def test_the_schema_allows_null_for_numbers_and_lists_for_arrays():
    schemas, shared = schema_of({"grid": Grid, "parts": list[Part]})
    number = {"type": ["number", "null"]}
    assert schemas["parts"] == {"type": "array", "items": {"$ref": "#/$defs/Part"}}
    assert shared["Grid"]["properties"]["gain"] == {"type": "array", "items": {"type": "array", "items": number}}
    assert shared["Part"]["required"] == ["name", "value", "twice"]
    assert shared["Part"]["properties"]["value"] == number


def test_a_computed_field_follows_the_others():
    assert to_plain(replace(PART, value=2.0), stored=False)["twice"] == 4.0
