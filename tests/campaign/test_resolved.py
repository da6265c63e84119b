"""A campaign is plain data in SI: built in Python it is the same as read from a file, and keys of results know nothing of units."""

import ast
import re
import shutil
from dataclasses import replace
from math import inf, pi
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import seatrial
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.design_table import DesignTable
from seatrial.campaign.config.import_table import ImportTable, LogColumn, LogFile
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.schema import ComputeTable, EstimationTable, Goal, SelectionTable, StructureTable
from seatrial.campaign.config.sensor_table import SensorTable
from seatrial.campaign.config.vehicle import AxesVehicle
from seatrial.campaign.data.import_logs import Trials, stored_record, trials_key
from seatrial.campaign.data.simulate import record_keys
from seatrial.campaign.design.sweep import design_key
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.campaign.selection import evidence
from seatrial.campaign.selection.evidence import evidence_key, stored_selection
from seatrial.campaign.selection.screening import stored_screening
from seatrial.campaign.store.stored_result import as_json, key_of
from seatrial.campaign.workflow.steps import TrialsKey
from seatrial.core.errors import InputError
from seatrial.core.record import Channel, Provenance, make_record
from seatrial.estimation.priors import LogUniform, Uniform
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.vehicles.catalogue import load_surge
from tests.campaign.small import write_small
from tests.campaign.yaw_campaign import write_yaw
from tests.campaigns import write_campaign

TRIALS = Trials((), (), "made up")
KEYS = {
    "design": design_key,
    "estimate": lambda campaign: estimate_key(campaign, campaign.full, TRIALS),
    "evidence": lambda campaign: evidence_key(campaign, campaign.full, TRIALS),
    "selection": lambda campaign: stored_selection(campaign, TRIALS).key,
    "screening": lambda campaign: stored_screening(campaign, TRIALS).key,
}


def by_hand() -> Campaign:
    """The small campaign of the tests, without a file."""
    entry = load_surge("remus100_surge")
    rpm = 2 * pi / 60
    return Campaign(
        name="small",
        seed=3,
        vehicle=AxesVehicle(entry.hull, published=entry.coefficients, catalogue="remus100_surge"),
        structure=StructureTable(always=("X_uabsu", "T_nabsn"), optional=("X_u",)),
        priors={"X_u": Uniform(-3.6, 1.2), "X_uabsu": Uniform(-8.8, 0.0), "T_nabsn": Uniform(2e-4, 12e-4)},
        sensors={"u": SensorTable(noise=0.05)},
        trial_design=DesignTable.model_validate(
            {
                "control": "n",
                "duration": 30.0,
                "active": 20.0,
                "sample_time": 0.1,
                "amplitude": {"from": 100 * rpm, "to": 200 * rpm, "points": 3},
                "period": {"from": 2.0, "to": 20.0, "points": 4},
            }
        ),
        control_limits={"n": Limits(0.0, 1500 * rpm)},
        truth={"X_u": -1.21, "X_uabsu": -2.93, "T_nabsn": 6.28e-4},
        estimation=EstimationTable(chains=16, warmup=500, draws=1000),
        selection=SelectionTable(particles=256, repeats=2),
    )


def some_record():
    time, random = 0.1 * np.arange(60), np.random.default_rng(1)
    columns = {"n": 125.0 + random.normal(size=60), "u": 1.5 + 0.1 * random.normal(size=60)}
    channels = (Channel("n", "rad/s", "control"), Channel("u", "m/s", "measurement"))
    return make_record(time, columns, channels, Provenance("made up", ""), "trial")


@pytest.mark.parametrize("step", KEYS)
def test_a_campaign_built_in_python_has_the_keys_of_its_file(tmp_path, step):
    assert KEYS[step](by_hand()) == KEYS[step](load_campaign(write_small(tmp_path)))


def test_a_campaign_built_in_python_has_the_posterior_of_its_file(tmp_path):
    own, read = by_hand(), load_campaign(write_small(tmp_path))
    ours, theirs = (build_posterior(one, one.full, [some_record()]) for one in (own, read))
    assert ours.names == theirs.names
    z = np.linspace(-0.5, 0.5, len(ours.names))
    assert float(ours.log_density(z)) == float(theirs.log_density(z))


def test_without_a_file_an_error_names_the_campaign_and_the_key():
    lacking = replace(by_hand(), priors={"X_u": Uniform(-3.6, 1.2), "X_uabsu": Uniform(-8.8, 0.0)})
    with pytest.raises(InputError) as raised:
        build_posterior(lacking, lacking.full, [some_record()])
    assert raised.value.where == 'campaign "small", key prior.T_nabsn'


