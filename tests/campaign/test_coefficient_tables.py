"""Tables of coefficients: averages are those of draws taken from the structures by their probabilities."""

import csv
from dataclasses import astuple

import numpy as np
import pytest
import xarray as xr

from seatrial.campaign.inference.coefficient_csv import averaged_rows, quote_rows, write_coefficients, write_quote
from seatrial.campaign.store.estimates import Estimate
from seatrial.core.display_units import shown_as_written
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import Evidence, select

WIDER = 1.5  # Standard deviation of X_u over that of its draws
SI = shown_as_written({})


def made(label: str, seed: int, **means: float) -> Estimate:
    """An estimate whose draws are normal about these means."""
    names = list(means)
    draws = np.random.default_rng(seed).normal(list(means.values()), 0.5, (4, 500, len(names)))
    told = {"draws": (("chain", "draw", "parameter"), draws)}
    told |= {"unit": ("parameter", ["kg/s"] * len(names)), "label": ("parameter", names)}
    sd = draws.std((0, 1))
    told |= {"mean": ("parameter", draws.mean((0, 1))), "draws_sd": ("parameter", sd)}
    told |= {
        "sd": (
            "parameter",
            np.array([WIDER * one if name == "X_u" else one for name, one in zip(names, sd, strict=True)]),
        )
    }
    told |= {"shares": (("parameter", "origin"), np.tile([0.25, 0.75, 0.0, 0.0], (len(names), 1)))}
    told |= {
        "prior_lower": ("parameter", np.full(len(names), -np.inf)),
        "prior_upper": ("parameter", np.full(len(names), np.inf)),
    }
    blank = ("mode", "mcse", "r_hat", "ess_bulk", "ess_tail")
    told |= {name: ("parameter", np.full(len(names), np.nan)) for name in blank}
    data = xr.Dataset(told, {"parameter": names})
    return Estimate(Structure(label, tuple(names)), data, causes={"X_u": "a force X_u3"})


def shortest(drawn: np.ndarray) -> tuple[float, float]:
    """The shortest interval of 95 % of some draws, of which every one is tried as its lower end."""
    drawn = np.sort(drawn)
    held = int(np.ceil(0.95 * drawn.size))
    tried = [(drawn[at], drawn[at + held - 1]) for at in range(drawn.size - held + 1)]
    return min(tried, key=lambda ends: ends[1] - ends[0])


def test_averages_are_those_of_a_mixture_of_draws(tmp_path):
    rich, simple = made("M-0", 1, X_u=-4.0, X_uabsu=2.0), made("M-1", 2, X_uabsu=3.0)
    evidences = [Evidence(0.0, 0.0, "by hand"), Evidence(float(np.log(3.0)), 0.0, "by hand")]
    selection = select([rich.structure, simple.structure], evidences, ["X_u"])
    found = {row.name: row for row in averaged_rows([rich, simple], selection)}
    # Three draws of the simple structure to one of the other, which is what their probabilities are.
    own = rich.draws(["X_u"])[:, 0]
    absent = np.concatenate([own.mean() + WIDER * (own - own.mean()), np.zeros(3 * 2000)])
    both = np.concatenate([rich.draws(["X_uabsu"])[:, 0], np.tile(simple.draws(["X_uabsu"])[:, 0], 3)])
    for name, drawn, inclusion in (("X_u", absent, 0.25), ("X_uabsu", both, 1.0)):
        assert found[name].mean == pytest.approx(drawn.mean())
        assert found[name].sd == pytest.approx(drawn.std())
        assert found[name].inclusion == pytest.approx(inclusion)
        assert found[name].inclusion <= 1.0
        assert (found[name].lower_95, found[name].upper_95) == pytest.approx(shortest(drawn))
    assert found["X_u"].upper_95 == 0.0  # three in four structures lack it
    assert (found["X_u"].cause, found["X_uabsu"].cause) == ("", "")  # the choice of terms
    # The variance of X_u, which one structure in four has: a quarter of its own in these shares, and the rest between structures.
    within = 0.25 * rich.sd("X_u") ** 2 / found["X_u"].sd ** 2
    assert astuple(found["X_u"].shares) == pytest.approx((0.25 * within, 0.75 * within, 0.0, 0.0, 1.0 - within))
    path = write_quote(tmp_path, quote_rows("averaged", (), list(found.values())), SI)
    written = list(csv.DictReader(path.open()))
    assert [row["name"] for row in written] == ["X_u", "X_uabsu"]
    assert [row["cause"] for row in written] == ["", ""]
    assert float(written[1]["lower_95"]) < float(written[1]["mean"]) < float(written[1]["upper_95"])
    before = csv.DictReader(write_coefficients(tmp_path, [rich, simple], SI).open())
    assert [row["probability"] for row in before] == ["", "", ""]
    rows = list(csv.DictReader(write_coefficients(tmp_path, [rich, simple], SI, selection).open()))
    assert [float(row["probability"]) for row in rows] == pytest.approx([0.25, 0.25, 0.75])
    assert [(row["structure"], row["name"]) for row in rows] == [("M-0", "X_u"), ("M-0", "X_uabsu"), ("M-1", "X_uabsu")]
    assert [rows[0][name] for name in ("noise", "stated", "cause")] == ["0.25", "0.75", "a force X_u3"]
    drawn = np.sort(own.mean() + WIDER * (own - own.mean()))
    inside = (drawn > float(rows[0]["lower_95"])) & (drawn < float(rows[0]["upper_95"]))
    assert inside.mean() == pytest.approx(0.95, abs=0.002)
    assert rows[0]["r_hat"] == ""


def test_what_all_structures_have_is_included_with_probability_one_and_no_more():
    structures = [made(f"M-{i}", i, X_uabsu=2.0) for i in range(7)]
    for seed in range(20):
        logs = np.random.default_rng(seed).normal(size=7)
        found = select([one.structure for one in structures], [Evidence(x, 0.0, "by hand") for x in logs], ["X_uabsu"])
        assert averaged_rows(structures, found)[0].inclusion <= 1.0
        assert found.inclusion["X_uabsu"] <= 1.0


def test_tables_are_in_the_unit_in_which_the_prior_is_written(tmp_path):
    rich = made("M-0", 1, X_u=-4.0, X_uabsu=2.0)
    shown = shown_as_written({"X_u": "t/h"})
    (si, _), (own, other) = (
        list(csv.DictReader(write_coefficients(tmp_path, [rich], one).open())) for one in (SI, shown)
    )
    assert (own["unit"], other["unit"]) == ("t/h", "kg/s")
    for column in ("mean", "sd", "lower_95", "upper_95"):
        assert float(own[column]) == pytest.approx(3.6 * float(si[column]))
