"""The benchmark from end to end on simulated runs, and what it refuses."""

import csv
import gzip
import hashlib
import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.public.methods import METHODS, choose
from benchmarks.public.ours import with_estimate
from benchmarks.public.run import run_set
from benchmarks.public.set_file import check_file, read_set, set_names
from benchmarks.public.simulated import simulate
from benchmarks.public.write import COLUMNS, lines, write_result
from seatrial.core.errors import InputError
from tests.benchmark.small_set import SURGE, write_set


def test_baselines_on_the_simulated_set(tmp_path):
    result = run_set(
        read_set(str(write_set(tmp_path))), choose(["lag", "persistence", "nomoto"]), None, tmp_path / "out"
    )
    by_name = {entry.method: entry for entry in result.entries}
    lag, hold = by_name["lag"], by_name["persistence"]
    assert "no yaw rate" in by_name["nomoto"].failed
    assert lag.pooled["run"][0].explained > 0.8
    for task in ("run", "short"):
        assert lag.pooled[task][0].crps < hold.pooled[task][0].crps
    assert hold.pooled["step"][0].crps < hold.pooled["short"][0].crps < hold.pooled["run"][0].crps
    json_path, csv_path, page_path = write_result(result, tmp_path / "out" / "surge")
    kept = json.loads(json_path.read_text())
    assert (kept["format"], kept["set"]["held_back"], kept["channels"]) == (1, ["c", "d"], {"u": "m/s"})
    scores = {entry["method"]: entry for entry in kept["entries"]}
    assert scores["lag"]["pooled"]["run"][0]["crps"] == lag.pooled["run"][0].crps
    assert [one["run"] for one in scores["lag"]["runs"]["run"]] == ["c", "d"]
    rows = list(csv.DictReader(csv_path.open()))
    assert tuple(rows[0]) == COLUMNS
    assert [(row["method"], row["task"]) for row in rows if not row["failed"]] == [
        (name, task) for name in ("persistence", "lag") for task in ("run", "short", "step")
    ]
    page = page_path.read_text()
    assert "<script" not in page
    assert "no yaw rate" in page
    assert any("by chance" in line for line in lines(result))


@pytest.mark.proof
def test_ours_beats_the_baselines_on_the_simulated_set(tmp_path):
    found = read_set(str(write_set(tmp_path)))
    result = run_set(found, choose(["ours", "lag", "persistence", "mean"]), None, tmp_path / "out")
    assert result.beaten() == []
    ours = result.entries[0]
    assert ours.pooled["run"][0].explained > 0.9
    assert 0.75 < ours.pooled["step"][0].coverage_90 < 0.97
    (name, term, value, sd, known) = next(one for one in result.coefficients())
    assert (name, term, known) == ("ours", "X_uabsu", -0.35)
    assert (value, sd) == (ours.about[term], ours.about_sd[term])
    assert set(ours.about) == {"X_tau_X", "X_u", "X_uabsu", "sigma_u", "tau_u"}


@pytest.mark.proof
@pytest.mark.parametrize(
    ("setting", "prior"),
    [
        ('residuals = "white"', ""),
        pytest.param(
            'likelihood = "filter-error"',
            'process_u = { distribution = "log-uniform", lower = 1e-3, upper = 1.0 }',
            marks=pytest.mark.proof,
        ),
    ],
)
def test_stretches_begin_anew_where_residuals_are_not_coloured(tmp_path, setting, prior):
    tau = 'tau_u = { distribution = "log-uniform", lower = 0.05, upper = 60.0 }'
    path = write_set(tmp_path, a=('residuals = "coloured"', setting), b=(tau, prior))
    pooled = run_set(read_set(str(path)), choose(["ours"]), None, tmp_path / "out").entries[0].pooled
    assert pooled["short"][0].explained > 0.9
    assert pooled["step"][0].crps < pooled["short"][0].crps


@pytest.mark.proof
def test_ours_chosen_leaves_runs_out(tmp_path):
    path = write_set(
        tmp_path,
        a=('fit = ["a", "b"]', 'fit = ["a", "b", "c"]'),
        b=('predict = ["c", "d"]', 'predict = ["d"]'),
        c=('residuals = "coloured"', 'residuals = "white"'),
        d=('tau_u = { distribution = "log-uniform", lower = 0.05, upper = 60.0 }', ""),
    )
    entry = run_set(read_set(str(path)), choose(["ours-chosen"]), None, tmp_path / "out").entries[0]
    assert "model of the error: disturbance" in entry.note, "waves push the vehicle, and its thrust comes late"
    assert entry.pooled["run"][0].explained > 0.9
    assert entry.pooled["step"][0].holds