UNITS = [
    (('from = "100 rpm", to = "200 rpm"', 'from = "1.6666666666666667 rev/s", to = "20.943951023931955 rad/s"'),),
    (('noise = "0.05 m/s"', 'noise = "5 cm/s"'),),
    (('duration = "30 s"', 'duration = "0.5 min"'), ('active = "20 s"', 'active = "20000 ms"')),
    (('upper = "1500 rpm"', 'upper = "25 rev/s"'),),
    (("lower = 2.0e-4\nupper = 12.0e-4", 'lower = 0.2\nupper = 1.2\nunit = "g m/rad^2"'),),
]


@pytest.mark.parametrize("changes", UNITS, ids=lambda item: item[0][1][:30])
def test_a_quantity_in_another_unit_leaves_every_result_current(tmp_path, changes):
    before, after = (load_campaign(write_small(tmp_path / name, *one)) for name, one in (("a", ()), ("b", changes)))
    assert {name: key(before) for name, key in KEYS.items()} == {name: key(after) for name, key in KEYS.items()}


DEPENDS = {
    "another name": ({"name": "large"}, ""),
    "another seed": ({"seed": 4}, "design estimate evidence selection screening"),
    "another worker": ({"compute": ComputeTable(workers="slurm")}, ""),
    "another goal": ({"goal": Goal(shares={"X_u": 0.1})}, ""),
    "another limit": ({"control_limits": {"n": Limits(0.0, 150.0)}}, "design"),
    "another rate": (
        {"sensors": {"u": SensorTable(noise=0.05, rate=5.0)}},
        "design estimate evidence selection screening",
    ),
    "other residuals": ({"estimation": EstimationTable(residuals="heavy")}, "estimate evidence selection"),
    "more particles": ({"selection": SelectionTable(particles=512, repeats=2)}, "evidence selection"),
    "more draws": ({"selection": SelectionTable(particles=256, repeats=2, draws=40960)}, "evidence selection"),
    "another prior of structures": (
        {"selection": SelectionTable(particles=256, repeats=2, structure_prior="multiplicity")},
        "selection screening",
    ),
    "a log-uniform thrust": (
        {"priors": {**by_hand().priors, "T_nabsn": LogUniform(2e-4, 12e-4)}},
        "design estimate evidence selection screening",
    ),
    "another truth": ({"truth": {"X_uabsu": -2.9}}, ""),
}


@pytest.mark.parametrize("name", DEPENDS)
def test_what_makes_which_result_stale(name):
    """The records' own key, which depends on the truth, is in that of the trials."""
    changes, stale = DEPENDS[name]
    before = by_hand()
    after = replace(before, **changes)
    assert [step for step, key in KEYS.items() if key(before) != key(after)] == stale.split()


def test_a_key_knows_types_and_twelve_digits():
    assert key_of(Uniform(1.0, 2.0)) != key_of(LogUniform(1.0, 2.0))
    assert key_of(Uniform(1.0, 2.0)) == key_of(Uniform(1.0, 2.0 + 4e-16))
    assert key_of(Uniform(1.0, 2.0)) != key_of(Uniform(1.0, 2.0 + 1e-10))
    assert key_of(1) != key_of(1.5)
    assert key_of(1.67e9) != key_of(1.67e9 + 2.4e-7)
    assert as_json({"b": (1, 2.0, inf), "a": None}) == {"b": [1, 2.0, inf], "a": None}
    with pytest.raises(TypeError):
        key_of(object())


def test_what_a_log_is_told_twice_is_no_part_of_its_key():
    column = LogColumn("u", "m/s")
    plain, stated = (LogFile(path="log.csv", channels={"u": column}, **one) for one in ({}, {"encoding": "utf-8"}))
    assert key_of(plain) == key_of(stated)
    assert key_of(plain) != key_of(plain.model_copy(update={"skip_rows": 1}))
    assert trials_key(ImportTable.model_construct(fit=("1",), files=(plain,)), ["a"]) != trials_key(
        ImportTable.model_construct(fit=("1",), files=(plain,), split=5.0), ["a"]
    )


RELAY = '[design.relay]\noutput = "{}"\nthreshold = {{ from = "{}", to = "0.3 m/s", points = 3 }}\n\n[truth]'


@pytest.mark.parametrize(
    ("output", "least", "key"),
    [("w", "0.1 m/s", "output"), ("u", "0.1 deg", "threshold.from"), ("u", "0.5 m/s", "threshold")],
)
def test_the_relay_is_checked_before_any_work(tmp_path, output, least, key):
    with pytest.raises(InputError) as raised:
        load_campaign(write_small(tmp_path, ("[truth]", RELAY.format(output, least))))
    assert raised.value.where.endswith(f", key design.relay.{key}")


SOURCE = Path(seatrial.__file__).parent
CONFIG = SOURCE / "campaign" / "config"


def imported(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}


