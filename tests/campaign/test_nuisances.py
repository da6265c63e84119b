"""Unknowns beside the coefficients: which parameters a campaign file asks for, and that their posterior can be evaluated."""

import jax
import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.core.errors import InputError
from tests.campaign.small import write_small
from tests.estimation_cases import make_trial, naive_speed

PRIORS = """
[prior.tau_u]
distribution = "log-uniform"
lower = 0.05
upper = 10.0

[prior.lag_u]
distribution = "log-uniform"
lower = 0.05
upper = 5.0

[prior.bias_u]
distribution = "normal"
mean = 0.0
sd = 0.2

[prior.current]
distribution = "normal"
mean = 0.0
sd = 0.3

[prior.drift_u]
distribution = "log-uniform"
lower = 1e-3
upper = 1.0

[prior.drift_time_u]
distribution = "log-uniform"
lower = 0.1
upper = 30.0

[prior.process_u]
distribution = "log-uniform"
lower = 1e-4
upper = 0.1

[prior.disturbance_X]
distribution = "log-uniform"
lower = 0.01
upper = 10.0

[prior.disturbance_time_X]
distribution = "log-uniform"
lower = 0.05
upper = 20.0

[prior.spread_X_uabsu]
distribution = "uniform"
lower = 0.0
upper = 1.0

[truth]"""
SENSOR, ESTIMATION = '[sensors.u]\nnoise = "0.05 m/s"', "[estimation]\n"
COEFFICIENTS = ["X_uabsu", "T_nabsn", "X_u"]
ASKED = {
    "white": ("", "", ["sigma_u"]),
    "coloured": ("", 'residuals = "coloured"', ["sigma_u", "tau_u"]),
    "drifting": ("", 'residuals = "drifting"', ["sigma_u", "drift_u", "drift_time_u"]),
    "heavy": ('residuals = "heavy"', "", ["sigma_u", "dof_u"]),
    "lag": ("lag = true", "", ["sigma_u", "lag_u"]),
    "shared bias": ('bias = "shared"', "", ["sigma_u", "bias_u"]),
    "own bias": ('bias = "own"', "", ["sigma_u", "bias_u[a]", "bias_u[b]"]),
    "current": ("", 'current = "shared"', ["current", "sigma_u"]),
    "own current": ("", 'current = "own"', ["current[a]", "current[b]", "sigma_u"]),
    "varying": ("", 'varying = ["X_uabsu"]', ["spread_X_uabsu", "sigma_u", "dev_X_uabsu[a]", "dev_X_uabsu[b]"]),
    "free start": ("", 'initial = "estimated"', ["sigma_u", "u_0[a]", "u_0[b]"]),
    "filter error": ("", 'likelihood = "filter-error"', ["sigma_u", "process_u"]),
    "filter error, own bias": (
        'bias = "own"',
        'likelihood = "filter-error"',
        ["sigma_u", "bias_u[a]", "bias_u[b]", "process_u"],
    ),
    "disturbance": (
        "",
        'likelihood = "filter-error"  # with a disturbance',
        ["sigma_u", "process_u", "disturbance_X", "disturbance_time_X"],
    ),
    "disturbance alone, coefficients that vary": (
        "",
        'varying = ["X_uabsu"]\nlikelihood = "filter-error"  # a disturbance alone',
        ["spread_X_uabsu", "sigma_u", "disturbance_X", "disturbance_time_X", "dev_X_uabsu[a]", "dev_X_uabsu[b]"],
    ),
}


