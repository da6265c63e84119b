"""The form of the model asks for terms, priors, noise and chains, and writes the answers; comments and what it does not know stay."""

import tomllib

import pytest

from seatrial.core.errors import InputError
from seatrial.dashboard.model_queries import asked_of_model, edited, limits_form, model_form
from tests.campaign.small import SMALL, write_small

COMMENTED = SMALL.replace("[estimation]\n", "# the fit\n[estimation]\n")


def test_questions_have_meanings_choices_and_defaults(tmp_path):
    text, questions = model_form(str(write_small(tmp_path)))
    assert text == (tmp_path / "campaign.toml").read_text()
    of = {one.key: one for one in questions}
    assert of["structure.always"].value == "X_uabsu, T_nabsn"
    residuals = of["estimation.residuals"]
    assert (residuals.value, residuals.default, residuals.choices[1]) == ("", "white", "coloured")
    assert "](" not in residuals.meaning
    assert of["prior.X_u.lower"].value == "-3.6"
    assert of["prior.X_u.unit"].value == ""


@pytest.mark.parametrize(("kind", "priors"), [("coloured", ["tau_u"]), ("heavy", []), ("drifting", [])])
def test_noise_gets_the_priors_that_it_needs_and_loses_them_again(tmp_path, kind, priors):
    text, _ = edited(str(tmp_path), COMMENTED, (("estimation.residuals", kind),))
    added = tomllib.loads(text)["prior"].keys() - tomllib.loads(COMMENTED)["prior"].keys()
    assert added == {*priors}
    assert all(f"{line}\n" in text for line in COMMENTED.splitlines())
    keys = {one.key for one in asked_of_model(COMMENTED, (("estimation.residuals", kind),))}
    assert {f"prior.{name}.upper" for name in priors} <= keys
    text, _ = edited(str(tmp_path), text, (("estimation.residuals", "white"),))
    assert not {*priors} & tomllib.loads(text)["prior"].keys()
    assert all(f"# [prior.{name}]\n" in text for name in priors)


def test_the_noise_of_one_sensor(tmp_path):
    text, _ = edited(str(tmp_path), COMMENTED, (("sensors.u.residuals", "heavy"),))
    assert tomllib.loads(text)["sensors"]["u"]["residuals"] == "heavy"
    assert edited(str(tmp_path), text, (("sensors.u.residuals", ""),))[0].split() == COMMENTED.split()


def test_the_size_of_the_chains(tmp_path):
    text, _ = edited(str(tmp_path), COMMENTED, (("estimation.warmup", "1000"), ("estimation.draws", "3000")))
    chains = tomllib.loads(text)["estimation"]
    assert (chains["warmup"], chains["draws"]) == (1000, 3000)
    for typed, words in (("many", "integer"), ("1050", "multiple of 100")):
        with pytest.raises(InputError, match=words) as caught:
            edited(str(tmp_path), COMMENTED, (("estimation.draws", typed),))
        assert "key estimation.draws" in caught.value.where


def test_terms_change_their_places_and_new_ones_get_priors(tmp_path):
    answers = (
        ("structure.always", "X_uabsu, T_nabsn, X_u"),
        ("structure.optional", "X_uu"),
        ("prior.X_uu.lower", "-2"),
        ("prior.X_uu.unit", "g/cm"),
    )
    text, (caution,) = edited(str(tmp_path), COMMENTED, answers)
    assert caution.startswith("X_uabsu and X_uu differ only when u changes its sign")
    content = tomllib.loads(text)
    assert content["structure"] == {"always": ["X_uabsu", "T_nabsn", "X_u"], "optional": ["X_uu"]}
    assert content["prior"]["X_uu"] == {"distribution": "uniform", "lower": -2, "upper": 0.0, "unit": "g/cm"}
    assert "# the fit" in text
    with pytest.raises(InputError, match="X_foo"):
        edited(str(tmp_path), COMMENTED, (("structure.optional", "X_foo"),))


def test_a_distribution_is_chosen_and_its_numbers_are_asked_for():
    keys = {one.key for one in asked_of_model(COMMENTED, (("prior.X_u.distribution", "normal"),))}
    assert {"prior.X_u.mean", "prior.X_u.sd"} <= keys
    keys = {one.key for one in asked_of_model(COMMENTED, (("prior.X_u.distribution", ""),))}
    assert not any(key.startswith("prior.X_u.") for key in keys)


@pytest.mark.parametrize(("lower", "words"), [("-1,5", "number"), ("inf", "inf")])
def test_an_end_that_is_no_number_is_refused(tmp_path, lower, words):
    with pytest.raises(InputError, match=words) as caught:
        edited(str(tmp_path), COMMENTED, (("prior.X_u.lower", lower),))
    assert "prior.X_u.lower" in caught.value.where


def test_every_signal_may_be_limited_and_controls_may_have_a_rate(tmp_path):
    text, questions = limits_form(str(write_small(tmp_path)))
    of = {one.key: one for one in questions}
    assert of["limits.n.upper"].value == "1500 rpm"
    assert of["limits.n.rate"].default.startswith("none; such as 1 rpm/s")
    assert "limits.u.rate" not in of
    assert of["limits.u.upper"].default == "none; such as 1 m/s"
    new, _ = edited(str(tmp_path), text, (("limits.n.upper", "1400 rpm"), ("limits.u.upper", "3 m/s")))
    limits = tomllib.loads(new)["limits"]
    assert (limits["n"]["upper"], limits["u"]) == ("1400 rpm", {"upper": "3 m/s"})
    with pytest.raises(InputError, match=r"key limits\.n\.upper"):
        edited(str(tmp_path), text, (("limits.n.upper", "1500 kg"),))
