"""One vehicle, three pool runs, four beliefs about what the model leaves over. Run it as `python examples/pool_auv/likelihoods.py`.

White, heavy-tailed and coloured residuals of a deterministic simulation (output error), and process noise integrated out by a
filter (filter error). Needs SEATRIAL_DATA; about three minutes.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import seatrial  # noqa: F401  (settings of the engine come before JAX)
from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.import_logs import Trials, get_trials
from seatrial.campaign.inference.posterior import build_posterior, random_key
from seatrial.estimation.draw_posterior import find_method
from seatrial.estimation.mode import find_mode
from seatrial.estimation.simulation import Simulator

HERE = Path(__file__).parent
OUTPUTS = HERE.parents[1] / "outputs" / "examples" / "pool_likelihoods"
TAU = """[prior.tau_u]
distribution = "log-uniform"
lower = 0.05
upper = 30.0
"""
PROCESS = """[prior.process_u]
distribution = "log-uniform"
lower = 1e-4
upper = 1.0
"""
VARIANTS = {
    "output error, white": ('residuals = "white"', ""),
    "output error, heavy-tailed": ('residuals = "heavy"', ""),
    "output error, coloured": ('residuals = "coloured"', TAU),
    "filter error": ('residuals = "white"\nlikelihood = "filter-error"', PROCESS),
}


class Answer(NamedTuple):
    """Posterior mean and sd by name, log evidence by Laplace, and the residuals' correlation over 0.1 s."""

    mean: dict[str, float]
    sd: dict[str, float]
    log_evidence: float
    correlation: float


def main() -> None:
    """Fit all, and print them side by side."""
    trials, answers = None, {}
    for name, (line, prior) in VARIANTS.items():
        campaign = write_campaign(name, line, prior)
        trials = get_trials(campaign) if trials is None else trials
        answers[name] = fit(campaign, trials)
    names = list(dict.fromkeys(key for answer in answers.values() for key in answer.mean if "[" not in key))
    width = max(map(len, answers))
    print(f"{'':{width}}  " + "".join(f"{name:>21}" for name in names) + "   log evidence   correlation")
    for title, answer in answers.items():
        cells = [f"{answer.mean[n]:.4g} ± {answer.sd[n]:.2g}" if n in answer.mean else "" for n in names]
        print(
            f"{title:{width}}  "
            + "".join(f"{cell:>21}" for cell in cells)
            + f"{answer.log_evidence:15.1f}{answer.correlation:14.2f}"
        )


def write_campaign(name: str, line: str, prior: str) -> Campaign:
    """The example's campaign with one thing changed, all its terms present."""
    text = (HERE / "campaign.toml").read_text(encoding="utf-8")
    text = text.replace('residuals = "coloured"', line).replace(TAU, prior)
    text = text.replace(
        'always = ["X_tau_X", "X_0"]\noptional = ["X_u", "X_uabsu"]', 'always = ["X_tau_X", "X_0", "X_u", "X_uabsu"]'
    )
    folder = OUTPUTS / name.replace(", ", "-").replace(" ", "-")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return load_campaign(folder)


def fit(campaign: Campaign, trials: Trials) -> Answer:
    """Posterior of the full structure."""
    posterior = build_posterior(campaign, campaign.structures[0], trials.fit)
    mode = find_mode(posterior, random_key(campaign.seed, "mode"))
    draws = find_method("adaptive-metropolis")(posterior, jax.random.key(1))
    values = np.asarray(posterior.constrain(jnp.asarray(draws)))
    mean, sd = (dict(zip(posterior.names, x.tolist(), strict=True)) for x in (values.mean(0), values.std(0)))
    here = dict(zip(posterior.names, mode.values.tolist(), strict=True))
    return Answer(mean, sd, mode.log_evidence, correlation(campaign, trials, here))


def correlation(campaign: Campaign, trials: Trials, values: dict[str, float]) -> float:
    """Autocorrelation of what a simulation leaves over, 0.1 s apart, the first fitted run."""
    record, model = trials.fit[0], campaign.model(campaign.structures[0])
    simulator = Simulator(model, campaign.sensor_models, campaign.has_delay)
    control = tuple(jnp.asarray(record.channel(name)) for name in model.controls)
    there = np.isfinite(record.channel("u"))
    start = jnp.array([values.get(f"u_0[{record.label}]", float(record.channel("u")[there][0]))])
    shown = np.asarray(simulator.outputs(values, start, control, jnp.asarray(record.step)))[:, 0]
    left = (record.channel("u") - shown)[there]
    left = left - left.mean()
    return float(left[1:] @ left[:-1] / (left @ left))


if __name__ == "__main__":
    sys.exit(main())
