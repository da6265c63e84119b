"""Dives of one frame with and without a payload: what a campaign file says of configurations, and what is made of it."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.posterior import build_posterior, posterior_of_one
from seatrial.campaign.inference.quick_estimates import posterior_modes, regressions
from seatrial.campaign.store.estimates import Estimate
from seatrial.core.dataset import Dataset
from seatrial.core.errors import InputError
from seatrial.core.serialise import from_dataset, to_dataset
from seatrial.estimation.posterior.configurations import ConfigurationDifference, names_in
from seatrial.report.labels import label_html
from seatrial.report.sections.summary import _changes
from seatrial.selection.structures import Structure
from tests.campaign.test_heave import CAMPAIGN as HEAVE
from tests.campaign.test_heave import DRAG, WEIGHTS, write_heave
from tests.cli.test_cli import run

FILES = HEAVE[HEAVE.index("[[import.files]]") :].replace(
    '{run}.csv"\n', '{run}.csv"\nruns = [RUNS]\nconfiguration = "NAME"\n'
)
CAMPAIGN = "".join(
    [
        HEAVE[: HEAVE.index("[prior.spread_net_weight]")],
        HEAVE[HEAVE.index("[sensors") : HEAVE.index("[[import.files]]")].replace('varying = ["net_weight"]\n', ""),
        FILES.replace("RUNS", '"a", "c"').replace("NAME", "empty") + "\n",
        FILES.replace("RUNS", '"b"').replace("NAME", "loaded"),
    ]
)
"""Run b carries a payload. By the logs a, b and c weigh 2, 6 and -3 N: what a and c share is their mean."""
DIFFERING = CAMPAIGN.replace(
    'initial = "estimated"\n', 'initial = "estimated"\nby_configuration = ["net_weight", "Z_wabsw"]\n'
)


@pytest.mark.parametrize(("text", "terms"), [(CAMPAIGN, ["Z_wabsw"]), (DIFFERING, ["Z_wabsw@empty", "Z_wabsw@loaded"])])
def test_by_default_the_net_weight_differs(tmp_path, text, terms):
    own = text.replace(
        "[sensors", '[prior."net_weight@loaded"]\ndistribution = "normal"\nmean = 5.0\nsd = 2.0\n\n[sensors', 1
    )
    campaign = write_heave(tmp_path, own)
    trials = get_trials(campaign)
    assert [record.configuration for record in trials.fit] == ["empty", "loaded", "empty"]
    posterior = build_posterior(campaign, campaign.full, trials.fit)
    assert [name for name in posterior.names if "[" not in name] == [
        *terms,
        "net_weight@empty",
        "net_weight@loaded",
        "sigma_w",
    ]
    priors = {one.name: one.prior for one in posterior.parameters}
    assert [priors[f"net_weight@{one}"].mean for one in ("empty", "loaded")] == [0.0, 5.0]
    alone = posterior_of_one(campaign, campaign.full, trials.fit[1])
    assert {"net_weight@loaded", terms[-1]} <= {*alone.names}
    assert "net_weight@empty" not in alone.names
    assert campaign.in_next_trial("net_weight") == "net_weight@empty"  # that of run c, the last
    assert campaign.in_next_trial("Z_wabsw") == terms[0]
    with pytest.raises(InputError, match=r"estimation.by_configuration(.|\n)*common to all records"):
        regressions(campaign, trials)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('configuration = "loaded"\n', "", 'import.files(.|\n)*run "b" without a configuration'),
        ('configuration = "loaded"', 'configuration = "a@b"', "import.files(.|\n)*at most 40 letters, digits"),
        (
            'fit = ["a", "b", "c"]',
            'fit = ["a", "c"]\npredict = ["b"]',
            r"import.files\[1\].configuration(.|\n)*of the configuration loaded(.|\n)*fitted run has: empty",
        ),
        ('runs = ["b"]', 'runs = ["b", "a"]', "empty and loaded"),
        (', "Z_wabsw"]', ', "sigma_w"]', 'by_configuration(.|\n)*"sigma_w", which is no unknown'),
        ("by_conf", 'varying = ["Z_wabsw"]\nby_conf', "by_configuration(.|\n)*key estimation.varying"),
        ("[sensors", '[goal]\nsd = { Z_wabsw = "5 %" }\n\n[sensors', "by_configuration(.|\n)*goal.sd.Z_wabsw"),
        (
            "[sensors",
            '[prior."Z_wabsw@full"]\ndistribution = "uniform"\nlower = -9\nupper = 0\n\n[sensors',
            'Z_wabsw@full(.|\n)*did you mean "Z_wabsw@loaded"',
        ),
        (
            'by_configuration = ["net_weight", "Z_wabsw"]\n',
            '[prior."Z_wabsw@loaded"]\ndistribution = "uniform"\nlower = -9\nupper = 0\n',
            "add Z_wabsw to estimation.by_configuration",
        ),
        ("by_conf", "start_values = { Z_wabsw = -9.0 }\nby_conf", 'start_values.Z_wabsw(.|\n)*"Z_wabsw@empty"'),
        (
            "by_conf",
            'start_values = { "Z_wabsw@loaded" = 5.0 }\nby_conf',
            r"start_values.Z_wabsw@loaded\n.*5\n.*between -inf and 0",
        ),
        (', "Z_wabsw"]', ', "z_b"]', r"add \[prior.z_b\]"),
    ],
)
def test_errors_name_the_key(tmp_path, old, new, words):
    text = DIFFERING.replace(old, new, 1)
    assert text != DIFFERING
    if "varying" in new:
        text = text.replace(
            "[sensors", '[prior.spread_Z_wabsw]\ndistribution = "half-normal"\nlower = 0\nscale = 9\n\n[sensors'
        )
    with pytest.raises(InputError, match=words):
        write_heave(tmp_path, text)


def test_a_list_needs_configurations(tmp_path):
    text = HEAVE.replace('varying = ["net_weight"]', 'by_configuration = ["net_weight"]')
    text = text[: text.index("[prior.spread_net_weight]")] + text[text.index("[sensors") :]
    with pytest.raises(InputError, match=r"by_configuration(.|\n)*no run with a configuration"):
        write_heave(tmp_path, text)


NAMES = ("X_u@a", "X_u@b", "T_n", "u_0[a@b]")


def test_the_parameters_of_one_configuration():
    assert names_in(NAMES, "b", "") == {"X_u@b": "X_u", "T_n": "T_n", "u_0[a@b]": "u_0[a@b]"}
    assert names_in(NAMES[2:], None, "") == {name: name for name in NAMES[2:]}
    for names, configuration in ((NAMES, None), (NAMES, "c"), (NAMES[2:], "a")):
        with pytest.raises(InputError, match=r"--configuration(.|\n)*(a, b|nothing)"):
            names_in(names, configuration, "--configuration")


def test_an_estimate_in_one_configuration():
    draws = np.random.default_rng(1).normal(size=(2, 5, 4))
    data = Dataset({"draws": (("chain", "draw", "parameter"), draws)}, coords={"parameter": list(NAMES)})
    change = ConfigurationDifference("X_u", "kg/s", "a", "b", 1.0, 0.1)
    estimate = Estimate(Structure("M-0", ("X_u", "T_n")), data, configuration_differences=(change,))
    chosen = estimate.in_configuration("b")
    assert chosen.names == ("X_u", "T_n", "u_0[a@b]")
    assert chosen.draws(["X_u"]).ravel() == pytest.approx(draws[..., 1].ravel())
    assert from_dataset(Estimate, to_dataset(estimate)).configuration_differences == (change,)


def test_the_report_has_a_row_of_each_change():
    """Of an outcome with no more than the rows need, in a unit of which 10 are one of SI."""
    coords = {
        "parameter": ["X_u@a", "X_u@b"],
        "unit": ("parameter", ["kg/s"] * 2),
        "label": ("parameter", ["X_u[a]", "X_u[b]"]),
    }
    data = Dataset({"mean": ("parameter", [-2.0, -3.0]), "sd": ("parameter", [0.1, 0.1])}, coords=coords)
    change = ConfigurationDifference("X_u", "kg/s", "a", "b", -1.0, 0.05)

    class Outcome:
        chosen = Estimate(Structure("M-0", ("X_u",)), data)
        estimates = (chosen,)
        summary = SimpleNamespace(configuration_differences=(change,))
        campaign = SimpleNamespace(
            shown=lambda _, unit: (10.0, unit),
            structure=SimpleNamespace(optional=()),
            hull=SimpleNamespace(fixed={}),
            full=None,
            model=lambda _: SimpleNamespace(controls=()),
        )

    (row,) = _changes(Outcome())
    assert (row["pair"], row["unit"], row["change"]) == ("a to b", "kg/s", "−10.0 ± 0.5")
    assert row["label"] == label_html("X_u")


@pytest.mark.proof
def test_what_changed_at_the_mode(tmp_path):
    """Run c is left out here, so that each configuration has one weight; their difference is known better than both."""
    campaign = write_heave(
        tmp_path, CAMPAIGN.replace('fit = ["a", "b", "c"]', 'fit = ["a", "b"]').replace('"a", "c"', '"a"')
    )
    (answer,) = posterior_modes(campaign, get_trials(campaign))
    values = {name: pair for name, _, (pair,) in answer.rows}
    assert abs(values["Z_wabsw"][0] - DRAG) < 2 * values["Z_wabsw"][1]
    (change,) = answer.changes
    assert (change.name, change.first, change.second) == ("net_weight", "empty", "loaded")
    assert change.change == pytest.approx(WEIGHTS["b"] - WEIGHTS["a"], abs=2 * change.sd)
    assert change.change == pytest.approx(values["net_weight@loaded"][0] - values["net_weight@empty"][0])
    assert any("net_weight changed from empty to loaded by" in line for line in answer.lines())


@pytest.mark.proof
def test_from_the_file_to_the_report(tmp_path, monkeypatch, capsys):
    from seatrial.export.from_campaign import of_campaign

    small = DIFFERING.replace("[estimation]\n", "[estimation]\nchains = 8\nwarmup = 200\ndraws = 200\n")
    small = small.replace('fit = ["a", "b", "c"]', 'fit = ["a", "b"]\npredict = ["c"]')
    campaign = write_heave(tmp_path, small)
    _, said, _ = run(monkeypatch, capsys, "run", campaign.folder)
    assert "net_weight changed from empty to loaded by" in said
    page = (tmp_path / "report.html").read_text()
    assert "Changes between configurations" in page
    changes = json.loads((tmp_path / "results" / "summary.json").read_text())["configuration_differences"]
    assert [one["name"] for one in changes] == ["Z_wabsw", "net_weight"]
    with pytest.raises(InputError, match=r"--configuration(.|\n)*empty, loaded"):
        of_campaign(tmp_path)
    vehicle, provenance = of_campaign(tmp_path, configuration="loaded")
    assert set(vehicle.coefficients) == {"Z_wabsw", "Z_wdot"}
    assert "configuration loaded" in str(provenance)
