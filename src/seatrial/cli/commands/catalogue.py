"""Pages of the published vehicles and of the codes of findings, and the schema of a campaign file."""

import json
from typing import Annotated

import typer

from seatrial.cli.answer import current_answer


def vehicle(
    name: Annotated[str | None, typer.Argument(help="A vehicle of the catalogue; all of them if left out.")] = None,
    names: Annotated[bool, typer.Option("--names", help="List only the names, one a line.")] = False,
) -> None:
    """List the published vehicles, or show one of them."""
    from seatrial.core.coefficients import CoefficientName
    from seatrial.core.errors import InputError
    from seatrial.report.vehicle_page import vehicle_page
    from seatrial.vehicles.catalogue import load_vehicle, vehicle_names

    answer = current_answer()
    if names and name is not None:
        raise InputError("--names", found=f"it and {name}", expected="one of them", remedy="leave one of them out")
    if name is None:
        titles = {one: load_vehicle(one).hull.name for one in vehicle_names()}
        answer.say("\n".join(one if names else f"{one:<24} {title}" for one, title in titles.items()))
        answer.give(vehicles=[{"name": one, "title": title} for one, title in titles.items()])
    else:
        published = load_vehicle(name)
        model, hull = published.build(), published.hull
        coefficients = [
            {"name": term, "unit": model.unit_of(CoefficientName.parse(term)), "value": value}
            for term, value in {**published.coefficients, **hull.fixed}.items()
        ]
        answer.say(vehicle_page(name, published).rstrip("\n"))
        stated = {key: getattr(published, key) for key in ("moves", "controls", "notes")}
        answer.give(
            vehicle={"name": name, "title": hull.name, "mass": hull.mass, "coefficients": coefficients, **stated}
        )


def explain(
    code: Annotated[str | None, typer.Argument(help="Code of a finding; all codes are listed if left out.")] = None,
) -> None:
    """Explain a finding and its remedy."""
    from seatrial.messages.catalogue import ENTRIES, entry_of
    from seatrial.messages.explain import explanation, listing

    answer = current_answer()
    entries = ENTRIES if code is None else {code: entry_of(code, "CODE")}
    answer.say((listing() if code is None else explanation(code)).rstrip("\n"))
    answer.give(codes=[{"code": name, "title": entry.title} for name, entry in entries.items()])


def schema() -> None:
    """Print the JSON Schema of a campaign file, for an editor.

    An editor completes and checks the file by it. The first line of a template names it: write it to campaign.schema.json in the folder
    of campaign.toml.
    """
    from seatrial.campaign.config.schema import json_schema

    answer, document = current_answer(), json_schema()
    answer.say(json.dumps(document, indent=2, ensure_ascii=False))
    answer.give(campaign_schema=document)
