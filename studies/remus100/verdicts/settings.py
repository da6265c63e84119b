"""Settings that items of Section IV share, for `paper.json` and the page."""

from typing import Any

from studies.remus100.study import Study


def trial_settings(study: Study) -> dict[str, Any]:
    """The vehicle, the trial, and the seeds of both trial and computation."""
    return {"reading": study.reading.name, "data_seed": 1, "sigma": study.reading.sigma, "seed": study.seed}


def chain_settings(study: Study) -> dict[str, Any]:
    """These and the size of a Markov chain run."""
    sizes = study.sizes
    return trial_settings(study) | {"chains": sizes.chains, "burn_in": sizes.burn_in, "draws": sizes.draws}
