"""Unknowns beside the coefficients: which parameters a campaign file asks for, and what is refused."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.core.errors import InputError
from tests.campaign.small import write_small
from tests.campaigns import log_uniform, normal, priors, uniform
from tests.estimation_cases import make_trial, naive_speed

PRIORS = {
    "tau_u": ("coloured", log_uniform(0.05, 10.0)),
    "lag_u": ("lag", log_uniform(0.05, 5.0)),
    "bias_u": ("bias", normal(0.0, 0.2)),
    "current": ("current", normal(0.0, 0.3)),
    "drift_u": ("drifting", log_uniform(1e-3, 1.0)),
    "drift_time_u": ("drifting", log_uniform(0.1, 30.0)),
    "process_u": ("filter-error", log_uniform(1e-4, 0.1)),
    "disturbance_X": ("disturbance", log_uniform(0.01, 10.0)),
    "disturbance_time_X": ("disturbance", log_uniform(0.05, 20.0)),
    "spread_X_uabsu": ("varying", uniform(0.0, 1.0)),
}
"""Each with the word of the lines that need it."""
SENSOR, ESTIMATION = '[sensors.u]\nnoise = "0.05 m/s"', "[estimation]\n"
COEFFICIENTS = ["X_uabsu", "T_nabsn", "X_u"]
ASKED = {
    "white": ("", "", ["sigma_u"]),
    "coloured": ("", 'residuals = "coloured"', ["sigma_u", "tau_u"]),
    "drifting": ("", 'residuals = "drifting"', ["sigma_u", "drift_u", "drift_time_u"]),
    "heavy": ('residuals = "heavy"', "", ["sigma_u", "dof_u"]),
    "proportional": ('residuals = "proportional"', "", ["sigma_u", "share_u"]),
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
    lines = f"{sensor}\n{estimation}"
    needed = {name: prior for name, (word, prior) in PRIORS.items() if word in lines}
    for name, word in (("process_u", "alone"), ("disturbance_time_X", "no time")):
        if word in lines:
            needed.pop(name, None)
    return write_small(
        folder,
        (SENSOR, f"{SENSOR}\n{sensor}"),
        (ESTIMATION, f"{ESTIMATION}{estimation}\n"),
        ("[truth]", f"{priors(**needed)}\n\n[truth]"),
    )


def records():
    rng = np.random.default_rng(2)
    rev = rng.uniform(15, 25, 80)
    speed = naive_speed(rev, np.full(80, 0.1), thrust=6.28e-4 * (2 * np.pi) ** 2)
    return [make_trial(np.arange(80) * 0.1, rev, label, u=speed + 0.05 * rng.normal(size=80)) for label in "ab"]


@pytest.mark.parametrize("name", ASKED)
def test_posterior_has_the_parameters_that_the_file_asks_for(tmp_path, name):
    sensor, estimation, expected = ASKED[name]
    loaded = load_campaign(campaign(tmp_path, sensor, estimation))
    posterior = build_posterior(loaded, loaded.structures[0], records())
    assert sorted(posterior.names) == sorted(COEFFICIENTS + expected)


MISTAKES = {
    "a current and a bias": ('bias = "shared"', 'current = "shared"', "look alike"),
    "filter error with a lag": ("lag = true", 'likelihood = "filter-error"', "a lag"),
    "a disturbance without filter error": ("", "# a disturbance", 'set estimation.likelihood = "filter-error"'),
    "a disturbance without its time": ("", 'likelihood = "filter-error"  # disturbance, no time', "disturbance_time_X"),
    "varying what is no coefficient": ("", 'varying = ["X_w"]', "estimation.varying"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_unknowns_that_exclude_each_other_are_refused(tmp_path, name):
    sensor, estimation, said = MISTAKES[name]
    folder = campaign(tmp_path, sensor, estimation)
    with pytest.raises(InputError, match=said):
        build_posterior(load_campaign(folder), load_campaign(folder).structures[0], records())


@pytest.mark.parametrize(
    ("name", "said"), [("disturbance_Y", "the axis Y, which does not move"), ("disturbance_time_Q", '"Q"')]
)
def test_a_disturbance_on_no_axis_that_moves(tmp_path, name, said):
    folder = campaign(tmp_path, "", 'likelihood = "filter-error"')
    path = folder / "campaign.toml"
    path.write_text(path.read_text().replace("[prior.process_u]", f"[prior.{name}]"))
    with pytest.raises(InputError, match=said):
        load_campaign(folder)
