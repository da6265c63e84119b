"""Pages of studies show the numbers that stand in the JSON files beside them."""

import json
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
sys.path.insert(0, str(Path(__file__).parents[2] / "release/simulators"))
sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import benchmark_tables
import calibration
import calibration_alarms
import configurations
import ellipsoids
import evidence
import false_terms
import gpu
import held_back
import laboratory
import paper_verdicts
import programs
import shapes
import shortlists
import study_numbers
import term_probabilities
import towing_tank

PAGES = {
    "towing_tank": ("towing_tank", "", towing_tank.tables),
    "term_probabilities": ("term_probabilities", "", term_probabilities.tables),
    "shortlists": ("shortlists", "", shortlists.tables),
    "shapes": ("shapes", "", shapes.tables),
    "configurations": ("configurations", "", configurations.tables),
    "false_terms": ("false_terms", "", false_terms.tables),
    "evidence": ("evidence", "", evidence.tables),
    "paper_verdicts": ("paper_verdicts", "", paper_verdicts.tables),
    "benchmark": ("benchmark", benchmark_tables.COMMAND, benchmark_tables.tables),
    "exports": ("exports", laboratory.COMMAND, laboratory.tables),
    "export_programs": ("exports", programs.COMMAND, programs.tables),
    "ellipsoids": ("exports", ellipsoids.COMMAND, ellipsoids.table),
    "gpu": ("../how-to/cluster", gpu.COMMAND, gpu.tables),
    "calibration": ("calibration", "", calibration.tables),
    "calibration_alarms": ("calibration", calibration_alarms.COMMAND, calibration_alarms.tables),
} | {
    f"held_back_{table}": ("held_back", f"{held_back.COMMAND} {table}", partial(held_back.tables, table))
    for table in held_back.HEADS
}
"""By the file of numbers: page below docs/dev, command in its marks if any, and what makes the tables."""


@pytest.mark.parametrize("name", PAGES)
def test_pages_show_the_numbers(name):
    page, command, tables = PAGES[name]
    found = study_numbers.kept(name)
    assert study_numbers.shown(page, command) == tables(found)
    assert found["commit"]


def test_the_table_of_exports_is_that_of_the_results_of_every_target():
    numbers = json.loads(json.dumps(laboratory.numbers_of(laboratory.all_results())))
    assert study_numbers.kept("exports") | numbers == study_numbers.kept("exports")


def test_counts_are_those_of_what_is_counted():
    benchmark, verdicts = study_numbers.kept("benchmark"), study_numbers.kept("paper_verdicts")
    assert benchmark_tables.counted(benchmark["sets"]) == {key: benchmark[key] for key in ("channels", "sets")}
    assert paper_verdicts.numbers_of(verdicts) | {"commit": verdicts["commit"]} == verdicts
    for table, ranges in (("coefficients", held_back.coefficient_ranges), ("bands", held_back.band_ranges)):
        found = study_numbers.kept(f"held_back_{table}")
        assert {name: list(pair) for name, pair in ranges(found).items()} == found["ranges"]


def test_numbers_of_a_set_of_the_benchmark():
    """A method that is better in one channel by more than a hundredth, one that diverges, and one without a result."""

    def entry(method, crps, failed=""):
        task = [{"crps": crps, "failed": crps is None, "explained": 0.5, "coverage_90": 0.9, "range_90": [0.8, 1.0]}]
        runs = [{"channel": "u", "crps": crps and crps + extra, "samples": 10} for extra in (-0.1, 0.0, 0.1)]
        names = benchmark_tables.TASKS
        scores = {"pooled": dict.fromkeys(names, task), "runs": dict.fromkeys(names, runs)} if not failed else {}
        return {"method": method, "seconds_fit": 2.0, "failed": failed, **scores}

    about = {"title": "Pool", "fit": ["a"], "held_back": ["b", "c", "d"], "horizon_s": 10.0}
    entries = [
        entry("ours", 0.5),
        entry("lag", 0.4),
        entry("n4sid", None),
        entry("sindy", 0.0, "x, found: no r; give r"),
    ]
    found = benchmark_tables.set_numbers({"set": about, "channels": {"u": "m/s"}, "entries": entries})
    assert found["better"] == {f"{task}, u": {"lag": pytest.approx(0.0)} for task in benchmark_tables.TASKS}
    numbers = {
        "bands": benchmark_tables.band_counts([{"entries": entries}]),
        **benchmark_tables.counted({"pool": found}),
    }
    text = benchmark_tables.tables(numbers)
    assert "| whole run | 1 | 0 | 1 of 1 |" in text
    assert "| ours | u | 50.0%, 0.5 | 50.0%, 0.5 | 50.0%, 0.5 | 90%, by chance 80% to 100% | 2 |" in text
    assert "| n4sid | u | diverges | diverges | diverges |  | 2 |" in text
    assert "run, u (0.5 m/s): lag (0.4, p = 0)" in text
    assert text.endswith("No result: sindy (no r).\n")


