"""The noise that promises of the next trial count on: what the fit left over, and not what the sensors promise.

Slow residuals of standard deviation s and correlation time tau, sampled every dt, blur a motion of period P as white noise of

    s^2 (1 + r) / (1 - r) / (1 + (2 pi tau / P)^2),   r = exp(-dt / tau),

their spectrum at that period over that of white noise; s^2 at least. Noise in proportion to the signal counts as at trim.
"""

from dataclasses import replace

import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.store.estimates import Drawn
from seatrial.core.display_units import listed, shown_unit
from seatrial.estimation.prediction.prediction import noise_sd, slow_noise
from seatrial.estimation.simulation.sensor_errors import noise_name

TOLD = 1.3  # Ratio of the two standard deviations from which on a reader is told


def with_residual_noise(campaign: Campaign, estimate: Drawn) -> Campaign:
    """Return the campaign with the noise of its sensors as an estimate found it."""
    noise = residual_noise(campaign, estimate)
    sensors = {name: sensor.model_copy(update={"noise": noise[name]}) for name, sensor in campaign.sensors.items()}
    return replace(campaign, sensors=sensors)


def residual_noise(campaign: Campaign, estimate: Drawn) -> dict[str, float]:
    """Return for each channel the standard deviation of the white noise that blurs a designed trial as the fit's residuals would, SI."""
    noise, slowest = {}, float(campaign.design.grid()[1].max())
    trim = campaign.channel_trim
    for sensor in campaign.sensor_models:
        name, settings = sensor.channel, campaign.sensors[sensor.channel]
        if noise_name(name) not in estimate.names:
            noise[name] = settings.noise
            continue
        values = {one: estimate.draws([one])[:, 0] for one in estimate.names if one.endswith(f"_{name}")}
        sd = float(np.sqrt(np.mean(noise_sd(sensor, values, trim.get(name, 0.0)) ** 2)))
        blur = 1.0
        if slow := slow_noise(sensor, values):
            memory = np.exp(-max(campaign.family.sample_time, 1.0 / settings.rate) / slow.time)
            by_slow = (1 + memory) / (1 - memory) / (1 + (2 * np.pi * slow.time / slowest) ** 2)
            blur = 1 - slow.share + slow.share * max(1.0, by_slow)
        noise[name] = sd * float(np.sqrt(blur))
    return noise


def noise_words(campaign: Campaign, estimate: Drawn) -> str:
    """Return what noise a promise counts on where that is not what [sensors] says; empty if it is."""
    differing = []
    for name, sd in residual_noise(campaign, estimate).items():
        nominal, (factor, unit) = campaign.sensors[name].noise, shown_unit(name)
        if not nominal / TOLD < sd < nominal * TOLD:
            differing.append(
                f"{sd * factor:.2g} {unit} on {name}, as white noise ([sensors]: {nominal * factor:.2g} {unit})"
            )
    return f"computed with the noise found in the fit, {listed(differing)}" if differing else ""
