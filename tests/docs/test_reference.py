"""The generated pages of the reference know every command, key, coefficient and result file."""

import inspect
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from generate import campaign_file, coefficients, command_line, mathtext  # noqa: E402

import seatrial  # noqa: E402
from seatrial.__main__ import COMMANDS  # noqa: E402
from seatrial.campaign.config.schema import CampaignFile, CampaignTable  # noqa: E402
from seatrial.core.signals import SIGNALS  # noqa: E402


def test_every_command_is_there():
    page = command_line.page()
    assert all(f"## seatrial {name}\n" in page for name in COMMANDS)


def test_every_table_of_a_campaign_is_there():
    page = campaign_file.page()
    for name, field in CampaignFile.model_fields.items():
        assert f"[{field.alias or name}" in page, name


def test_a_key_without_a_description_is_an_error(monkeypatch):
    monkeypatch.setattr(CampaignTable.model_fields["seed"], "description", None)
    with pytest.raises(ValueError, match="CampaignTable lacks a description of seed"):
        campaign_file.page()


def test_coefficients_have_units():
    page = coefficients.page()
    assert all(f"| `{name}` |" in page for name in SIGNALS)
    assert "| `X_uabsu` | $X_{u\\vert u\\vert }$ | $u \\vert u\\vert $ | kg/m |" in page


def test_equations_are_drawn():
    svg, depth = mathtext.equation_svg(r"\dfrac{1}{2}\,\ln |P|")
    assert svg.startswith("<svg ")
    assert 'd="M' in svg
    assert depth > 1


@pytest.mark.parametrize("name", sorted(set(seatrial.__all__) - {"__version__"}))
def test_every_public_name_is_explained(name):
    """By the page, and by a docstring; a function's says what each of its arguments is."""
    page = (DOCS / "reference" / "python.md").read_text()
    assert f":: seatrial.{name}\n" in page
    thing = getattr(seatrial, name)
    assert len(thing.__doc__) > 20
    if inspect.isfunction(thing):
        arguments = set(inspect.signature(thing).parameters) - {"reporter", "progress"}
        told = thing.__doc__.partition("Args:")[2]
        assert len(arguments) < 2 or all(f"{argument}:" in told for argument in arguments), arguments