def test_tables_are_written_between_their_marks_or_to_the_end(tmp_path, monkeypatch):
    monkeypatch.setattr(study_numbers, "DEV", tmp_path)
    monkeypatch.setattr(study_numbers, "commit", lambda: "abc")
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- results: one -->\n\n| 1 |\n\n<!-- end of results -->\nb\n<!-- results -->\n\n| 2 |\n")
    study_numbers.show("page", "| 3 |\n", "one")
    study_numbers.show("page", "| 4 |\n")
    assert (study_numbers.shown("page", "one"), study_numbers.shown("page")) == ("| 3 |\n", "| 4 |\n")
    assert page.read_text() == (
        "a\n<!-- results: one -->\n\n| 3 |\n\n<!-- end of results -->\nb\n<!-- results -->\n\n| 4 |\n"
    )
    study_numbers.keep("kept", numbers := {"rows": [[1, None], [2.5, 3]], "words": ["[a  b]"]})
    assert study_numbers.kept("kept") == {"commit": "abc"} | numbers
    assert "  [1, null],\n" in (tmp_path / "kept.json").read_text()


def test_false_terms_are_counted_again():
    """The first row, of five useless candidates."""
    kept = study_numbers.kept("false_terms")
    counted = false_terms.count(5, 0, kept["sets"])
    for by, one in counted.items():
        assert kept["rows"][0][by]["false"] == pytest.approx(one.false)


def test_what_is_said_of_calibration_is_in_its_numbers():
    """The file keeps the counts of ranks, of which all else follows; README, paper and validation quote the widest ranges."""
    found = study_numbers.kept("calibration")
    for name, ranks in calibration.calibrations(found).items():
        one = found["cases"][name]
        assert [*ranks.outside()] == one["outside"]
        assert ranks.coverage(0.9).tolist() == [*one["coverage of 90 %"].values()]
        assert ranks.p_values().min() == pytest.approx(one["least p"])
    root, cases = study_numbers.DEV.parents[1], found["cases"].values()
    most = [100 * x for one in cases for x in one["coverage of 90 %"].values()]
    loops = found["closed loop"].values()
    shares = [
        100 * np.mean([count for of in one["inside and sd"].values() for count, _ in of.values()]) / one["vehicles"]
        for one in loops
    ]
    counts = [
        (count, one["right"]) for one in loops for of in one["inside and sd"].values() for count, _ in of.values()
    ]
    assert all(low <= count <= high for count, (low, high) in counts)
    for page in ("README.md", "docs/validation.md", "paper.md"):
        text = (root / page).read_text()
        assert f"{min(most):.1f} to {max(most):.1f} %" in text
        assert f"{len(cases)} cases" in text
        assert page == "README.md" or "{:.0f} and {:.0f} %".format(*shares) in text


def test_priors_from_the_shape_hold_nine_published_numbers_of_ten():
    """The numbers are those of the code, and the stated factors those of the rule."""
    kept, rows = study_numbers.kept("shapes"), shapes.all_rows()
    assert json.loads(json.dumps(shapes.numbers_of(rows))) == {key: one for key, one in kept.items() if key != "commit"}
    assert kept["vehicles"] >= 8
    assert min(kept["inside"], kept["inside by the other vehicles"]) >= 0.9 * kept["of"]
    for kind, factor in kept["factors"].items():
        assert factor == pytest.approx(shapes.factor_of([row for row in rows if row.kind == kind]), rel=0.03)


def test_mmg_with_rudder_by_hand():
    """A rudder of lift slope c at 0.5 L aft adds force and moment in proportion to the angle of the flow; it damps both motions."""
    found = towing_tank.with_rudder()
    force, moment = found["Y_delta"], found["N_delta"]
    assert moment / force == pytest.approx((-0.5 - 0.312 * 0.464) / 1.312)
    added = {name: found[name] - towing_tank.HULL[name] for name in towing_tank.HULL}
    assert added["Y_v"] < 0 < added["Y_r"]
    assert added["N_r"] < 0 < added["N_v"]
    assert added["N_v"] / added["Y_v"] == pytest.approx(added["N_r"] / added["Y_r"])