def test_the_simulated_vehicle_is_the_same_for_a_seed_and_has_its_terminal_speed():
    largest = np.array([60.0, 0.3])
    one, two = (simulate(40.0, largest, np.random.default_rng(5)) for _ in range(2))
    assert all(np.array_equal(one[name], two[name]) for name in one)

    class Full:
        """Full thrust, no rudder, nine equal waves whose phases cancel them, no noise."""

        def uniform(self, low, high, size=None):
            return high if size is None else np.repeat(2 * np.pi * np.arange(9)[:, None] / 9, 3, 1)

        def standard_normal(self, size):
            return np.zeros(size)

    found = simulate(120.0, np.array([40.0, 1e-9]), Full())
    thrust = 40.0 / 40.0 - 0.03
    terminal = (-0.10 + np.sqrt(0.01 + 4 * 0.35 * thrust)) / 0.7
    assert found["u"][-1] == pytest.approx(terminal, abs=1e-3)


@pytest.mark.parametrize("name", set_names())
def test_every_set_of_the_package_can_be_read(name):
    found = read_set(name)
    assert found.name == name
    assert not set(found.fit) & set(found.held_back)
    assert found.made is not None or len(found.files) >= len(found.fit) + len(found.held_back)


def files_of(tmp_path):
    """A set whose one file is there, its hash stated, and the data folder."""
    data = tmp_path / "data"
    data.mkdir()
    for run in "abcd":
        (data / f"{run}.csv").write_text(f"t,tau_X,u\n0,0,{run}\n")
    hashes = [f'"{run}.csv" = "{hashlib.sha256((data / f"{run}.csv").read_bytes()).hexdigest()}"' for run in "abcd"]
    made = "[made]" + made_text()
    return read_set(str(write_set(tmp_path, a=(made, "[files]\n" + "\n".join(hashes) + "\n\n")))), data


def made_text():
    """What follows the heading [made] up to the next table but one."""
    return SURGE.partition("[made]")[2].partition("[known]")[0]


def test_a_wrong_hash_names_the_file_and_the_source(tmp_path):
    found, data = files_of(tmp_path)
    assert check_file(found, data, "b.csv") == data / "b.csv"
    (data / "b.csv").write_text("t,tau_X,u\n0,0,0\n")
    with pytest.raises(InputError, match=r"(?s)b\.csv.*SHA-256.*Nothing is to be fetched"):
        check_file(found, data, "b.csv")


def test_a_compressed_file_counts_by_its_content_and_a_damaged_one_is_told(tmp_path):
    found, data = files_of(tmp_path)
    content = (data / "b.csv").read_bytes()
    (data / "b.csv").unlink()
    (data / "b.csv.gz").write_bytes(gzip.compress(content))
    assert check_file(found, data, "b.csv") == data / "b.csv.gz"
    (data / "b.csv.gz").write_bytes(gzip.compress(content)[:-9])
    with pytest.raises(InputError, match="damaged file"):
        check_file(found, data, "b.csv")


def test_a_missing_file_says_where_it_is_to_be_had(tmp_path):
    found, data = files_of(tmp_path)
    (data / "d.csv").unlink()
    with pytest.raises(InputError, match=r"(?s)d\.csv.*no such file.*Nothing is to be fetched. Licence: none"):
        run_set(found, choose(["lag"]), data, tmp_path / "out")
    with pytest.raises(InputError, match=r"(?s)no data folder.*SEATRIAL_DATA"):
        run_set(found, choose(["lag"]), None, tmp_path / "out")


