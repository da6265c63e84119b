"""The form of the model writes noise, terms and priors into the campaign file; comments and what it does not know stay."""

import tomllib

import pytest

from seatrial.core.errors import InputError
from seatrial.dashboard.model_edits import Range, with_noise, with_priors, with_sizes, with_terms
from seatrial.dashboard.model_queries import check, model_data
from tests.campaign.small import SMALL, write_small

COMMENTED = SMALL.replace(
    'always = ["X_uabsu", "T_nabsn"]\noptional = ["X_u"]',
    'always = [\n  "X_uabsu",  # drag\n  # of the propeller\n  "T_nabsn",\n]\noptional = ["X_u"]  # to be seen',
).replace("[estimation]\n", "# the fit\n[estimation]\n")
TAU = Range("tau_u", "0.05", "10", "", "log-uniform")


def test_coloured_noise_and_back(tmp_path):
    text = with_noise(tmp_path, COMMENTED, {"": "coloured"})
    with pytest.raises(InputError, match=r"a prior of tau_u, SI unit s"):
        check(str(tmp_path), text)
    text = with_priors(tmp_path, text, [TAU], [])
    check(str(tmp_path), text)
    assert tomllib.loads(text)["prior"]["tau_u"] == {"distribution": "log-uniform", "lower": 0.05, "upper": 10.0}
    assert all(f"{line}\n" in text for line in COMMENTED.splitlines())

    text = with_noise(tmp_path, text, {"": "white"})
    with pytest.raises(InputError, match=r"remove \[prior.tau_u\], of coloured residuals: those of u are white"):
        check(str(tmp_path), text)
    text = with_priors(tmp_path, text, [], ["tau_u"])
    check(str(tmp_path), text)
    assert "# [prior.tau_u]\n# distribution" in text


def test_the_noise_of_one_sensor(tmp_path):
    text = with_noise(tmp_path, COMMENTED, {"u": "heavy"})
    assert tomllib.loads(text)["sensors"]["u"]["residuals"] == "heavy"
    assert with_noise(tmp_path, text, {"u": ""}).split() == COMMENTED.split()


def test_the_size_of_the_chains(tmp_path):
    text = with_sizes(tmp_path, COMMENTED, {"warmup": "1000", "draws": "3000"})
    found = tomllib.loads(text)["estimation"]
    assert (found["warmup"], found["draws"]) == (1000, 3000)
    with pytest.raises(InputError, match="a whole number"):
        with_sizes(tmp_path, COMMENTED, {"draws": "many"})
    with pytest.raises(InputError, match="multiple of 100"):
        check(str(tmp_path), with_sizes(tmp_path, COMMENTED, {"draws": "1050"}))


def test_terms_change_their_places_and_comments_stay(tmp_path):
    text = with_terms(tmp_path, COMMENTED, ["X_uabsu", "T_nabsn", "X_u"], ["X_uu"])
    text = with_priors(tmp_path, text, [Range("X_uu", "-1", "0", "g/cm")], [])
    (said,) = check(str(tmp_path), text)
    assert said.startswith("X_uabsu and X_uu differ only where u changes its sign")
    content = tomllib.loads(text)
    assert content["structure"] == {"always": ["X_uabsu", "T_nabsn", "X_u"], "optional": ["X_uu"]}
    assert content["prior"]["X_uu"] == {"distribution": "uniform", "lower": -1.0, "upper": 0.0, "unit": "g/cm"}
    for comment in ("# drag", "# of the propeller", "# to be seen", "# the fit"):
        assert comment in text


@pytest.mark.parametrize(("lower", "found"), [("", "nothing"), ("-1,5", '"-1,5"'), ("inf", '"inf"')])
def test_an_end_that_is_no_number_is_refused(tmp_path, lower, found):
    with pytest.raises(InputError) as caught:
        with_priors(tmp_path, COMMENTED, [Range("X_uu", lower, "0", "")], [])
    assert (caught.value.where, caught.value.found) == ("prior.X_uu.lower", found)


def test_what_each_kind_of_noise_needs_is_known(tmp_path):
    found = model_data(str(write_small(tmp_path)))
    assert (found.residuals, found.always, found.optional) == ("white", ("X_uabsu", "T_nabsn"), ("X_u",))
    assert found.priors["X_u"] == "uniform, lower -3.6, upper 1.2"
    (sensor,) = found.sensors
    needed = {kind: [one.name for one in some if one.is_needed] for kind, some in sensor.priors.items()}
    assert needed == {"white": [], "coloured": ["tau_u"], "heavy": [], "drifting": ["drift_u", "drift_time_u"]}
    for kind, some in sensor.priors.items():
        new = [Range(one.name, one.lower, one.upper, "", "log-uniform") for one in some if one.is_needed]
        check(str(tmp_path), with_priors(tmp_path, with_noise(tmp_path, SMALL, {"": kind}), new, []))
