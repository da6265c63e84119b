"""Campaigns that look finished: a made-up posterior under the keys that the campaign asks for, so that no chain is run."""

from pathlib import Path

import numpy as np
import xarray as xr

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.data.simulate import record_keys
from seatrial.campaign.inference.estimate import estimate_key
from seatrial.campaign.store.estimates import Estimate
from seatrial.campaign.store.stored_result import Store, StoredResult, write_dataset
from seatrial.campaign.workflow.steps import TrialsKey
from seatrial.core.dataset import Dataset
from tests.campaign.small import write_small, write_summary

MEAN = {
    "X_u": -1.3,
    "X_uabsu": -2.9,
    "T_nabsn": 6.3e-4,
    "M_q": -1.0,
    "Y_v": -3.0,
    "current[1]": -0.3,
    "current[2]": 0.1,
}


def finished(folder: Path, *replacements: tuple[str, str], alarms=(), beside=(), wider=1.0) -> Path:
    """Write the small campaign with a posterior of every structure, of which the first is chosen, and with empty records.

    Standard deviations are `wider` than those of the draws.
    """
    write_small(folder, *replacements)
    campaign = load_campaign(folder)
    keys = record_keys(campaign)
    for label, key in keys.items():
        write_dataset(Store(folder).record(label), Dataset(), key)
    trials = TrialsKey([*keys.values()][-1])
    for structure in campaign.structures:
        names = [*structure.terms, "sigma_u", *beside]
        mean = np.array([MEAN.get(name, 0.05) for name in names])
        root = np.random.default_rng(0).normal(size=(len(names), len(names))) * 0.03
        z = np.random.default_rng(1).normal(size=(4, 500, len(names)))
        draws = mean * (1.0 + z @ root)
        data = xr.Dataset(
            {
                "draws": (("chain", "draw", "parameter"), draws),
                "mean": ("parameter", draws.mean((0, 1))),
                "draws_sd": ("parameter", draws.std((0, 1))),
                "sd": ("parameter", wider * draws.std((0, 1))),
                "prior_lower": ("parameter", np.full(len(names), -np.inf)),
                "prior_upper": ("parameter", np.full(len(names), np.inf)),
                "unit": ("parameter", ["s" if name == "delay" else "1" for name in names]),
                "prior_sd": ("parameter", np.full(len(names), 0.5) * np.abs(mean)),
            },
            coords={"parameter": names},
        )
        key = estimate_key(campaign, structure, trials)
        StoredResult(Store(folder).posterior(structure.label), key, Estimate).write(
            Estimate(structure, Dataset.of(data), alarms=tuple(alarms))
        )
    write_summary(folder, chosen=campaign.structures[0].label)
    return folder
