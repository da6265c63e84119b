"""On which line a key stands: known by hand in a file of every kind of TOML, and by taking the line away in shipped ones."""

import tomllib
from pathlib import Path

import pytest

from seatrial.campaign.config.toml import key_lines, key_place
from tests.campaign.small import SMALL

EVERYTHING = r'''# [no.table]
[a]  # its comment
b = 1
"c d" . e = [1, [2,
 3], {x = 1, y = "=,]}#"}]  # [none]
m = """
[not]
k = 2 \""""
n = """x"""""
f = { g = { h = 1 }, 'i' = 'x' }

[[files]]
path = "a"
 [files.time]
 column = "t"
[[files]]
channels = { u = {column = "c"} }
[files.q."z.z"]
w = [
  "[x]",
  {k = [1]},
]
'''
LINES = {
    **{"a": 2, "a.b": 3, "a.c d.e": 4, "a.c d.e.0": 4, "a.c d.e.1.1": 5, "a.c d.e.2.y": 5, "a.m": 6, "a.n": 9},
    **{"a.f.g.h": 10, "a.f.i": 10, "files": 12, "files.0.path": 13, "files.0.time": 14, "files.0.time.column": 15},
    **{"files.1": 16, "files.1.channels.u.column": 17, "files.1.q.z.z": 18, "files.1.q.z.z.w": 19},
    **{"files.1.q.z.z.w.0": 20, "files.1.q.z.z.w.1.k": 21, "files.1.q.z.z.w.1.k.0": 21},
}
ROOT = Path(__file__).parents[2]
SHIPPED = sorted(
    path
    for folder in ("src/seatrial/campaign/templates", "docs/trial_guide", "examples")
    for path in (ROOT / folder).rglob("*.toml")
)


def leaves(content, above=()):
    """Every value that is no table, by its path."""
    for key, value in content.items():
        if isinstance(value, dict):
            yield from leaves(value, (*above, key))
        elif not (isinstance(value, list) and value and isinstance(value[0], dict)):
            yield (*above, key)


def has(content, path):
    for key in path:
        if key not in content:
            return False
        content = content[key]
    return True


def test_every_kind_of_toml():
    found = key_lines(EVERYTHING)
    assert {key: found.get(key) for key in LINES} == LINES
    assert not {"not", "no.table", "a.k", "none"} & set(found)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: str(path.relative_to(ROOT)))
def test_without_its_line_a_key_is_gone(path):
    text = path.read_text(encoding="utf-8")
    lines, checked = key_lines(text), 0
    for leaf in leaves(tomllib.loads(text)):
        number = lines[".".join(leaf)]
        others = text.splitlines()
        del others[number - 1]
        try:
            assert not has(tomllib.loads("\n".join(others)), leaf), leaf
            checked += 1
        except tomllib.TOMLDecodeError:  # a value over several lines
            assert leaf[-1] in text.splitlines()[number - 1]
    assert checked > 5


def test_a_key_that_is_not_there_is_placed_at_its_table():
    place = key_place(Path("c.toml"), SMALL, "design.relay.output")
    assert place == f"c.toml:{SMALL.splitlines().index('[design]') + 1}, key design.relay.output"
    assert key_place(Path("c.toml"), SMALL, "goal.sd") == f"c.toml:{len(SMALL.rstrip().splitlines())}, key goal.sd"
    assert key_place(Path("c.toml"), "", "goal.sd") == "c.toml, key goal.sd"
