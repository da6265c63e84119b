"""A TOML file against its schema: whatever is wrong is said with the file, the key, what was found and what was expected."""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from seatrial.campaign.config.quantities import LARGEST, REFUSED, RENAMED, SMALLEST, Quantity
from seatrial.core.errors import InputError, nearest
from seatrial.core.files import depend_on
from seatrial.core.units import quantity

# On which line of a TOML file each key stands, which `tomllib` does not say; for errors about what it has read.

_HEADER = re.compile(r"""[ \t]*\[(\[?)((?:"(?:\\.|[^"\\\n])*"|'[^'\n]*'|[^]"'\n])*)\]{1,2}""")
_TOKEN = re.compile(
    r"""(?P<text>"{3}(?:\\.|[^\\])*?"{3,5}|'{3}.*?'{3,5}|"(?:\\.|[^"\\\n])*"|'[^'\n]*')"""
    r"""|(?P<mark>[][{}=,\n])|(?P<word>[^\s#"'{}=,[\]]+)|(?P<gap>\#[^\n]*|[^\S\n]+)""",
    re.DOTALL,
)
_PART = re.compile(r"""\s*("(?:\\.|[^"\\\n])*"|'[^'\n]*'|[^\s."']+)\s*\.?""")


def key_place(path: Path, text: str, key: str) -> str:
    """Return file, line and key, for errors: `campaign.toml:17, key design.control`.

    Args:
        path: of the file.
        text: its content, TOML that can be read; empty if nobody knows it.
        key: with dots; `files[0].path` and `files.0.path` are the same. Where nothing stands there, the line is that of its table, or the
            last one if that is missing too.
    """
    lines, there = key_lines(text), re.sub(r"\[(\d+)\]", r".\1", key)
    while there and there not in lines:
        there = there.rpartition(".")[0]
    if not text:
        return f"{path}, key {key}"
    return f"{path}:{lines[there] if there else text.rstrip().count(chr(10)) + 1}, key {key}"


@lru_cache(maxsize=16)
def key_lines(text: str) -> Mapping[str, int]:
    """Return the line of every key and of every element of an array, by its path with dots; of a table, its first mention."""
    line_of: dict[str, int] = {}
    tables: dict[str, int] = {}
    brackets: list[tuple[str, int | None]] = [("", None)]
    """What is open: the path of a table, or that of an array with the number of its next element."""
    at, line, word, key = 0, 1, "", ""
    while at < len(text):
        fresh = len(brackets) == 1 and not (word or key)
        header = _HEADER.match(text, at) if fresh else None
        if header:
            name = _header(header[2], tables, is_array=bool(header[1]))
            _note(line_of, name, line)
            brackets[0], at = (name, None), header.end()
            continue
        token = _TOKEN.match(text, at)
        if token is None:
            break
        at, part, (path, count) = token.end(), token[0], brackets[-1]
        is_value = bool(key) or count is not None
        here = key if count is None else f"{path}.{count}"
        if token.lastgroup in ("text", "word"):
            if not is_value:
                word += part
            elif count is not None:
                _note(line_of, here, line)
        elif part == "=" and not is_value:
            key, word = _joined(path, *_parts(word)), ""
            _note(line_of, key, line)
        elif part in ("[", "{") and is_value:
            _note(line_of, here, line)
            brackets.append((here, 0 if part == "[" else None))
            key = ""
        elif part in ("]", "}") and len(brackets) > 1:
            brackets.pop()
            key = word = ""
        elif part == "," and count is not None:
            brackets[-1] = (path, count + 1)
        elif part == "," or (part == "\n" and count is None):
            key = word = ""
        line += part.count("\n")
    return line_of


def _header(written: str, tables: dict[str, int], *, is_array: bool) -> str:
    """Path of a table by its header; each table of an array has its number, counted in `tables`."""
    *above, last = _parts(written)
    path = ""
    for part in above:
        path = _joined(path, part)
        path = f"{path}.{tables[path] - 1}" if path in tables else path
    path = _joined(path, last)
    if is_array:
        tables[path] = tables.get(path, 0) + 1
        path = f"{path}.{tables[path] - 1}"
    return path


def _note(found: dict[str, int], path: str, line: int) -> None:
    """Note the line of a key, and of tables above it that no header of their own has."""
    while path:
        found.setdefault(path, line)
        path = path.rpartition(".")[0]


