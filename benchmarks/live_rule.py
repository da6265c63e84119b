"""The stopping rule of `seatrial live` on simulated vehicles: `python benchmarks/live_rule.py [VEHICLES]`.

Vehicles are drawn from the priors of examples/design_trial and run a repeated doublet for 120 s at 10 Hz; the goal is absolute. Beside the
rule stands what an estimator that knows truth and noise would have: its standard deviation at every time (Fisher information, whitened
where the noise is correlated, and the priors). A stop is false where that is more than 1.1 times the goal; missed where there is none
until half as much time again has passed as the informed estimator needs. Coverage is of the 90 % intervals, over all coefficients.
"""

import sys
import time as clock
from decimal import Decimal
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from seatrial.campaign.config.load import check_text
from seatrial.campaign.design.problem import prior_draws
from seatrial.campaign.live.channels import Arrival
from seatrial.campaign.live.session import Session
from seatrial.compiled import engine
from seatrial.vehicles.simulate import simulate

STEP, SAMPLES, RPM = 0.1, 1200, 2 * np.pi / 60
GOAL = {"X_u": 0.45, "X_uabsu": 0.3}
NOISE = 0.05
CASES = {
    "white noise, as stated": (1.0, 0.0, 0.0),
    "white noise, twice as stated": (2.0, 0.0, 0.0),
    "noise correlated over 0.3 s": (1.0, 0.3, 0.0),
    "waves of 7 s, 0.05 m/s, and white noise": (1.0, 0.0, 0.05),
}
"""Noise over what is stated, its correlation time in s, amplitude of a wave in the speed that no term makes, m/s."""
Z90 = 1.645


def main(vehicles: int) -> None:
    """Print one row for each case."""
    engine.configure()
    folder = Path(__file__).parents[1] / "examples" / "design_trial"
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    goal = ", ".join(f"{name} = {sd}" for name, sd in GOAL.items())
    campaign = check_text(folder, text.replace('sd = { X_u = "6 %", X_uabsu = "3 %" }', f"sd = {{ {goal} }}"))
    assert campaign.goal is not None
    assert campaign.goal.sds == GOAL
    model = campaign.model(campaign.full)
    names = [term.text for term in model.coefficients]
    priors = campaign.coefficient_priors(model)
    truths = prior_draws(campaign, model)[:vehicles]
    time = np.arange(SAMPLES) * STEP
    control = (1194.0 + 200.0 * np.sign(np.sin(2 * np.pi * time / 16.0))) * RPM
    start = np.array([campaign.state_trim(model)[0]])

    @jax.jit
    def speed(values: jax.Array) -> jax.Array:
        params = {name: values[i] for i, name in enumerate(names)}
        return simulate(model, params, control[:, None], np.full(SAMPLES, STEP), start)[:, 0]

    slope = jax.jit(jax.jacfwd(speed))
    prior_information = np.diag([1.0 / float(prior.sd) ** 2 for prior in priors])
    wanted = np.array([GOAL.get(name, np.inf) for name in names])
    print(f"{vehicles} vehicles, {SAMPLES * STEP:g} s each, goal {GOAL}")
    for case, (more, tau, wave) in CASES.items():
        rng, rows, began, samples = np.random.default_rng(7), [], clock.process_time(), 0
        for truth in truths:
            noise = _noise(rng, more * NOISE, tau) + wave * np.sin(2 * np.pi * time / 7.0 + rng.uniform(0, 2 * np.pi))
            shown = np.asarray(speed(jnp.asarray(truth))) + noise
            known = _informed(np.asarray(slope(jnp.asarray(truth))), more * NOISE, tau, prior_information)
            found, used = _follow(campaign, names, time, control, shown)
            samples += used
            rows.append(_judge(found, truth, known, wanted, time))
        _print(case, rows, (clock.process_time() - began) / samples * 1e3)


