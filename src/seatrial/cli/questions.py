"""The values of a campaign file as questions: each has the meaning, the choices and the default that its key has in the schema.

The terminal and the forms of the pages ask the same questions; the answers take the place of the values, and comments stay.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

from seatrial.campaign.config.schema import CampaignFile
from seatrial.campaign.config.templates import example_of
from seatrial.campaign.config.toml import field_at, parse_toml, toml_content
from seatrial.campaign.config.toml_edit import Key, with_values
from seatrial.core.coefficients import CoefficientName
from seatrial.core.signals import CONTROLS, QUATERNION
from seatrial.core.usual_priors import TIMES, USUAL_SHARE

_NOT_ASKED = ("seed", "distribution")  # Keys whose value nobody has to think about at the beginning
CHANGING = (
    "always",
    "optional",
    "residuals",
    "distribution",
    "catalogue",
)  # Keys whose values add questions and remove others


class Question(NamedTuple):
    """A value of a campaign file that may be changed.

    Attributes:
        key: with dots, such as `sensors.u.noise`.
        value: as it is typed, without quotes; the parts of a list are separated by commas. Empty for a key that the file lacks.
        meaning: of the key.
        choices: the only values that it may have; none if it may have others.
        default: the value of a key that the file lacks; empty if there is none.
    """

    key: str
    value: str
    meaning: str
    choices: tuple[str, ...] = ()
    default: str = ""


def questions(text: str, tables: Mapping[str, Iterable[str]] | None = None) -> tuple[Question, ...]:
    """Return the questions of a campaign file, in its order.

    Args:
        text: of the file.
        tables: the tables to ask for, by name, and keys that are asked for even if the table lacks them; all that the file states if None.
    """
    content = toml_content("the campaign", text)
    if tables is None:
        values = {path: value for path, value in _values((), content) if path[-1] not in _NOT_ASKED}
    else:
        values = {}
        for table, keys in tables.items():
            path, here = tuple(table.split(".")), content
            for part in path:
                here = here.get(part, {})
            values |= dict.fromkeys((*path, key) for key in keys) | dict(_values(path, here))
    return tuple(question(path, value) for path, value in values.items() if field_at(CampaignFile, path) is not None)


def question(path: Key, value: Any) -> Question:
    """Return the question about a key of the schema; its value is None if the file lacks it."""
    field: Any = field_at(CampaignFile, path)
    is_union = get_origin(field.annotation) in (Union, UnionType)
    kinds = get_args(field.annotation) if is_union else (field.annotation,)
    kinds = [kind for kind in kinds if kind is not NoneType]
    choices = [one for kind in kinds for one in ((True, False) if kind is bool else get_args(kind))]
    is_closed = all(kind is bool or get_origin(kind) is Literal for kind in kinds)
    has_default = not field.is_required() and field.default not in (None, (), {}, inf)
    return Question(
        ".".join(path),
        "" if value is None else _typed(value),
        re.sub(r"\[(.*?)\]\(.*?\)", r"\1", field.description or ""),
        tuple(map(_typed, choices)) if is_closed else (),
        _typed(field.default) if has_default else "",
    )


def answered(text: str, answers: Mapping[str, str]) -> str:
    """Return a campaign file with other values.

    Args:
        text: of the file.
        answers: by key, as they are typed; an empty one removes the key, and one of a prior that is not there any more is passed over.

    Raises:
        InputError: a value that its key cannot have, or a name that is no coefficient.
    """
    before = toml_content("the campaign", text)
    stated = dict(_values((), before))
    values = {}
    for key, answer in answers.items():
        path, answer = tuple(key.split(".")), answer.strip()
        if answer != _typed(stated.get(path, "")):
            values[path] = read_answer(answer, stated.get(path), path) if answer else None
    of_priors = {path: value for path, value in values.items() if path[0] == "prior"}
    edited = with_values(text, {path: value for path, value in values.items() if path not in of_priors})
    edited = with_priors(before, edited)
    priors = toml_content("the campaign", edited).get("prior", {})
    for path, value in of_priors.items():
        if path[1] in priors:  # one without a distribution goes
            is_removed = path[2] == "distribution" and value is None
            edited = with_values(edited, {path[:2] if is_removed else path: value})
    parse_toml(Path("campaign.toml"), edited, CampaignFile, example_of)
    return edited


def key_at(where: str, keys: Sequence[str]) -> str | None:
    """Return which of some keys an error of the whole file is about; None if it names none of them."""
    named = re.search(r"(?:.*, key |^)([\w.]+)", where)
    return next((key for key in keys if named and f"{key}.".startswith(f"{named[1]}.")), None)


def with_priors(before: Mapping[str, Any], text: str) -> str:
    """Return a campaign file with priors of what was added to it, as ranges to be corrected, and without those of what was removed.

    Args:
        before: content of the file without the changes.
        text: of the file with them.
    """
    after = toml_content("the campaign", text)
    old, new, stated = _priors_of(before), _priors_of(after), after.get("prior", {})
    values = {("prior", name): table for name, table in new.items() if name not in old and name not in stated}
    values |= {("prior", name): None for name in old if name not in new and name in stated}
    return with_values(text, values)


def _priors_of(content: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return a usual prior of all for which a campaign file has to state one: its terms, and the noise of its sensors."""
    from seatrial.estimation.priors import physical_support
    from seatrial.estimation.simulation.sensor_errors import correlation_name

    vehicle, structure, priors = content.get("vehicle", {}), content.get("structure", {}), {}
    published = published_of(vehicle)
    for name in (*structure.get("always", ()), *structure.get("optional", ())):
        value, term = published.get(name), CoefficientName.parse(name)
        if value and "published_prior_sd" not in vehicle:
            sd = float(f"{USUAL_SHARE * abs(value):.3g}")
            is_damping = value < 0 and physical_support(term, inf) is not None
            priors[name] = {"distribution": "normal", "mean": value, "sd": sd}
            priors[name] |= {"dissipative": True} if is_damping else {}
        elif not value:
            is_gain = term.axis == "T" or any(one in CONTROLS for one in term.signals)
            priors[name] = _range("uniform", (0.0, 1.0) if is_gain else (-1.0, 0.0))
    for sensor, table in content.get("sensors", {}).items():
        kind = table.get("residuals", content.get("estimation", {}).get("residuals"))
        for channel in QUATERNION if sensor == "attitude" else (sensor,):
            if kind == "coloured":
                priors[correlation_name(channel)] = _range("log-uniform", TIMES)
    return priors