def _parts(written: str) -> list[str]:
    return [part[1:-1] if part[0] in "\"'" else part for part in _PART.findall(written)] or [""]


def _joined(*parts: str) -> str:
    return ".".join(part for part in parts if part)


@dataclass(frozen=True)
class FileKeys:
    """The keys of one file.

    Attributes:
        path: of the file.
        text: its content.
    """

    path: Path
    text: str

    def where(self, key: str) -> str:
        """Name a key and its line, for errors."""
        return key_place(self.path, self.text, key)

    def without_effect(self, key: str, because: str, remedy: str = "remove it") -> InputError:
        """Return the error of a key that nothing reads beside the others: its author expects something of it."""
        return InputError(
            self.where(key),
            found=f"a key without effect: {because}",
            expected="keys that have an effect",
            remedy=remedy,
        )

    def si(self, written: Quantity, unit: str, key: str) -> float:
        """Read a quantity.

        Raises:
            InputError: no quantity of this dimension, or one of a size that nothing has.
        """
        value = quantity(written, unit, self.where(key))
        if value == 0 or SMALLEST <= abs(value) <= LARGEST:
            return value
        raise InputError(
            self.where(key),
            found=f'"{written}", which is {value:.3g} {unit}',
            expected=f"0, or a size from {SMALLEST:g} to {LARGEST:g} in SI",
            remedy="correct the number or its unit",
        )


Schema = TypeVar("Schema", bound=BaseModel)
Place = tuple[str | int, ...]

# Says, after a missing key, from its path, where one may be seen or one itself.
Example = Callable[[Sequence[str | int]], str]
MOST_BYTES = 1 << 20  # Of a file that people write; reading a larger one takes minutes
DEEPEST = 12  # Tables within tables; a channel of an imported file is at six

# A key of so many parts; `tomllib` takes a time that grows with their cube.
_CHAIN = re.compile(r"""(?<![\w-])(?:(?:"[^"\n]*"|'[^'\n]*'|[\w-]+)[ \t]*\.[ \t]*){50}""")
_LINE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")
_TEXT = re.compile(r""""(?:\\[btnfr"\\]|[^"\\])*"|'[^']*'""")
# Slips of the pen, as what they leave of a line whose texts in quotes are emptied, each with its remedy; the first
# that fits is told.
_SLIPS = (
    (r"\\", "write / instead of each \\ of a path, or put the path into single quotes"),
    (r"//", "begin a comment with #"),
    (r"^[\w.]+\s*:", "write = after the key, not :"),
    (r"=\s*[-+]?\d+,\d", "write a decimal point, not a comma"),
    (r"=\s*[-+]?(?:\.\d|\d+\.(?!\d))", "write digits on both sides of the decimal point, as in 0.5"),
    (r"=\s*(?i:true|false|yes|no|on|off)\b", "write true or false, in small letters"),
    (r"=\s*[-+]?\d[\d.]*\s*[A-Za-z%°]", 'put a number and its unit into quotes, as in "60 s"'),
    (r"^[^\"']*(?:\"\"[^\"']*)*[\"'](?!\")", "close the quotes"),
    (r"=\s*[A-Za-z]", 'put text into quotes, as in "n"'),
    (r"=\s*(?:$|[,}])", "write a value after =, or remove the key"),
)
_LOOKED_AT = 1000  # Characters of a line in which such a slip is looked for
_SHOWN = 80  # Characters of what stands in the file that an error shows
_TWICE = re.compile("Cannot (?:overwrite|declare|redefine|mutate)")