def _noise(rng: np.random.Generator, sd: float, tau: float) -> np.ndarray:
    white = rng.normal(size=SAMPLES)
    if not tau:
        return sd * white
    memory, found = np.exp(-STEP / tau), white.copy()
    for k in range(1, SAMPLES):
        found[k] = memory * found[k - 1] + np.sqrt(1 - memory**2) * white[k]
    return sd * found


def _informed(slope: np.ndarray, sd: float, tau: float, prior: np.ndarray) -> np.ndarray:
    """Standard deviations at every time of who knows the noise, shape (n, k)."""
    memory = np.exp(-STEP / tau) if tau else 0.0
    white = np.concatenate([slope[:1], (slope[1:] - memory * slope[:-1]) / np.sqrt(1 - memory**2)]) / sd
    information = prior + np.cumsum(white[:, :, None] * white[:, None, :], 0)
    return np.sqrt(np.diagonal(np.linalg.inv(information), axis1=1, axis2=2))


def _follow(campaign, names: list[str], time: np.ndarray, control: np.ndarray, shown: np.ndarray):
    """Looks of one session: (time, kind, means, sds), until the stop or the end."""
    session, looks = Session(campaign, "simulated"), []
    for k in range(SAMPLES):
        session.add(Arrival(Decimal(f"{time[k]:.3f}"), 0, {"n": float(control[k]), "u": float(shown[k])}))
        if session.is_due:
            look = session.look()
            looks.append((look.time, look.kind, [c.mean for c in look.coefficients], [c.sd for c in look.coefficients]))
            if look.kind == "stop":
                break
    assert [c.name for c in session.look().coefficients] == names
    return looks, session.samples


def _judge(looks: list, truth: np.ndarray, known: np.ndarray, wanted: np.ndarray, time: np.ndarray) -> dict:
    at, kind, mean, sd = looks[-1]
    met = np.flatnonzero((known <= wanted).all(1))
    informed = time[met[0]] if met.size else np.inf
    is_stop = kind == "stop"
    index = min(round(at / STEP), len(time) - 1)
    return {
        "stop": at if is_stop else np.inf,
        "informed": informed,
        "false": is_stop and bool((known[index] > 1.1 * wanted).any()),
        "missed": (at if is_stop else np.inf) > 1.5 * informed + 10.0 and 1.5 * informed + 10.0 < time[-1],
        "covered": np.abs(np.array(mean) - truth) < Z90 * np.array(sd),
        "within": np.abs(np.array(mean) - truth)[np.isfinite(wanted)] < Z90 * wanted[np.isfinite(wanted)],
        "wrong": sum(kind == "wrong" for _, kind, _, _ in looks) > 0,
    }


def _print(case: str, rows: list[dict], cost: float) -> None:
    stops = np.array([row["stop"] for row in rows])
    informed = np.array([row["informed"] for row in rows])
    ended = np.isfinite(stops)
    covered = np.mean([row["covered"] for row in rows if np.isfinite(row["stop"])]) if ended.any() else np.nan
    ends = np.mean([row["covered"] for row in rows])
    within = np.mean([row["within"].all() for row in rows if np.isfinite(row["stop"])]) if ended.any() else np.nan
    both = ended & np.isfinite(informed)
    ratio = np.median(stops[both] / informed[both]) if both.any() else np.nan
    print(
        f"{case}: stops {ended.mean():.2f}, median at {np.median(stops[ended]) if ended.any() else np.nan:.0f} s, "
        f"{ratio:.2f} times the informed time (met by {np.isfinite(informed).mean():.2f}); "
        f"false {np.mean([row['false'] for row in rows]):.3f}, missed {np.mean([row['missed'] for row in rows]):.3f}; "
        f"coverage at stop {covered:.3f}, at stop or end {ends:.3f}; all wanted within 1.645 goals {within:.3f}; "
        f"called wrong {np.mean([row['wrong'] for row in rows]):.2f}; {cost:.3f} ms a sample",
        flush=True,
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
