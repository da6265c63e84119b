"""A slice of the attacks that run before a release, and that they notice what they look for."""

import json
import re
import sys
from pathlib import Path
from random import Random

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "release"))
import attack
from attacks.damage import damaged, damaged_table, damaged_toml

LEAST = {"logs": 115, "campaigns": 30, "options": 10, "streams": 8}
"""Cases in the suite: five of each format, two of each stream, and some of each file; formats are damaged in tests/logs too."""


@pytest.mark.proof
@pytest.mark.parametrize("kind", LEAST)
def test_a_slice_of_the_attacks(tmp_path, kind, capfd):
    assert attack.main(["--only", kind, "--seed", "20", "--count", str(LEAST[kind]), "--state", str(tmp_path)]) == 0
    assert f"{kind}: {LEAST[kind]} cases" in capfd.readouterr().out


def test_the_page_counts_what_is_attacked():
    """The cases of a full run, and the kinds of log."""
    page = (Path(__file__).parents[1] / "docs" / "dev" / "reliability.md").read_text()
    table = page.partition("| `--only` | cases of a full run")[2].partition("## Counts")[0]
    cases = {
        kind: int(count.replace(" ", "")) for kind, count in re.findall(r"^\| `(\w+)` \| ([\d ]+) \|", table, re.M)
    }
    assert cases == {name: kind.count for name, kind in attack.KINDS.items()}
    assert f"a log of each of {len(attack.logs.names())} kinds" in table


def test_failures_are_noticed_counted_and_kept(tmp_path, capfd):
    for _ in range(2):
        assert attack.main(["--only", "mirror", "--state", str(tmp_path)]) == 1
        output = capfd.readouterr().out
        assert "1 done, 1 refused, 1 traceback, 1 abort, 1 escape" in output
    kept = json.loads((tmp_path / "mirror-1.json").read_text())
    assert kept["next"] == 5, "the second call had nothing left to do"
    lines = [found["line"] for found in kept["findings"].values()]
    assert sorted(line.split(" ")[0] for line in lines) == [":", "ZeroDivisionError:", "wrote"]
    assert any("signal 6" in line for line in lines)


def test_a_small_bomb_and_a_declared_one(tmp_path):
    names = list(attack.bombs.BOMBS)
    watchman = attack.Watchman()
    for name in ("netcdf, declared", "dataflash, definitions", "checkpoint, declared"):
        found = attack.bombs.bomb(names.index(name), Random(1), tmp_path / name.replace(" ", ""), watchman)
        assert found.what in attack.FINE, found.line


def test_damage_is_seeded_and_does_damage():
    data, table = bytes(range(256)) * 4, "t,u\n" + "0,1\n" * 20
    for make, value in ((damaged, data), (damaged_table, table), (damaged_toml, 'a = "1 s"\nb = 2\n')):
        first, again = [[make(Random(seed), value) for seed in range(40)] for _ in range(2)]
        assert first == again
        assert sum(one != value for one in first) > 30
