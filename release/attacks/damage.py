"""Damage to bytes and to text, all of it from a random generator that a case number seeds."""

import re
from random import Random

NUMBERS = [
    bytes(4),
    b"\xff" * 4,
    b"\xff\xff\xff\x7f",
    b"\x80\0\0\0",
    bytes(8),
    b"\xff" * 8,
    b"\xff" * 7 + b"\x7f",
    b"\x01",
    b"\0\0\0\x01",
]
"""Lengths and offsets that no log has."""
VALUES = [
    "0", "-1", "1", "1e308", "-1e308", "nan", "inf", "-inf", "1e-320", "9223372036854775807", "9" * 400, "true",
    "\"\"", "\"nan\"", "\"inf s\"", "\"1e308 s\"", "\"-1 s\"", "\"0 s\"", "\"5 parsecs\"", "\"1 m/s\"", "\"1 rpm\"",
    "\"deg\"", "\"1 m m m m\"", "\"1 (m\"", "\"x y z\"", "\"\\u0000\"", "\"../../x\"", "\"/etc/passwd\"", "[]", "[1]",
    "[\"u\"]", "[\"u\", \"u\"]", "[[[]]]", "{}", "{ from = \"1 s\", to = \"1 s\", points = 0 }",
    "{ from = \"2 rpm\", to = \"1 rpm\", points = 3 }", "1979-05-27T07:32:00Z", "0x7fffffff", "\"X_u\"", "\"X_\" ",
    "\"u\"", "\"n\"", "\"none\"", "\"\u00b5 \u4e2d\"", "'''\n'''",
]  # fmt: skip
"""Values for a key of a TOML file."""
CELLS = [
    "",
    " ",
    "nan",
    "inf",
    "1e400",
    "-",
    "0x1",
    "1,5",
    '"',
    "é",
    "\0",
    "9" * 40,
    "None",
    "1_0",
    "\u0661",
    "t",
    "#",
    "1e-400",
    "1e9999999",
    "-0",
]
"""Cells for a table of text."""


def damaged(random: Random, data: bytes) -> bytes:
    """Return bytes with some damages: changed, lost, doubled, moved, cut off, or overwritten by odd numbers."""
    found = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        if not found:
            break
        at = random.randrange(len(found)) if random.random() < 0.6 else random.randrange(min(len(found), 400))
        size = min(random.choice((1, 2, 4, 8, 16, 100, 1000)), len(found) - at)
        match random.randrange(9):
            case 0:
                found[at] ^= 1 << random.randrange(8)
            case 1:
                found[at : at + size] = random.randbytes(size)
            case 2:
                del found[at : at + size]
            case 3:
                found[at:at] = found[at : at + size] * random.choice((1, 2, 50))
            case 4:
                piece = found[at : at + size]
                del found[at : at + size]
                to = random.randrange(len(found) + 1)
                found[to:to] = piece
            case 5:
                del found[at:]
            case 6:
                number = random.choice(NUMBERS)
                found[at : at + len(number)] = number
            case 7:
                found[at:at] = random.choice(NUMBERS)
            case _:
                found[at : at + size] = bytes(size)
    return bytes(found)


def damaged_table(random: Random, text: str) -> str:
    """Return a table of text whose cells, lines or separators are damaged."""
    lines = text.split("\n")
    for _ in range(random.choice((1, 1, 2, 5))):
        k = random.randrange(len(lines))
        cells = lines[k].split(",")
        match random.randrange(6):
            case 0:
                cells[random.randrange(len(cells))] = random.choice(CELLS)
                lines[k] = ",".join(cells)
            case 1:
                lines[k] = ",".join(cells[: random.randrange(len(cells) + 1)])
            case 2:
                lines.insert(k, random.choice(lines))
            case 3:
                lines[k] = lines[k].replace(",", random.choice((";", "\t", ",,", " ")))
            case 4:
                lines[k] += "," + random.choice(CELLS)
            case _:
                del lines[k]
        lines = lines or [""]
    return random.choice(("\n", "\n", "\r\n", "\r")).join(lines)


def damaged_toml(random: Random, text: str) -> str:
    """Return a TOML file with some keys, lines or characters changed."""
    lines = text.split("\n")
    keys = [k for k, line in enumerate(lines) if re.match(r"\s*[A-Za-z_.\"]+\s*=", line)] or [0]
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        k = random.choice(keys) if random.random() < 0.8 else random.randrange(len(lines))
        if k >= len(lines):
            continue
        key, equals, value = lines[k].partition("=")
        match random.randrange(8):
            case 0 | 1 | 2 if equals:
                lines[k] = f"{key}= {random.choice(VALUES)}"
            case 3 if equals:
                numbers = list(re.finditer(r"-?\d+(\.\d+)?", value))
                if numbers:
                    one = random.choice(numbers)
                    new = random.choice(("0", "-1", "1e308", "1e-300", "1000000", "nan", "7", "0.5", one.group() + "0"))
                    lines[k] = f"{key}={value[: one.start()]}{new}{value[one.end() :]}"
            case 4 if equals:
                lines[k] = (
                    f"{random.choice((key.strip()[:-1], key.strip() + 'x', '', 'seed', 'points', 'unit')) or 'x'} ={value}"
                )
            case 5:
                lines[k] = ""
            case 6:
                lines.insert(k, random.choice(lines))
            case _:
                lines[k] = damaged(random, lines[k].encode()).decode("utf-8", "replace")
    return "\n".join(lines)
