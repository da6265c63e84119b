"""Inference that cannot be trusted or made: what is said names the place, what was found and what to do."""

import re
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.cli.main import main
from seatrial.cli.running import Exit
from seatrial.core.errors import InputError, NumericalError
from seatrial.estimation.diagnostics.prior_checks import prior_excluding_data, prior_findings
from seatrial.estimation.posterior import mode as mode_module
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.priors import Normal, Uniform
from seatrial.messages.render import remedy, sentence
from seatrial.sampling.diagnostics import ChainHealth, chain_findings
from tests.campaign.small import write_small
from tests.campaign.test_nuisances import ESTIMATION, SENSOR, campaign, records
from tests.estimation_cases import posterior

KEY = jax.random.key(0)
XU = '[prior.X_u]\ndistribution = "uniform"\nlower = -3.6\nupper = 1.2'
UNUSABLE = {
    "lower = -1e308\nupper = 1e308": "a standard deviation of inf kg/s",
    "lower = -1e200\nupper = 0.0": "a standard deviation of 2.89e+199 kg/s",
    "lower = -3.0\nupper = -2.9999999999999996": "which leaves nothing to estimate",
}
UNGIVEN = {
    "bias_u": ('bias = "shared"', "", "sensors.u.bias"),
    "lag_u": ("lag = true", "", "sensors.u.lag"),
    "tau_u": ('residuals = "coloured"', "", "coloured"),
    "current": ("", 'current = "own"', "estimation.current"),
    "process_u": ("", 'likelihood = "filter-error"', "estimation.likelihood"),
    "spread_X_uabsu": ("", 'varying = ["X_uabsu"]', "estimation.varying"),
}


@pytest.mark.parametrize("numbers", UNUSABLE)
def test_a_prior_that_cannot_be_computed_with_is_refused(tmp_path, numbers):
    loaded = load_campaign(write_small(tmp_path, (XU, f'[prior.X_u]\ndistribution = "uniform"\n{numbers}')))
    with pytest.raises(InputError) as caught:
        build_posterior(loaded, loaded.structures[0], records())
    assert caught.value.where.endswith("campaign.toml:13, key prior.X_u")
    assert UNUSABLE[numbers] in caught.value.found


@pytest.mark.parametrize("name", UNGIVEN)
def test_a_prior_that_is_missing_says_why_it_is_needed_and_gives_one(tmp_path, name):
    sensor, estimation, because = UNGIVEN[name]
    folder = write_small(tmp_path, (SENSOR, f"{SENSOR}\n{sensor}"), (ESTIMATION, f"{ESTIMATION}{estimation}\n"))
    with pytest.raises(InputError) as caught:
        load_campaign(folder)
    assert caught.value.where.endswith(f"key prior.{name}")
    assert because in caught.value.found
    assert f"add a section [prior.{name}], for example with distribution = " in caught.value.remedy


def test_all_missing_priors_are_named_at_once(tmp_path):
    other = f'{SENSOR}\n[sensors.udot]\nnoise = "0.1 m/s^2"'
    folder = write_small(tmp_path, (SENSOR, other), (ESTIMATION, f'{ESTIMATION}residuals = "coloured"\n'))
    with pytest.raises(InputError) as caught:
        load_campaign(folder)
    assert "a prior of tau_u, SI unit s, and of tau_udot, SI unit s" in caught.value.expected
    for name in ("tau_u", "tau_udot"):
        assert f"a section [prior.{name}], for example with distribution = " in caught.value.remedy
    bare = write_small(tmp_path / "bare", (XU, ""), ('always = ["X_uabsu", ', 'always = ["X_uabsu", "X_uuu", '))
    with pytest.raises(InputError, match=r"add \[prior.X_uuu\] and \[prior.X_u\], each with distribution"):
        load_campaign(bare)


def test_a_prior_of_a_term_that_was_removed_is_to_be_deleted(tmp_path):
    folder = write_small(tmp_path, ('optional = ["X_u"]', "optional = []"), ("X_u = -1.21\n", ""))
    with pytest.raises(InputError) as caught:
        load_campaign(folder)
    assert caught.value.where.endswith("key prior.X_u")
    assert caught.value.remedy == "delete the table, or name X_u under always or optional of [structure]"


def test_a_spread_between_trials_needs_two(tmp_path):
    loaded = load_campaign(campaign(tmp_path, "", 'varying = ["X_uabsu"]'))
    with pytest.raises(InputError, match=r"(?s)estimation\.varying.*one trial, \"a\".*remove `varying`"):
        build_posterior(loaded, loaded.structures[0], records()[:1])


def test_a_sensor_that_a_likelihood_cannot_use_is_refused_with_the_file(tmp_path):
    loaded = load_campaign(campaign(tmp_path, 'residuals = "heavy"', 'likelihood = "filter-error"'))
    with pytest.raises(InputError, match=r"campaign\.toml: filter error, sensor u"):
        build_posterior(loaded, loaded.structures[0], records())


def quadratic(values, data):
    """Normal likelihood that is NaN beyond an edge of the first parameter; all tests share what is compiled."""
    centre, sd, edge = data
    x = jnp.stack(list(values.values()))
    return jnp.where(x[0] > edge, jnp.nan, -0.5 * jnp.sum(((x - centre) / sd) ** 2))


