"""The vehicle of a campaign: posterior means with their covariance, and the rest from where it is said to come."""

import json
from dataclasses import astuple

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.simulate import record_keys
from seatrial.campaign.store.stored_result import SEAL, Store, write_dataset, write_stamped_json
from seatrial.core.dataset import Dataset
from seatrial.core.dataset_file import open_dataset
from seatrial.core.errors import InputError
from seatrial.core.signals import RATES
from seatrial.export import manoeuvre
from seatrial.export.from_campaign import export_to, of_campaign
from seatrial.export.reading import read_exported
from seatrial.export.targets.own_json import OwnJson
from seatrial.export.write import of_catalogue, state
from seatrial.messages.structures import QUOTED
from seatrial.vehicles.tether import Tether
from tests.export.finished import finished

WHOLE = (
    (
        'catalogue = "remus100_surge"',
        'catalogue = "remus100_hall_anstee"\nmoves = ["u", "w", "q"]\n'
        'trim = { u = "1.5 m/s", n = "110 rad/s", delta_s = "0 deg" }',
    ),
    ('["X_uabsu", "T_nabsn"]', '["X_uabsu", "T_nabsn", "M_q"]'),
    ('[sensors.u]', '[prior.M_q]\ndistribution = "uniform"\nlower = -5.0\nupper = 0.0\n\n[sensors.u]'),
    ('X_u = -1.21\nX_uabsu', 'M_q = -1.0\nX_u = -1.21\nX_uabsu'),
)  # fmt: skip


def test_estimates_are_the_posterior_s_means_and_covariance(tmp_path):
    folder = finished(tmp_path / "c")
    vehicle, provenance = of_campaign(folder)
    data = open_dataset(folder / "results" / "posterior" / "M-0.nc")
    names = ["X_uabsu", "T_nabsn", "X_u"]
    draws = data["draws"].sel(parameter=names).values.reshape(-1, 3)
    assert vehicle.estimated.names == tuple(names)
    np.testing.assert_allclose(vehicle.estimated.mean, draws.mean(0))
    np.testing.assert_allclose(vehicle.estimated.covariance, np.cov(draws.T, bias=True))
    assert vehicle.coefficients["X_u"] == pytest.approx(draws[:, 2].mean())
    assert provenance.run == data.attrs["key"]
    assert (vehicle.moves, vehicle.is_whole) == (("u",), False)
    assert provenance.dropped == ()
    assert "everything about q" in provenance.absent[0]
    assert (vehicle.actuators["n"].lower, vehicle.actuators["n"].upper) == (0.0, pytest.approx(1500 * np.pi / 30))


def test_standard_deviations_hold_all_errors(tmp_path):
    folder, within = finished(tmp_path / "c", wider=3.0), of_campaign(finished(tmp_path / "d"))[0].estimated
    summary = Store(folder).summary
    row = {"name": "X_u", "unit": "kg/s", "label": "", "mean": -1.0, "sd": 0.6, "lower_95": 0.0, "upper_95": 0.0}
    row |= {"cause": "a lag", "inclusion": 0.7}
    content = json.loads(summary.read_text()) | {"averaged": [row], "quoted": "averaged"}
    write_stamped_json(summary, {name: value for name, value in content.items() if name != SEAL}, "any")
    vehicle, provenance = of_campaign(folder)
    np.testing.assert_allclose(vehicle.estimated.sd, 3.0 * within.sd)
    np.testing.assert_allclose(vehicle.estimated.covariance, 9.0 * within.covariance)
    (averaged,) = vehicle.estimated.averaged
    assert astuple(averaged) == ("X_u", -1.0, 0.6, 0.7)
    lines = state(OwnJson(), vehicle, provenance).lines
    assert lines[lines.index(f"to quote: {QUOTED['averaged']}:") + 1] == "  X_u = -1 ± 0.6 kg/s"
    assert provenance.cautions == ()  # what adds most is a note


def test_the_largest_estimated_current_goes_with_the_vehicle(tmp_path):
    _, provenance = of_campaign(finished(tmp_path / "c"))
    assert provenance.current == 0
    folder = finished(tmp_path / "d", beside=("current[1]", "current[2]"))
    vehicle, provenance = of_campaign(folder)
    assert provenance.current == pytest.approx(0.3, rel=0.1)
    assert not any("current" in name for name in vehicle.estimated.names)


def test_the_speeds_of_the_fitted_records_go_with_the_vehicle(tmp_path):
    folder = finished(tmp_path / "c")
    assert of_campaign(folder)[1].speeds is None
    ((label, key),) = record_keys(load_campaign(folder)).items()
    speed = np.append(np.linspace(0.5, 1.5, 1001), np.nan)
    write_dataset(Store(folder).record(label), Dataset({"u": ("time", speed)}), key)
    _, provenance = of_campaign(folder)
    assert provenance.speeds == (pytest.approx(0.51), pytest.approx(1.49))
    _, (path,) = export_to(folder, "json", tmp_path / "out")
    assert read_exported(path)[1].speeds == provenance.speeds


def test_another_structure_says_what_it_drops(tmp_path):
    folder = finished(tmp_path / "c")
    vehicle, provenance = of_campaign(folder, structure="M-1")
    assert provenance.dropped == ("X_u",)
    assert "X_u" not in vehicle.coefficients
    with pytest.raises(InputError, match="one of M-0, M-1"):
        of_campaign(folder, structure="M-9")