def test_the_configuration_needs_no_step_of_a_campaign():
    steps = ("compute", "data", "design", "inference", "prior", "rehearsal", "selection", "workflow")
    names = tuple(f"seatrial.campaign.{step}" for step in steps)
    found = {path.name: [one for one in imported(path) if one.startswith(names)] for path in CONFIG.rglob("*.py")}
    assert {name: modules for name, modules in found.items() if modules} == {}


def test_an_evidence_has_the_size_that_the_campaign_says(monkeypatch):
    monkeypatch.setattr(evidence, "run_task", lambda posterior, task, keys, settings, report: settings)
    campaign = SimpleNamespace(seed=3, selection=SelectionTable(particles=512, repeats=3, draws=40960))
    study = SimpleNamespace(campaign=campaign, posterior=lambda structure: None)
    part = SimpleNamespace(structure=SimpleNamespace(terms=("X_u",)), task=None)
    found = evidence._compute(study, part, lambda done, total: None)
    assert (found.smc.particles, found.repeats, found.draws) == (512, 3, 40960)


SHIFTED = [
    ('fit = ["1", "2"]', 'fit = ["1", "2"]\nstep = "0.1 s"\nstart = "2 s"\nsplit = "15 s"'),
    (
        "[[import.files]]",
        '[import.trim.2]\nstart = "3.5 s"\nend = "0.8 min"\n[[import.keep]]\npath = "zigzag_{run}.csv"\n'
        "when = 't > 1670000000.004 and log_time < 1670000000004000512 and mode == \"MANUAL\"'\n[[import.files]]",
    ),
    ('distribution = "half-normal"\nupper = 0.0\nscale', 'distribution = "normal"\nmean = 0.0\nsd'),
    ('"zigzag_{run}.csv"\ntime', '"zigzag_{run}.csv"\nshift = "1670000000.25 s"\nskip_rows = 0\ntime'),
    ('{ column = "u", unit = "m/s" }', '{ sum = "0.5 u + 0.5 port", unit = "m/s", scale = 1.02, offset = 0.01 }'),
]
NUMBER = re.compile(r"(?<![\w.\[])\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.\]\"])")
"""But for those that end a text: labels of runs, names, and the unit 1."""


def with_shifts(folder):
    write_campaign(folder, (write_yaw(folder) / "campaign.toml").read_text(), *SHIFTED)


def example(folder, name, *logs):
    shutil.copy(Path(__file__).parents[2] / "examples" / name / "campaign.toml", folder)
    for log in logs:
        (folder / log).write_text("command,thrust\n0,0\n1,1\n")


FILES = {
    "simulated": write_small,
    "shifted logs": with_shifts,
    "six degrees": lambda folder: example(folder, "six_degrees", "dive.csv"),
    "thrusters": lambda folder: example(folder, "thruster_rov", "thrust.csv", "pool"),
}


def file_keys(folder):
    """Keys that need no look into a log, nor a result of another step."""
    campaign = load_campaign(folder)
    if campaign.imports is None:
        trials = TrialsKey(list(record_keys(campaign).values())[-1])
    else:
        records = [stored_record(campaign, campaign.imports, run, str).key for run in campaign.imports.runs]
        trials = TrialsKey(trials_key(campaign.imports, records))
    first = [design_key(campaign)] if campaign.trial_design else []
    return [*first, evidence_key(campaign, campaign.full, trials), stored_screening(campaign, trials).key]


def nearby(text):
    """Numbers next to one: by a billionth, since 1970 by a microsecond; for keys that take whole numbers by 1, -1 or 100."""
    value, whole = float(text), int(float(text))
    small = 1e-6 if value > 1e6 else 1e-9 * value or 1e-9
    return [
        repr(value + small),
        repr(value - small),
        *(str(whole + (one if value < 1e15 else 256)) for one in (1, -1, 100)),
    ]


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=[pytest.mark.proof] if one in ("six degrees", "thrusters") else []) for one in FILES],
)
def test_the_smallest_step_of_every_number_of_a_file_makes_a_result_stale(tmp_path, name):
    FILES[name](tmp_path)
    path = tmp_path / "campaign.toml"
    text = re.sub(
        "#.*|(?<=^name = ).*", lambda part: "" if part[0][0] == "#" else '"any"', path.read_text(), flags=re.M
    )
    path.write_text(text)
    before, unnoticed = file_keys(tmp_path), []
    for number in NUMBER.finditer(text):
        for other in nearby(number[0]):
            path.write_text(text[: number.start()] + other + text[number.end() :])
            try:
                after = file_keys(tmp_path)
            except InputError:
                continue
            if after == before:
                unnoticed.append(text[: number.end()].splitlines()[-1])
            break
        else:
            unnoticed.append(f"{text[: number.end()].splitlines()[-1]}: no step is taken")
    assert unnoticed == []