def test_a_link_out_of_the_data_folder_is_refused(tmp_path):
    found, data = files_of(tmp_path)
    (data / "a.csv").rename(tmp_path / "elsewhere.csv")
    (data / "a.csv").symlink_to(tmp_path / "elsewhere.csv")
    with pytest.raises(InputError, match="a link to"):
        check_file(found, data, "a.csv")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('path = "{run}.csv"', 'path = "../{run}.csv"', "below the data folder"),
        ('path = "{run}.csv"', 'path = "/etc/{run}.csv"', "below the data folder"),
        ('path = "{run}.csv"', 'path = "$HOME/{run}.csv"', "below the data folder"),
        ('name = "surge"', 'name = "../surge"', "pattern"),
        ('licence = "none"', 'license = "none"', "license"),
        ('predict = ["c", "d"]', "predict = []", "held back"),
        ("[vehicle]", '[compute]\nworkers = "tcp://x:1"\n\n[vehicle]', "machine"),
        ("X_uabsu = {", "X_uabsv = {", "X_uabs"),
        ('horizon = "5 s"', 'horizon = "5 m"', "horizon"),
        ("X_uabsu = -0.35", "X_uabsw = -0.35", 'did you mean "X_uabsu"'),
    ],
)
def test_a_bad_set_file_is_refused(tmp_path, old, new, words):
    with pytest.raises(InputError, match=words):
        run_set(read_set(str(write_set(tmp_path, a=(old, new)))), choose(["mean"]), None, tmp_path / "out")


def test_a_file_without_a_hash_is_refused(tmp_path):
    made = "[made]" + made_text()
    with pytest.raises(InputError, match=r'(?s)"a\.csv".*holds no hash'):
        read_set(str(write_set(tmp_path, a=(made, ""))))


def test_an_unknown_set_or_method_is_told_its_neighbour(tmp_path):
    with pytest.raises(InputError, match=r'(?s)no such set.*did you mean "pool_auv"'):
        read_set("pool_auvs")
    with pytest.raises(InputError, match="no such file"):
        read_set(str(tmp_path / "none.toml"))
    with pytest.raises(InputError, match=r'(?s)no such method.*did you mean "ours"'):
        choose(["our"])
    assert [method.name for method in choose(None)] == [name for name in METHODS if name != "ours-chosen"]
    assert [method.name for method in choose(["lag", "ours-chosen"])] == ["ours-chosen", "lag"]


def test_a_method_of_a_library_that_is_not_there_says_so(tmp_path, monkeypatch):
    for library in ("pysindy", "nfoursid"):
        monkeypatch.setitem(sys.modules, library, None)  # so that its import fails
    result = run_set(read_set(str(write_set(tmp_path))), choose(["sindy", "n4sid"]), None, tmp_path / "out")
    assert [entry.method for entry in result.entries] == ["sindy", "n4sid"]
    assert all("is not installed" in entry.failed and "pip install" in entry.failed for entry in result.entries)


def test_a_method_sees_no_measurement_after_the_start_of_a_stretch(tmp_path):
    """What is measured later may change and the predictions stay."""
    from benchmarks.public.method import Problem
    from benchmarks.public.set_file import campaign_of
    from benchmarks.public.simulated import make_records
    from benchmarks.public.tasks import SHORT, stretches
    from seatrial.campaign.data.import_logs import import_trials
    from seatrial.core.reporter import SILENT

    found = read_set(str(write_set(tmp_path)))
    make_records(found, tmp_path / "data")
    campaign = campaign_of(found, tmp_path / "data", tmp_path / "out")
    trials = import_trials(campaign)
    fitted = METHODS["lag"].fit(Problem(campaign, trials, SILENT))
    record = trials.predict[0]
    pieces = stretches(SHORT, record, ("u",), 5.0)
    begins = {begin for begin, _ in pieces}
    changed = record.measurement.copy()
    changed[[k for k in range(len(changed)) if k not in begins]] += 1.0
    one, two = (fitted.predict(each, pieces) for each in (record, replace(record, measurement=changed)))
    np.testing.assert_array_equal(one.mean, two.mean)


def test_a_mixture_has_another_estimate_as_often_as_it_weighs():
    draws = {"X_u": np.linspace(-1.0, 0.0, 300), "sigma_u": np.linspace(1.0, 2.0, 300)}
    mixed = with_estimate(draws, {"X_u": 5.0, "N_r": 1.0}, 1 / 3)
    assert {name: column.size for name, column in mixed.items()} == {"X_u": 300, "sigma_u": 300}
    assert (mixed["X_u"] == 5.0).mean() == 0.25
    assert mixed["sigma_u"].mean() == pytest.approx(1.5, rel=1e-2)