def test_the_rest_comes_from_a_published_vehicle(tmp_path):
    folder = finished(tmp_path / "c")
    alone, _ = of_campaign(folder)
    vehicle, provenance = of_campaign(folder, rest="remus100_prestero")
    other, _ = of_catalogue("remus100_prestero")
    assert vehicle.is_whole
    for name, value in other.coefficients.items():
        if name in alone.coefficients:
            assert vehicle.coefficients[name] == alone.coefficients[name]
        elif name == "X_0":
            assert name not in vehicle.coefficients, "a constant thrust beside an estimated propeller is one too many"
        else:
            assert vehicle.coefficients[name] == value
    said = " ".join(provenance.sources)
    assert "remus100_prestero left out, because they act in the motion of the campaign: X_0" in said
    assert vehicle.hull.thrust_deduction == 0.1
    with pytest.raises(InputError, match=r"a mass of 13\.5 kg") as error:
        of_campaign(folder, rest="bluerov2_heavy")
    assert error.value.remedy.startswith("`--fill-from remus100_hall_anstee`, or")


def test_a_whole_campaign_brings_its_own_rest(tmp_path):
    vehicle, provenance = of_campaign(finished(tmp_path / "c", *WHOLE))
    assert vehicle.is_whole
    assert vehicle.moves == RATES
    assert vehicle.coefficients["M_q"] == pytest.approx(-1.0, rel=0.1)
    assert vehicle.coefficients["N_rabsr"] == -94.0
    assert vehicle.coefficients["X_u"] != 0
    assert "motion in u, w, q" in provenance.structure


def test_what_was_found_beside_the_coefficients_goes_along_and_a_delay_is_named_as_lost(tmp_path, monkeypatch):
    """By the means of the posterior; what has no prior is as stated."""
    monkeypatch.setattr(manoeuvre, "DURATION", 1.0)
    sought = {"tether_linear": "log-normal", "net_weight": "normal"}
    numbers = {"log-normal": "median = 5.0\nfactor = 2.0", "normal": "mean = 0.0\nsd = 4.0"}
    priors = "".join(f'[prior.{name}]\ndistribution = "{kind}"\n{numbers[kind]}\n\n' for name, kind in sought.items())
    tether = '[vehicle.tether]\npoint = ["-0.7 m", "0 m", "0.1 m"]\nquadratic = "3 kg/m"\n\n'
    changes = (*WHOLE, ("[structure]", f"{tether}[structure]"), ("[sensors.u]", f"{priors}[sensors.u]"))
    folder = finished(tmp_path / "c", *changes, beside=(*sought, "delay"))
    data = open_dataset(folder / "results" / "posterior" / "M-0.nc")["draws"]
    mean = {name: float(data.sel(parameter=name).values.mean()) for name in sought}
    for rest in (None, "remus100_prestero"):
        vehicle, provenance = of_campaign(folder, rest=rest)
        assert vehicle.hull.tether == Tether((-0.7, 0.0, 0.1), pytest.approx(mean["tether_linear"]), 3.0)
        assert vehicle.hull.weight - vehicle.hull.buoyancy == pytest.approx(mean["net_weight"])
        assert vehicle.numbers["net_weight"].value == mean["net_weight"]
        lines = state(OwnJson(), vehicle, provenance).lines
        (told,) = (line for line in lines if line.startswith("  net_weight = "))
        assert told.endswith(" N")
        assert any(line.startswith("not supported: a delay between command and action: delay = 0.0") for line in lines)
        assert provenance.cautions == ()


def test_results_of_another_configuration_are_refused(tmp_path):
    folder = finished(tmp_path / "c")
    path = folder / "campaign.toml"
    path.write_text(path.read_text().replace("lower = -3.6", "lower = -3.7"))
    load_campaign(folder)
    with pytest.raises(InputError, match="another configuration") as error:
        of_campaign(folder)
    assert "seatrial run" in error.value.remedy


def test_records_of_another_configuration_are_refused_and_none_is_made(tmp_path):
    folder = finished(tmp_path / "c")
    (record,) = (folder / "results" / "records").glob("*.nc")
    record.unlink()
    with pytest.raises(InputError, match="records or a screening of another configuration"):
        of_campaign(folder)
    assert not record.exists()


def test_without_results_the_command_that_makes_them_is_named(tmp_path):
    from tests.campaign.small import write_small

    with pytest.raises(InputError, match="seatrial run"):
        of_campaign(write_small(tmp_path / "c"))


def test_estimates_per_unit_of_an_unknown_mass_have_linear_models_and_no_simulator(tmp_path):
    unknown = ('catalogue = "remus100_surge"', 'mass = "unknown"\ntrim = { u = "1.5 m/s", n = "125 rad/s" }')
    folder = finished(tmp_path / "c", unknown)
    for target in ("json", "gz"):
        with pytest.raises(InputError, match="per unit of an effective mass"):
            export_to(folder, target, tmp_path / "out")
    statement, _ = export_to(folder, "control", tmp_path / "out", speeds=(1.0,), count=16)
    mean = dict(zip(*(getattr(of_campaign(folder)[0].estimated, key) for key in ("names", "mean")), strict=True))
    slope = mean["X_u"] + 2.0 * mean["X_uabsu"]
    (line,) = (line for line in statement.lines if "pole of u" in line)
    assert float(line.split()[4]) == pytest.approx(slope, rel=1e-3), "of an effective mass of 1"
    assert any(line.endswith(" 1/m") and "X_uabsu" in line for line in statement.lines)