def published_of(vehicle: Mapping[str, Any]) -> dict[str, float]:
    """Return the published values of the coefficients of a vehicle, SI, by its table in a campaign file; none of one's own vehicle."""
    from seatrial.vehicles.catalogue import load_surge, load_vehicle, surge_names

    if "catalogue" not in vehicle:
        return {}
    name = vehicle["catalogue"]
    entry = load_surge(name) if name in surge_names() else load_vehicle(name)
    return {**entry.hull.fixed, **entry.coefficients}


def _range(distribution: str, ends: tuple[float, float]) -> dict[str, Any]:
    return {"distribution": distribution, "lower": ends[0], "upper": ends[1]}


def _values(path: Key, content: Any) -> Iterator[tuple[Key, Any]]:
    """Yield each value below a table, with its path."""
    if isinstance(content, dict):
        for key, inside in content.items():
            yield from _values((*path, key), inside)
    elif not (isinstance(content, list) and any(isinstance(one, dict) for one in content)):
        yield path, content


def _typed(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_typed, value))
    return str(value).lower() if isinstance(value, bool) else str(value)


def read_answer(answer: str, before: Any, path: Key) -> Any:
    """Read an answer: text where text stood, else a number or a truth value where it is one; whether it may be is for the schema."""
    field = field_at(CampaignFile, path)
    if isinstance(before, list) or (before is None and field is not None and get_origin(field.annotation) is tuple):
        example = before[0] if before else None
        return [read_answer(one.strip(), example, ()) for one in answer.split(",") if one.strip()]
    if isinstance(before, str):
        return answer
    if answer in ("true", "false"):
        return answer == "true"
    with suppress(ValueError):
        return int(answer) if re.fullmatch(r"[-+]?\d+", answer) and not isinstance(before, float) else float(answer)
    return answer
