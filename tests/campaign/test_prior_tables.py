"""Prior tables: every distribution, its units, what is wrong with a table in words, and the physical side by one key."""

from math import inf, pi

import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.config.priors import read_prior
from seatrial.campaign.config.schema import PriorTable
from seatrial.core.errors import InputError
from seatrial.estimation.priors import LogNormal, LogUniform, Normal, Uniform, half_normal, truncated_normal
from tests.campaign.small import write_small

READ = [
    ({"distribution": "uniform", "lower": -2.0, "upper": 1.0}, Uniform(-2.0, 1.0)),
    ({"distribution": "log-uniform", "lower": 0.1, "upper": 1.0}, LogUniform(0.1, 1.0)),
    ({"distribution": "normal", "mean": -2.0, "sd": 1.0}, Normal(-2.0, 1.0)),
    ({"distribution": "half-normal", "scale": 2.0, "upper": 0.0}, half_normal(2.0, upper=0.0)),
    ({"distribution": "half-normal", "scale": 2.0, "lower": 1.0}, half_normal(2.0, lower=1.0)),
    ({"distribution": "log-normal", "median": -3.0, "factor": 2.0}, LogNormal(-3.0, 2.0)),
    ({"distribution": "truncated-normal", "mean": 1.0, "sd": 2.0, "lower": 0.0}, truncated_normal(1.0, 2.0, lower=0.0)),
    (
        {"distribution": "truncated-normal", "mean": 1.0, "sd": 2.0, "lower": 0.0, "upper": 3.0},
        truncated_normal(1.0, 2.0, 0.0, 3.0),
    ),
]
PHYSICAL = [
    ("X_u", {"distribution": "uniform", "lower": -3.6, "upper": 1.2}, Uniform(-3.6, 0.0)),
    ("X_uabsu", {"distribution": "normal", "mean": -2.0, "sd": 2.0}, truncated_normal(-2.0, 2.0, upper=0.0)),
    ("X_u", {"distribution": "log-normal", "median": -3.0, "factor": 2.0}, LogNormal(-3.0, 2.0)),
    ("X_udot", {"distribution": "normal", "mean": 0.0, "sd": 20.0}, truncated_normal(0.0, 20.0, upper=30.0)),
]
REFUSED = {
    "missing number": (
        {"distribution": "half-normal", "upper": 0.0},
        ["scale missing", "scale and one of lower and upper"],
    ),
    "number of another kind": ({"distribution": "log-normal", "median": 1.0, "factor": 2.0, "sd": 1.0}, ["sd given"]),
    "no side": ({"distribution": "half-normal", "scale": 2.0}, ["no bound"]),
    "two sides": ({"distribution": "half-normal", "scale": 2.0, "lower": 0.0, "upper": 3.0}, ["lower and upper given"]),
    "no cut": ({"distribution": "truncated-normal", "mean": 0.0, "sd": 1.0}, ["no bound", "lower, upper or both"]),
    "upside down": (
        {"distribution": "truncated-normal", "mean": 0.0, "sd": 1.0, "lower": 1.0, "upper": -1.0},
        ["lower below upper"],
    ),
    "empty": ({"distribution": "truncated-normal", "mean": 9.0, "sd": 0.1, "upper": 0.0}, ["empty", "prior.X_u"]),
    "improper": (
        {"distribution": "truncated-normal", "mean": 0.0, "sd": 1.0, "lower": -inf},
        ["finite", "plausible", "leave the key out"],
    ),
    "no spread": ({"distribution": "half-normal", "scale": 0.0, "lower": 0.0}, ["prior.X_u.scale", "above 0"]),
    "no median": ({"distribution": "log-normal", "median": 0.0, "factor": 2.0}, ["prior.X_u.median", "sign"]),
    "factor below one": (
        {"distribution": "log-normal", "median": 1.0, "factor": 0.5},
        ["prior.X_u.factor", "above 1"],
    ),
    "not positive": ({"distribution": "log-uniform", "lower": 0.0, "upper": 0.5}, ["prior.X_u.lower", "above 0"]),
    "nothing physical": (
        {"distribution": "uniform", "lower": 1.0, "upper": 2.0, "dissipative": True},
        ["prior.X_u.dissipative", "move the prior"],
    ),
    "hardly anything physical": (
        {"distribution": "normal", "mean": 2.0, "sd": 0.1, "dissipative": True},
        ["prior.X_u.dissipative", "empty"],
    ),
    "a log-normal of the wrong sign": (
        {"distribution": "log-normal", "median": 2.0, "factor": 2.0, "dissipative": True},
        ["prior.X_u.dissipative", "nothing between"],
    ),
}


def read(name="X_u", si="kg/s", **table):
    return read_prior(PriorTable(**table), si, f"key prior.{name}", name=name, inertia=30.0)


@pytest.mark.parametrize(("table", "expected"), READ, ids=lambda item: str(item)[:40])
def test_every_distribution_is_read(table, expected):
    assert read(**table) == expected


def test_units_are_converted_but_not_the_factor():
    thrust = read("T_nabsn", "kg m/rad^2", distribution="log-normal", median=0.0628, factor=2.0, unit="N/(rev/s)^2")
    assert (thrust.median, thrust.factor) == (pytest.approx(0.0628 / (2 * pi) ** 2), 2.0)
    late = read("delay", "s", distribution="half-normal", scale=200.0, lower=0.0, unit="ms")
    assert (late.scale, late.lower) == (pytest.approx(0.2), 0.0)


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_said(name):
    table, words = REFUSED[name]
    with pytest.raises(InputError) as refused:
        read(**table)
    for word in ("prior.X_u", "remedy", *words):
        assert word in str(refused.value)


@pytest.mark.parametrize(("name", "table", "expected"), PHYSICAL, ids=lambda item: str(item)[:40])
def test_physical_cuts_to_the_physical_side(name, table, expected):
    assert read(name, **table, dissipative=True) == expected
    assert read(name, **table) != expected or isinstance(expected, LogNormal)


@pytest.mark.parametrize("name", ["X_du3", "X_uu", "T_nabsn", "sigma_u", "delay"])
def test_physical_is_refused_where_physics_leaves_the_sign_open(name):
    with pytest.raises(InputError, match="which may have either sign"):
        read(name, distribution="uniform", lower=-1.0, upper=1.0, dissipative=True)


def test_a_campaign_gives_its_own_mass(tmp_path):
    added = (
        "[prior.X_u]",
        '[prior.X_udot]\ndistribution = "uniform"\nlower = -5.0\nupper = 90.0\ndissipative = true\n\n[prior.X_u]',
    )
    vehicle = 'name = "own"\nmass = "30.5 kg"\nthrust_deduction = 0.1\ntrim = { u = "1.5 m/s", n = "1200 rpm" }'
    small = (
        added,
        ('optional = ["X_u"]', 'optional = ["X_u", "X_udot"]'),
        ("lower = -3.6\nupper = 1.2", "lower = -3.6\nupper = 1.2\ndissipative = true"),
    )
    campaign = load_campaign(write_small(tmp_path / "own", *small, ('catalogue = "remus100_surge"', vehicle)))
    assert campaign.prior("X_udot") == Uniform(-5.0, 30.5)
    assert campaign.prior("X_u") == Uniform(-3.6, 0.0)
    vehicle = vehicle.replace("30.5 kg", "unknown")
    campaign = load_campaign(write_small(tmp_path / "unknown", *small, ('catalogue = "remus100_surge"', vehicle)))
    assert campaign.prior("X_udot") == Uniform(-5.0, 1.0)
