"""Steps that are too long for a fit are reported with the shift of each parameter, which a fit in short steps confirms."""

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import get_trials
from seatrial.campaign.inference.modes import long_steps
from seatrial.campaign.inference.posterior import build_posterior
from seatrial.estimation.posterior.mode import find_mode
from seatrial.estimation.posterior.step_shift import step_shift
from tests.campaign.test_check import CAMPAIGN

FINE, AVERAGED = 0.02, 5
NOISE = 0.004


def fitted(folder, step):
    """Posterior, mode and record of a 30 kg vehicle whose speed follows its force within 0.3 s, logged at 50 Hz."""
    rng = np.random.default_rng(3)
    force = np.repeat(rng.choice([-10.0, 10.0], 60), 25)
    u, decay = np.zeros(force.size), np.exp(-100.0 / 30.0 * FINE)
    for k in range(1, u.size):
        u[k] = decay * u[k - 1] + (1.0 - decay) * force[k - 1] / 100.0
    folder.mkdir()
    rows = (
        f"{FINE * k:.2f},{f:g},{x:.9f}"
        for k, (f, x) in enumerate(zip(force, u + NOISE * rng.normal(size=u.size), strict=True))
    )
    (folder / "one.csv").write_text("\n".join(["t,force,speed", *rows]) + "\n")
    prior = '[prior.X_u]\ndistribution = "normal"\nmean = -90.0\nsd = 40.0'
    text = CAMPAIGN.replace("X_uabsu", "X_u").replace(
        '[prior.X_u]\ndistribution = "normal"\nmean = -6.0\nsd = 3.0', prior
    )
    text = (
        text.replace("0.02 m/s", f"{NOISE} m/s")
        .replace("SCALE", "1.0")
        .replace('fit = ["one"]', f'fit = ["one"]\nstep = "{step} s"')
    )
    (folder / "campaign.toml").write_text(text)
    campaign = load_campaign(folder)
    (record,) = get_trials(campaign).fit
    posterior = build_posterior(campaign, campaign.full, [record])
    return posterior, find_mode(posterior, key=0), record


@pytest.mark.proof
def test_steps_that_move_a_fit_are_reported_and_shorter_ones_confirm_it(tmp_path):
    """Means over 0.1 s of a motion of 0.3 s: the linear step to half the steps foretells the fit at 0.02 s, to a fifth of the shift."""
    posterior, mode, record = fitted(tmp_path / "coarse", 0.1)
    assert record.provenance.options["averaged"] == {"u": AVERAGED}
    shift = step_shift(posterior, mode, np.array([[AVERAGED]]))
    _, fine, other = fitted(tmp_path / "fine", FINE)
    assert "averaged" not in other.provenance.options
    at = [mode.names.index(name) for name in ("X_tau_X", "X_u")]
    exact = ((mode.values - fine.values) / mode.sd)[at]
    assert np.abs(exact).max() > 2.0
    assert shift[at] == pytest.approx(exact, abs=0.2 * np.abs(exact).max() + 0.3)
    (finding,) = long_steps(posterior, mode, [record])
    assert (finding.code, finding.level, finding.remedies) == ("steps-too-long", "caution", ("shorter-step",))
    assert dict(zip(finding.subject, finding.values["shifts"], strict=True))["X_tau_X"] == pytest.approx(shift[at[0]])
    assert finding.values["shorter"] == pytest.approx(FINE)


def test_steps_that_move_nothing_are_not_reported(tmp_path):
    posterior, mode, record = fitted(tmp_path / "fine", FINE)
    assert long_steps(posterior, mode, [record]) == []
