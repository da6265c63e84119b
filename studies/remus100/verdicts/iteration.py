"""Section V and the readings: the iteration the paper proposes, and what changes with the units it does not print."""

import numpy as np

from studies.remus100.compute.filters import FIRST_SEED
from studies.remus100.compute.iteration import FITS
from studies.remus100.items import Item, Number
from studies.remus100.study import Study
from studies.remus100.vehicle_file import NAMES


def iteration(study: Study) -> Item:
    """Select, redesign, re-estimate: what a second, redesigned trial adds to the first."""
    data, doubted = study.part("iteration"), study.reading.doubted
    both = data["both"].sel(coefficient=doubted)
    best = str(both["design"].values[int(both.values.argmin())])
    sds = {fit: float(data["full_sd"].sel(fit=fit, coefficient=doubted)) for fit in FITS}
    p = {fit: (float(data["probability"].sel(fit=fit)), float(data["error"].sel(fit=fit))) for fit in FITS}
    numbers = [
        Number(f"predicted sd of {doubted} after {name} too", None, float(both.sel(design=name)))
        for name in both["design"].values
    ]
    for fit in FITS:
        numbers.append(Number(f"P(M-0) under the wide prior, {fit}", None, *p[fit]))
        numbers += [
            Number(f"sd of {name} in M-0, {fit}", None, float(data["full_sd"].sel(fit=fit, coefficient=name)))
            for name in (*NAMES, doubted)
        ]
        numbers += [
            Number(f"sd of {name} in M-1, {fit}", None, float(data["reduced_sd"].sel(fit=fit, coefficient=name)))
            for name in NAMES
        ]
    gain = sds[FITS[1]] / sds[FITS[2]]
    holds = gain > 1
    return Item(
        "iteration",
        "Section V: the two stages repeated",
        "reproduced in shape" if holds else "differs",
        f"the paper proposes it and shows none: after one trial the sd of {doubted} is {sds[FITS[0]]:.2f} and P(M-0) "
        f"{p[FITS[0]][0]:.2f}; the best second trial "
        f"({best}) brings them to {sds[FITS[2]]:.2f} and {p[FITS[2]][0]:.3f}, the same trial again only to "
        f"{sds[FITS[1]]:.2f} and {p[FITS[1]][0]:.2f}",
        tuple(numbers),
        {"reading": study.reading.name, "data_seeds": [1, 2], doubted: study.reading.source.doubted.values[0]},
    )


def readings(study: Study) -> Item:
    """Both readings of the unprinted units side by side."""
    data, numbers = study.part("readings"), []
    for name in map(str, data["reading"].values):
        one = data.sel(reading=name)
        numbers += [
            Number(f"{name}: sd of {c} by the SRUKF of Table I", None, float(one["filter_sd"].sel(coefficient=c)))
            for c in NAMES
        ]
        numbers += [Number(f"{name}: sd of {c} in M-1", None, float(one["fit_sd"].sel(coefficient=c))) for c in NAMES]
        numbers += [
            Number(f"{name}: sd of {c} in M-0", None, float(one["full_fit_sd"].sel(coefficient=c))) for c in NAMES
        ]
        numbers += [
            Number(f"{name}: gain of the 10 s doublet [nat]", None, float(one["gain_10_s"])),
            Number(f"{name}: gain of the 20 s doublet [nat]", None, float(one["gain_20_s"])),
        ]
        numbers += [
            Number(f"{name}: P(M-0) at X_du3 = {value:g}", None, float(one["probability"].sel(value=value)))
            for value in one["value"].values
        ]
    spread = float(np.abs(data["probability"] - data["probability"].mean("reading")).max())
    ratio = float((data["fit_sd"].sel(reading="B") / data["fit_sd"].sel(reading="A")).mean())
    return Item(
        "readings",
        "Readings A and B of the unprinted units",
        "reproduced in shape" if spread < 0.05 else "differs",
        f"units of T and n are not printed: under B the same rpm excite less, standard deviations are {ratio:.2f} "
        "times those under A, which lie nearer "
        f"the tables; P(M-0) moves by {2 * spread:.3f} at most"
        + (
            ", so no verdict on the models depends on it"
            if spread < 0.05
            else ", so the verdict on the models depends on it"
        ),
        tuple(numbers),
        {
            "readings": {"A": "T in 1e-2 N/(rev/s)^2, 750 rpm", "B": "T in 1e-4 N/(rad/s)^2, 1194 rpm"},
            "filter_seeds": [FIRST_SEED, FIRST_SEED + study.sizes.tuning_seeds - 1],
            "data_seed": 1,
        },
    )