def read_text(path: Path) -> str:
    """Return the text of a file that people write, without the mark that some editors put before it.

    Raises:
        InputError: too large, or not UTF-8.
    """
    depend_on(path)
    with path.open("rb") as stream:
        content = stream.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise InputError(
            str(path),
            found=f"{path.stat().st_size / 2**20:.1f} MB",
            expected=f"a TOML file of at most {MOST_BYTES >> 20} MB",
            remedy="check the path: logs are named in [import], not copied into the file",
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        raise InputError(
            f"{path}:{content[: cause.start].count(10) + 1}",
            found=f"the byte 0x{content[cause.start]:02x}, which is not UTF-8",
            expected="a TOML file in UTF-8",
            remedy="save the file as UTF-8",
        ) from cause


def parse_toml(path: Path, text: str, schema: type[Schema], example: Example) -> Schema:
    """Check the text of a file, as it is or as it is to be written, against its schema.

    Args:
        path: names the file in errors.
        text: of the file.
        schema: its tables.
        example: what to say after a missing key.

    Raises:
        InputError: malformed TOML, unknown or missing key, or a value of the wrong type.
    """
    content = toml_content(path, text)
    try:
        return schema.model_validate(content, context={})
    except ValidationError as cause:
        raise _as_input_error(path, text, content, schema, cause, example) from None


def toml_content(path: Path | str, text: str) -> dict[str, Any]:
    """Read TOML that anybody may have written.

    Raises:
        InputError: malformed, nested without end, or an integer of thousands of digits.
    """
    too_deep = _CHAIN.search(text)
    if too_deep:
        raise _nested(path, text.count("\n", 0, too_deep.start()) + 1)
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise _nested(path, _deep_line(text)) from None
    except tomllib.TOMLDecodeError as cause:
        place = _LINE.search(str(cause))
        twice = _TWICE.match(str(cause)) is not None
        number = int((place and place[1]) or text.count("\n", 0, len(text.rstrip())) + 1)
        line = re.sub(r"[^ -~\u00a1-\uffff]", "?", text.split("\n")[number - 1].strip()[:_LOOKED_AT])
        raise InputError(
            f"{path}:{number}",
            found=f"malformed TOML: {_LINE.sub('', str(cause))}, in the line: {line[:_SHOWN]}",
            expected="every key and table once" if twice else "a TOML file in UTF-8",
            remedy="remove or rename the second one" if twice else _line_remedy(line),
        ) from cause
    except ValueError:  # Python refuses to read an integer of so many digits
        digits = re.search(r"[0-9_]{4000,}", text)
        raise InputError(
            f"{path}:{text.count(chr(10), 0, digits.start() if digits else 0) + 1}",
            found="an integer of thousands of digits",
            expected="a number",
            remedy="correct the value",
        ) from None
    if any(len(place) > DEEPEST for place in _places(content)):
        raise _nested(path, _deep_line(text))
    return content


def _line_remedy(line: str) -> str:
    """What to do about a line that is no TOML: the mistake that is most often behind what stands there."""
    if re.search("[“”„«»‘’]", line):
        return 'write straight quotes, as in "60 s"'
    bare = _TEXT.sub('""', line).partition("#")[0]
    return next(
        (remedy for sign, remedy in _SLIPS if re.search(sign, bare)), "correct the line named, or the one before it"
    )


def _nested(path: Path | str, line: int) -> InputError:
    return InputError(
        f"{path}:{line}",
        found="too many nested tables or lists",
        expected=f"at most {DEEPEST} levels",
        remedy="correct the brackets, or the dots of the key",
    )


def _deep_line(text: str) -> int:
    """First line on which too many brackets are open or a key has too many parts, as far as can be told without reading values."""
    depth = 0
    for number, line in enumerate(text.splitlines(), 1):
        depth += line.count("[") + line.count("{")
        if depth > DEEPEST or re.search(rf"(?:[\w-]+[ \t]*\.[ \t]*){{{DEEPEST}}}", line):
            return number
        depth -= line.count("]") + line.count("}")
    return 1


def _places(content: Any) -> Iterator[Place]:
    """Path of every value, those too deep as far as needed to tell."""
    waiting: list[tuple[Place, Any]] = [((), content)]
    while waiting:
        place, value = waiting.pop()
        yield place
        if len(place) <= DEEPEST and isinstance(value, dict | list):
            waiting += [((*place, key), one) for key, one in _items(value)]


def _items(value: Any) -> Iterator[tuple[str | int, Any]]:
    return iter(value.items() if isinstance(value, Mapping) else enumerate(value))


def _as_input_error(
    path: Path, text: str, content: Any, schema: type[BaseModel], cause: ValidationError, example: Example
) -> InputError:
    errors = [(_place(error["loc"], content, error["type"]), error) for error in cause.errors()]
    place, first = min(errors, key=lambda error: error[1]["type"] != "extra_forbidden")
    for other, error in errors:  # of alternatives, that which goes furthest is the one that was meant
        if len(other) > len(place) and other[: len(place)] == place:
            place, first = other, error
    where = key_place(path, text, ".".join(map(str, place)))
    if first["type"] == "extra_forbidden":
        kinds, new = [schema], RENAMED.get(str(place[-1]))
        for part in place[:-1]:
            kinds = [inner for kind in kinds for inner in _inside(kind, part)]
        allowed = [key for kind in kinds if _is_table(kind) for key in _fields(kind)]
        return InputError(
            where,
            found=f'unknown key "{place[-1]}"',
            expected="one of " + ", ".join(allowed),
            remedy=f'write "{new}", its new name' if new in allowed else nearest(str(place[-1]), allowed),
        )
    if first["type"] == "missing":
        return InputError(where, found="nothing", expected=f'the key "{place[-1]}"', remedy=f"add it; {example(place)}")
    refusals = [error for other, error in errors if other == place and error["type"] == REFUSED]
    if refusals:
        refusal = refusals[0].get("ctx", {})
        parts = (*place, refusal["key"]) if refusal["key"] else place
        key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")
        return InputError(
            key_place(path, text, key), found=refusal["found"], expected=refusal["expected"], remedy=refusal["remedy"]
        )
    alike, field = [error for other, error in errors if other == place], field_at(schema, place)
    expected = " or ".join(dict.fromkeys(map(_expected, alike)))
    if first["type"] == "string_pattern_mismatch" and field is not None and field.description:
        expected = field.description
    return InputError(
        where,
        found=_shown(first.get("input")),
        expected=expected,
        remedy=next(filter(None, map(_value_remedy, alike)), "correct the value"),
    )


def _value_remedy(error: Any) -> str:
    """What to do about a value of the wrong kind; empty if nothing better is known than to correct it."""
    kind, value = error["type"], error.get("input")
    if kind == "string_type":
        return 'put it into quotes; quantities are text with a unit, such as "200 rpm"'
    if kind in ("list_type", "tuple_type") and isinstance(value, str):
        return f'write ["{value[:_SHOWN]}"]'
    if kind in ("dict_type", "model_type"):
        return "write single brackets about the table's name" if isinstance(value, list) else "write a table of keys"
    return (
        nearest(value, re.findall("'([^']*)'", error["ctx"]["expected"]))
        if kind == "literal_error" and isinstance(value, str)
        else ""
    )


def _place(location: Place, content: Any, kind: str) -> Place:
    """Path of an error without the names that pydantic has for the alternatives of a type, which the file has not."""
    path: list[str | int] = []
    here = content
    for part in location:
        keys = dict(_items(here)) if isinstance(here, dict | list) else {}
        if part in keys:
            path.append(part)
            here = keys[part]
    return (*path, location[-1]) if kind == "missing" else tuple(path)


def _expected(error: Any) -> str:
    if error["type"] == "string_type":
        return "text in quotes"
    if error["type"] in ("dict_type", "model_type", "list_type", "tuple_type"):
        return "a list" if error["type"] in ("list_type", "tuple_type") else "a table"
    return error["msg"].removeprefix("Input should be ").replace("String should", "text that should")


def _shown(value: Any) -> str:
    try:
        return repr(value)[:_SHOWN]
    except ValueError:  # Python refuses to write an integer of so many digits
        return f"a whole number of {value.bit_length()} bits"


def field_at(schema: type[BaseModel], place: Sequence[str | int]) -> FieldInfo | None:
    """Return the field that describes a key: its own, or that of the table of which the key is a free name; None if there is none."""
    kinds: list[Any] = [schema]
    field = None
    for part in place:
        fields = [{f.alias or name: f for name, f in kind.model_fields.items()} for kind in kinds if _is_table(kind)]
        field = next((one[str(part)] for one in fields if str(part) in one), field)
        kinds = [inner for kind in kinds for inner in _inside(kind, part)]
    return field if kinds else None


def _inside(kind: Any, part: str | int) -> list[Any]:
    """Types of what may stand under a key of a table or in a list, alternatives one by one."""
    if _is_table(kind):
        return _alternatives(_fields(kind).get(str(part)))
    return _alternatives(get_args(kind)[get_origin(kind) is dict]) if get_origin(kind) in (dict, list, tuple) else []


def _alternatives(kind: Any) -> list[Any]:
    if get_origin(kind) is Annotated:
        return _alternatives(get_args(kind)[0])
    is_one = get_origin(kind) in (dict, list, tuple, None)
    return [kind] if is_one else [one for option in get_args(kind) for one in _alternatives(option)]


def _is_table(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _fields(table: type[BaseModel]) -> dict[str, Any]:
    return {field.alias or name: field.annotation for name, field in table.model_fields.items()}
