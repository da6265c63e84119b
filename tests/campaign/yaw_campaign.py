"""A campaign of sway and yaw from two simulated zigzags, the surge speed given."""

from pathlib import Path

import numpy as np

SWAY = {"Y_v": -0.8, "Y_ur": -0.6, "Y_udelta_r": 0.12}
YAW = {"N_r": -1.1, "N_uv": -0.5, "N_udelta_r": -0.9}
CAMPAIGN = """
[campaign]
name = "sway and yaw"
seed = 3
[vehicle]
mass = "unknown"
[structure]
always = ["Y_v", "Y_ur", "Y_udelta_r", "N_r", "N_udelta_r"]
optional = ["N_uv", "N_rabsr"]
{priors}
[sensors.v]
noise = "0.005 m/s"
[sensors.r]
noise = "0.005 rad/s"
[estimation]
initial = "measured"
chains = 16
warmup = 300
draws = 300
[selection]
particles = 256
repeats = 2
[design]
control = "delta_r"
duration = "60 s"
active = "40 s"
sample_time = "0.2 s"
amplitude = {{ from = "5 deg", to = "20 deg", points = 3 }}
period = {{ from = "5 s", to = "20 s", points = 3 }}
[import]
fit = ["1", "2"]
[[import.files]]
path = "zigzag_{{run}}.csv"
time = {{ column = "t", unit = "s" }}
channels.u = {{ column = "u", unit = "m/s" }}
channels.v = {{ column = "v", unit = "m/s" }}
channels.r = {{ column = "r", unit = "deg/s" }}
channels.delta_r = {{ column = "rudder", unit = "deg" }}
"""


def write_yaw(folder: Path) -> Path:
    """Write the campaign and its logs."""
    names = [*SWAY, *YAW, "N_rabsr"]
    damping = {"Y_v", "N_r", "N_rabsr"}
    shapes = {
        True: 'distribution = "half-normal"\nupper = 0.0\nscale = 1.0',
        False: 'distribution = "normal"\nmean = 0.0\nsd = 1.0',
    }
    priors = "\n".join(f"[prior.{name}]\n{shapes[name in damping]}" for name in names)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(CAMPAIGN.format(priors=priors))
    random = np.random.default_rng(7)
    for label, amplitude, period in (("1", 10.0, 14.0), ("2", 20.0, 9.0)):
        (folder / f"zigzag_{label}.csv").write_text(log(np.radians(amplitude), period, random))
    return folder


def log(amplitude: float, period: float, random: np.random.Generator) -> str:
    """Rows of a log, integrated by small Euler steps of hand-written equations."""
    step, fine = 0.2, 20
    v = r = 0.0
    rows = ["t,u,v,r,rudder"]
    for k in range(300):
        t = k * step
        u, rudder = 1.5 - 0.1 * np.sin(0.1 * t), amplitude * (1 if t % period < period / 2 else -1)
        noisy = v + 0.005 * random.normal(), np.degrees(r + 0.005 * random.normal())
        rows.append(f"{t:.1f},{u:.6f},{noisy[0]:.6f},{noisy[1]:.6f},{np.degrees(rudder):.4f}")
        for _ in range(fine):
            sway = SWAY["Y_v"] * v + SWAY["Y_ur"] * u * r + SWAY["Y_udelta_r"] * u * rudder
            yaw = YAW["N_r"] * r + YAW["N_uv"] * u * v + YAW["N_udelta_r"] * u * rudder
            v, r = v + step / fine * sway, r + step / fine * yaw
    return "\n".join(rows) + "\n"
