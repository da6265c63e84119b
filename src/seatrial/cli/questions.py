"""A new campaign by questions: every value of a template is one, with the meaning that its key has in the schema.

The terminal and the page ask the same questions; the answers take the place of the values, and the comments of the template stay.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from seatrial.campaign.config.schema import CampaignFile
from seatrial.campaign.config.toml import field_at, toml_content
from seatrial.cli.toml_edit import sections_of, set_key
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError
from seatrial.core.units import to_si

_NOT_ASKED = ("seed", "distribution")  # Keys whose value nobody has to think about at the beginning
_NUMBER = re.compile(r"\s*[-+\d.eE]+")
_PRIOR = """
[prior.{name}]
distribution = "uniform"
lower = {lower}
upper = {upper}
"""


class Question(NamedTuple):
    """A value of a campaign file that may be changed.

    Attributes:
        key: with dots, such as `sensors.u.noise`.
        value: as it is typed, without quotes; the parts of a list are separated by commas.
        meaning: of the key.
    """

    key: str
    value: str
    meaning: str


def questions(text: str) -> tuple[Question, ...]:
    """Return the questions of a campaign file, in its order."""
    return tuple(
        Question(".".join(path), _typed(value), field.description or "")
        for path, value in _values((), toml_content("the template", text))
        if path[-1] not in _NOT_ASKED and (field := field_at(CampaignFile, path)) is not None
    )


def answered(text: str, answers: Mapping[str, str]) -> str:
    """Return a campaign file with other values.

    Args:
        text: of the file.
        answers: by key, as they are typed; a key that is not there any more is passed over.

    Raises:
        InputError: an answer of another kind than the value before, or a name that is no coefficient.
    """
    for key, answer in answers.items():
        *table, last = key.split(".")
        values = {".".join(path): value for path, value in _values((), toml_content("the campaign", text))}
        if key in values and answer.strip() != _typed(values[key]):
            value = (
                _read(answer.strip(), values[key], key) if answer.strip() else None
            )  # an empty answer removes the key
            text = set_key(text, ".".join(table), last, value)
    return with_priors(text)


def key_at(where: str, keys: Sequence[str]) -> str | None:
    """Return which of some keys an error of the whole file is about; None if it names none of them."""
    named = re.search(r"(?:, key |^)([\w.]+)", where)
    return next((key for key in keys if named and f"{key}.".startswith(f"{named[1]}.")), None)


def with_priors(text: str) -> str:
    """Return a campaign file in which each term has a prior, and each prior a term; a new one has a range to be corrected."""
    content = toml_content("the campaign", text)
    structure = content.get("structure", {})
    terms = [*structure.get("always", ()), *structure.get("optional", ())]
    if "published_prior_sd" in content.get("vehicle", {}):
        return text
    sections = sections_of(text)
    gone = {f"prior.{name}" for name in content.get("prior", {}) if name not in terms}
    last = max((at for at, one in enumerate(sections) if one.name.startswith(("structure", "prior."))), default=-1)
    parts = []
    for at, one in enumerate(sections):
        if one.name not in gone:
            parts.append(one.text)
        if at == last:
            for name in terms:
                if name not in content.get("prior", {}):
                    lower, upper = (0.0, 1.0) if CoefficientName.parse(name).axis == "T" else (-1.0, 0.0)
                    parts.append(_PRIOR.format(name=name, lower=lower, upper=upper).lstrip("\n") + "\n")
    return "".join(parts)


def _values(path: tuple[str, ...], content: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield each value below a table, with its path."""
    if isinstance(content, dict):
        for key, inside in content.items():
            yield from _values((*path, key), inside)
    elif not (isinstance(content, list) and any(isinstance(one, dict) for one in content)):
        yield path, content


def _typed(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_typed, value))
    return str(value).lower() if isinstance(value, bool) else str(value)


def _read(answer: str, before: Any, key: str) -> Any:
    """Read an answer as a value of the kind that it replaces: a quantity is one of the same dimension."""
    if isinstance(before, list):
        return [one.strip() for one in answer.split(",") if one.strip()]
    if isinstance(before, bool):
        if answer not in ("true", "false"):
            raise InputError(key, found=f'"{answer}"', expected="true or false", remedy="write one of them")
        return answer == "true"
    if isinstance(before, int | float):
        try:
            return type(before)(answer) if isinstance(before, int) and answer.isdigit() else float(answer)
        except ValueError:
            raise InputError(key, found=f'"{answer}"', expected="a number", remedy=f"for example {before}") from None
    if (number := _NUMBER.match(before)) and (unit := before[number.end() :].strip()) and answer != "unknown":
        typed = _NUMBER.match(answer)
        if typed is None:
            raise InputError(key, found=f'"{answer}"', expected="a number and a unit", remedy=f'for example "{before}"')
        to_si(1.0, answer[typed.end() :].strip() or "1", unit, key)
    return answer
