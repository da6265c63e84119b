"""A key that nothing reads is refused, with what makes it idle; the same key where it is read is not."""

import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import import_trials
from seatrial.core.errors import InputError
from tests.campaign.small import SMALL, write_small
from tests.campaign.test_whole_vehicle import BY_HAND, OF_ALL, pitch
from tests.campaign.yaw_campaign import write_yaw

CATALOGUE, STRUCTURE = 'catalogue = "remus100_surge"', 'always = ["X_uabsu", "T_nabsn"]'
OWN = 'mass = "30.5 kg"\nthrust_deduction = 0.1\nfixed = { X_udot = -0.93 }'
TRIM = 'trim = { u = "1.5 m/s", n = "1200 rpm" }'
WHOLE = 'catalogue = "remus100_prestero"\nmoves = ["w", "q"]\nmeasured_inputs = ["u"]\npublished_prior_sd = "20 %"\n'
SURGE = {
    "vehicle.thrust_deduction": [(CATALOGUE, f"{CATALOGUE}\nthrust_deduction = 0.2")],
    "vehicle.fixed": [(CATALOGUE, f"{CATALOGUE}\nfixed = {{}}")],
    "vehicle.published_prior_sd": [(CATALOGUE, f'{CATALOGUE}\npublished_prior_sd = "20 %"')],
    "structure.shortlist": [(STRUCTURE, f"{STRUCTURE}\nshortlist = 3")],
    "structure.g": [(STRUCTURE, f"{STRUCTURE}\ng = 10.0")],
    "design.probability": [('control = "n"', 'control = "n"\nprobability = 0.9')],
    "truth.current": [("X_u = -1.21", "X_u = -1.21\ncurrent = 0.2"), ("[limits.n]", 'reference = "water"\n[limits.n]')],
    "design.over": [('control = "n"', 'control = "n"\nover = "worst"')],
}
READ = {
    "thrust": [(CATALOGUE, f"{OWN}\n{TRIM}")],
    "published coefficients": [
        (CATALOGUE, f'{CATALOGUE}\npublished_prior_sd = "20 %"'),
        ('[prior.X_u]\ndistribution = "uniform"\nlower = -3.6\nupper = 1.2\n', ""),
    ],
    "limits of the motion": [
        ('control = "n"', 'control = "n"\nprobability = 0.9'),
        ("[design]", '[limits.distance]\nupper = "500 m"\n[design]'),
    ],
    "a current": [("X_u = -1.21", "X_u = -1.21\ncurrent = 0.2")],
    "the worst draw": [('control = "n"', 'control = "n"\nover = "worst"\nutility = "fisher-d"')],
}


def refused(load, *about):
    with pytest.raises(InputError) as caught:
        load(*about)
    return caught.value


@pytest.mark.parametrize("key", SURGE)
def test_a_key_without_effect_is_refused(tmp_path, key):
    error = refused(load_campaign, write_small(tmp_path, *SURGE[key]))
    text = (tmp_path / "campaign.toml").read_text().splitlines()
    line = [number for number, one in enumerate(text, 1) if one not in SMALL][-1]
    assert error.where.endswith(f"campaign.toml:{line}, key {key}")
    assert "remove" in error.remedy


@pytest.mark.parametrize("name", READ)
def test_the_same_key_with_an_effect_is_taken(tmp_path, name):
    load_campaign(write_small(tmp_path, *READ[name]))


@pytest.mark.parametrize("value", ["nan", "2.0", "-0.1"])
def test_a_share_of_the_thrust_that_is_none(tmp_path, value):
    own = OWN.replace("= 0.1", f"= {value}")
    error = refused(load_campaign, write_small(tmp_path, (CATALOGUE, f"{own}\n{TRIM}")))
    assert error.where.endswith("campaign.toml:8, key vehicle.thrust_deduction")


def test_an_axis_that_nothing_is_sought_on(tmp_path):
    folder = write_yaw(tmp_path)
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text.replace("[structure]", "fixed = { K_p = -1.0 }\n[structure]"))
    error = refused(load_campaign, folder)
    assert error.where.endswith("campaign.toml:7, key vehicle.fixed.K_p")
    assert "axis K" in error.found
    (folder / "campaign.toml").write_text(text.replace("[structure]", "fixed = { N_rdot = -0.5 }\n[structure]"))


@pytest.mark.parametrize(
    ("key", "changes"),
    {
        "vehicle.wake": [(WHOLE, f"{WHOLE}wake = 0.2\n")],
        "vehicle.actuators": [(WHOLE, BY_HAND.replace("moves", 'actuators = "published"\nmoves')), OF_ALL],
    }.items(),
)
def test_keys_of_a_whole_vehicle(tmp_path, key, changes):
    error = refused(pitch, tmp_path, *changes)
    assert f"key {key}" in error.where


def test_an_attitude_of_what_does_not_turn(tmp_path):
    whole = 'catalogue = "remus100_prestero"\nmoves = ["u"]\nattitude = "euler"\n' + TRIM
    error = refused(load_campaign, write_small(tmp_path, (CATALOGUE, whole)))
    assert error.where.endswith("campaign.toml:9, key vehicle.attitude")


def test_the_layout_of_text_where_the_log_is_none(tmp_path):
    folder = write_yaw(tmp_path)
    for run in "12":
        (folder / f"zigzag_{run}.csv").write_bytes(b"PAR1 and so on")
    text = (folder / "campaign.toml").read_text().replace("[[import.files]]", "[[import.files]]\nskip_rows = 2")
    (folder / "campaign.toml").write_text(text)
    error = refused(import_trials, load_campaign(folder))
    assert error.where.endswith(
        f"campaign.toml:{text.splitlines().index('skip_rows = 2') + 1}, key import.files[0].skip_rows"
    )
    assert "a Parquet file" in error.found