def campaign(folder, sensor, estimation):
    """The small campaign with these lines, and the priors it then needs."""
    wanted = [part for part in PRIORS.split("\n\n") if not part.startswith(("[prior", "\n[prior"))]
    for part in PRIORS.strip().split("\n\n"):
        name = part.splitlines()[0].removeprefix("[prior.").rstrip("]")
        used = {
            "tau_u": "coloured" in sensor + estimation,
            "drift_u": "drifting" in estimation,
            "drift_time_u": "drifting" in estimation,
            "lag_u": "lag" in sensor,
            "bias_u": "bias" in sensor,
            "current": "current" in estimation,
            "process_u": "filter-error" in estimation and "alone" not in estimation,
            "disturbance_X": "disturbance" in estimation,
            "disturbance_time_X": "disturbance" in estimation and "no time" not in estimation,
            "spread_X_uabsu": "varying" in estimation,
        }
        if used.get(name):
            wanted.insert(0, part)
    return write_small(
        folder,
        (SENSOR, f"{SENSOR}\n{sensor}"),
        (ESTIMATION, f"{ESTIMATION}{estimation}\n"),
        ("[truth]", "\n\n".join(wanted)),
    )


def records():
    rng = np.random.default_rng(2)
    rev = rng.uniform(15, 25, 80)
    speed = naive_speed(rev, np.full(80, 0.1), thrust=6.28e-4 * (2 * np.pi) ** 2)
    return [make_trial(np.arange(80) * 0.1, rev, label, u=speed + 0.05 * rng.normal(size=80)) for label in "ab"]


def asked_for(name, folder):
    sensor, estimation, expected = ASKED[name]
    loaded = load_campaign(campaign(folder, sensor, estimation))
    return build_posterior(loaded, loaded.structures[0], records()), sorted(COEFFICIENTS + expected)


@pytest.mark.parametrize("name", ASKED)
def test_parameters_asked_for(tmp_path, name):
    posterior, expected = asked_for(name, tmp_path)
    assert sorted(posterior.names) == expected


MOST = "own bias", "varying", "disturbance"
"""Those that are computed each time; the others are proofs."""


@pytest.mark.parametrize("name", [pytest.param(one, marks=[pytest.mark.proof] * (one not in MOST)) for one in ASKED])
def test_where_the_prior_lies_there_is_a_density(tmp_path, name):
    posterior, _ = asked_for(name, tmp_path)
    densities = np.asarray(jax.jit(jax.vmap(posterior.log_density))(posterior.sample_prior(jax.random.key(0), 20)))
    assert np.isfinite(densities).any()
    assert not np.isnan(densities).any()


MISTAKES = {
    "a current and a bias": ('bias = "shared"', 'current = "shared"', "look alike"),
    "filter error with a lag": ("lag = true", 'likelihood = "filter-error"', "a lag"),
    "a disturbance without filter error": ("", "# a disturbance", 'set estimation.likelihood = "filter-error"'),
    "a disturbance without its time": ("", 'likelihood = "filter-error"  # disturbance, no time', "disturbance_time_X"),
    "varying what is no coefficient": ("", 'varying = ["X_w"]', "estimation.varying"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_what_is_refused(tmp_path, name):
    sensor, estimation, said = MISTAKES[name]
    folder = campaign(tmp_path, sensor, estimation)

    def build():
        loaded = load_campaign(folder)
        return build_posterior(loaded, loaded.structures[0], records())

    with pytest.raises(InputError, match=said):
        build()


def test_a_missing_prior_is_named(tmp_path):
    with pytest.raises(InputError, match=r"prior\.lag_u"):
        load_campaign(write_small(tmp_path, (SENSOR, f"{SENSOR}\nlag = true")))


@pytest.mark.parametrize(
    ("name", "said"), [("disturbance_Y", "the axis Y, which does not move"), ("disturbance_time_Q", '"Q"')]
)
def test_a_disturbance_on_no_axis_that_moves(tmp_path, name, said):
    folder = campaign(tmp_path, "", 'likelihood = "filter-error"')
    path = folder / "campaign.toml"
    path.write_text(path.read_text().replace("[prior.process_u]", f"[prior.{name}]"))
    with pytest.raises(InputError, match=said):
        load_campaign(folder)


def test_a_spread_below_zero_is_refused(tmp_path):
    folder = campaign(tmp_path, "", 'varying = ["X_uabsu"]')
    path = folder / "campaign.toml"
    path.write_text(path.read_text().replace("lower = 0.0\nupper = 1.0", "lower = -1.0\nupper = 1.0"))
    with pytest.raises(InputError, match="below 0"):
        load_campaign(folder)
