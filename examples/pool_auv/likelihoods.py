"""One vehicle, three pool runs, four beliefs about what the model leaves over. Run it as `python examples/pool_auv/likelihoods.py`.

White, heavy-tailed and coloured residuals of a deterministic simulation (output error), and process noise integrated out by a
filter (filter error). Needs SEATRIAL_DATA; about three minutes.
"""

import shutil
import sys
from pathlib import Path

import numpy as np

import seatrial as st

HERE = Path(__file__).parent
OUTPUTS = HERE.parents[1] / "outputs" / "examples" / "pool_likelihoods"
NOISE = 0.02
"""Nominal noise of the speed, m/s."""
TERMS = ("X_tau_X", "X_0", "X_u", "X_uabsu")


def main() -> None:
    """Fit all, and print them side by side."""
    st.configure()
    vehicle = st.make_vehicle("pool AUV", None, {}, moves=["u"]).build(free=TERMS)
    records = runs()
    common = {
        "X_tau_X": st.Uniform(0.0, 0.1),
        "X_0": st.Normal(0.0, 0.05),
        "X_u": st.Uniform(-3.0, 0.0),
        "X_uabsu": st.Uniform(-20.0, 0.0),
        "delay": st.Uniform(0.0, 1.0),
        "sigma_u": st.LogUniform(0.002, 0.2),
    }
    start = {f"u_0[{record.label}]": st.Normal(first_speed(record), 5 * NOISE) for record in records}
    process = {"process_u": st.LogUniform(1e-4, 1.0)}
    beliefs = {
        "output error, white": (start, st.Sensor("u")),
        "output error, heavy-tailed": (start | {"dof_u": st.LogUniform(1.5, 200.0)}, st.Sensor("u", "heavy")),
        "output error, coloured": (start | {"tau_u": st.LogUniform(0.05, 30.0)}, st.Sensor("u", "coloured")),
        "filter error": (process, st.Sensor("u")),
    }
    names = list(dict.fromkeys([*common, *(name for more, _ in beliefs.values() for name in more if "[" not in name)]))
    print(f"{'':26}  " + "".join(f"{name:>21}" for name in names) + "   log evidence   correlation")
    for title, (more, sensor) in beliefs.items():
        posterior = st.make_posterior(vehicle, records, common | more, [sensor], start_sd={"u": NOISE})
        mode, draws = st.find_mode(posterior), st.sample(posterior, "adaptive-metropolis")
        found = draws.summary()
        cells = [f"{found['mean'][n]:.4g} ± {found['sd'][n]:.2g}" if n in draws.names else "" for n in names]
        left = residuals(st.predict(posterior, draws, records[0]))
        correlation = left[1:] @ left[:-1] / (left @ left)
        print(
            f"{title:26}  " + "".join(f"{cell:>21}" for cell in cells) + f"{mode.log_evidence:15.1f}{correlation:14.2f}"
        )


def runs() -> tuple[st.Record, ...]:
    """The runs that the example's campaign fits, its commands and velocities on one clock."""
    OUTPUTS.mkdir(parents=True, exist_ok=True)
    shutil.copy(HERE / "campaign.toml", OUTPUTS)
    return st.get_trials(st.load_campaign(OUTPUTS)).fit


def first_speed(record: st.Record) -> float:
    """First measured speed, m/s."""
    return float(record.channel("u")[np.isfinite(record.channel("u"))][0])


def residuals(prediction: st.Prediction) -> np.ndarray:
    """What a simulation leaves over of a run, 0.1 s apart, about its mean."""
    left = prediction.record.channel("u") - prediction.mean[:, 0]
    left = left[np.isfinite(left)]
    return left - left.mean()


if __name__ == "__main__":
    sys.exit(main())