def fitted(prior, centre, sd=0.1, edge=1e9, name="X_u"):
    data = tuple(jnp.asarray(x, float) for x in ([centre, 0.2], sd, edge))
    target = posterior({name: prior, "b": Uniform(-1.0, 1.0)}, quadratic, data)
    return target, find_mode(target, key=KEY)


def cautions(target, mode):
    draws = mode.values + mode.sd * np.random.default_rng(0).normal(size=(4000, 2))
    return prior_findings(target, mode, draws)


def test_a_size_may_be_next_to_nothing_but_not_negative():
    assert prior_excluding_data(*fitted(Uniform(0.0, 1.0), -1.0, name="sigma_u")) is None


def test_noise_against_its_upper_bound_points_to_the_channel():
    finding = prior_excluding_data(*fitted(Uniform(0.0, 1.0), 2.0, name="sigma_u"))
    assert re.match(r'check units.*residuals = "heavy"', remedy(finding))


def test_a_lag_against_its_lower_bound_is_none():
    finding = prior_excluding_data(*fitted(Uniform(1.0, 2.0), 0.2, sd=0.05, name="lag_u"))
    assert remedy(finding).startswith("set sensors.u.lag = false and remove this prior")


def test_prior_and_data_that_contradict_each_other():
    (found,) = cautions(*fitted(Normal(0.0, 1.0), 9.0, sd=0.5))
    assert (found.code, found.subject) == ("prior-contradicted", ("X_u",))
    assert found.values["value"] == pytest.approx(7.2, abs=0.01)
    assert cautions(*fitted(Normal(0.0, 1.0), 2.0)) == []


def test_a_sharp_posterior_near_the_end_of_a_wide_box_does_not_lean_on_it():
    assert cautions(*fitted(Uniform(-20.0, 2000.0), -3.0)) == []


def test_where_the_likelihood_is_nan_is_said_with_the_parameters():
    """A quarter of the prior, beyond 0.5."""
    target, mode = fitted(Uniform(-1.0, 1.0), -0.3, edge=0.5)
    assert mode.values == pytest.approx([-0.3, 0.2], abs=0.01)
    (found,) = cautions(target, mode)
    assert found.code == "prior-not-simulated"
    assert found.values["share"] == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / 512))
    assert 0.5 < dict(found.values["example"])["X_u"] < 1.0
    assert (found.values["parameter"], found.values["is_above"]) == ("X_u", True)
    assert found.values["value"] == pytest.approx(0.5, abs=0.05)


def test_where_the_likelihood_is_nan_everywhere_a_point_is_given():
    with pytest.raises(
        NumericalError, match=r"none of 512 draws .* for example at X_u = -?0\.\d+, b = -?0\.\d+\. Narrow"
    ):
        fitted(Uniform(-1.0, 1.0), 0.0, edge=-2.0)


def test_a_start_without_derivatives_does_not_lose_the_others(monkeypatch):
    real, ways = mode_module._maximise, []

    def first_is_lost(target, start, *tops):
        ways.append(start)
        if len(ways) == 1:
            raise NumericalError("no derivative at X_u = 0")
        return real(target, start, *tops)

    monkeypatch.setattr(mode_module, "_maximise", first_is_lost)
    assert fitted(Uniform(-1.0, 1.0), -0.3)[1].values == pytest.approx([-0.3, 0.2], abs=0.01)
    assert len(ways) > 1


def test_one_sentence_for_each_kind_of_fault():
    column = dict.fromkeys(ChainHealth._fields, np.ones(5))
    health = ChainHealth(
        **column
        | {
            "r_hat": np.array([np.nan, 1.05, 1.2, 1.0, 1.0]),
            "ess_bulk": np.array([1.0, 10, 10, 90, 500]),
            "ess_tail": np.full(5, 150.0),
        }
    )
    still, apart, few = map(sentence, chain_findings(tuple("abcde"), health))
    assert still.startswith("the chains of a never moved")
    assert apart.startswith("the chains disagree about b and c (R-hat 1.200, at most 1.01). Double warm-up and draws")
    assert few.startswith(
        "too few independent draws of d and e (90 effective, at least 400). Ask for more draws, 5 times as many"
    )


@pytest.mark.proof
def test_chains_too_short_are_kept_and_alarm(monkeypatch, capsys, tmp_path):
    """Two chains of a hundred draws: the result is there, the exit code says that it is not to be trusted."""
    short = 'sampler = "adaptive-metropolis"\nchains = 2\nwarmup = 100\ndraws = 100'
    write_small(
        tmp_path,
        ("chains = 16\nwarmup = 500\ndraws = 1000", short),
        ('always = ["X_uabsu", "T_nabsn"]\noptional = ["X_u"]', 'always = ["X_uabsu", "T_nabsn", "X_u"]'),
    )
    monkeypatch.setattr(sys, "argv", ["seatrial", "estimate", str(tmp_path), "--quiet"])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err
    assert ended.value.code == Exit.ALARMS
    assert "alarm: " in said
    assert "Double warm-up and draws" in said
    assert (tmp_path / "results" / "posterior" / "M-0.nc").is_file()
