"""Section III, design: Figures 3 and 4, the self-oscillating test, and what the text says of them."""

import numpy as np
from jaxtyping import Float

from studies.remus100.designs import ACTIVE, NOISE_SEED, PERIODS
from studies.remus100.reading import RPM
from studies.remus100.study import Item, Number, Study

WINDOWS = {name: f"sweep-{name}" for name in ACTIVE}


def figure_3(study: Study) -> Item:
    """Information grows with amplitude, peaks near 10 s, and has ridges where whole doublets drop out."""
    numbers = []
    for name, part in WINDOWS.items():
        gain, window = study.part(part)["gain"].values, f"{ACTIVE[name]:g} s window"
        numbers += [Number(f"{window}: ridge [s]", 10.0 if p == 10 else None, p) for p in ridges(gain[-1])]
        numbers += [
            Number(f"{window}: smallest gain [nat]", None, float(gain.min())),
            Number(f"{window}: gain of the largest amplitude, 10 s [nat]", None, float(gain[-1, _at(10.0)])),
            Number(f"{window}: gain of the largest amplitude, 20 s [nat]", None, float(gain[-1, -1])),
        ]
    difference = float(np.abs(study.part("sweep-medium")["gain"] - study.part("sweep-ekf")["gain"]).max())
    numbers.append(Number("largest difference of the EKF's gain from the SRUKF's, 40 s window [nat]", None, difference))
    short = study.part("sweep-short")["gain"].values
    at_ten = 10.0 in ridges(short[-1]) and _grows(short) == 1.0
    return Item(
        "figure-3",
        "Figure 3: entropy reduction over amplitude and period",
        "not comparable" if at_ten else "contradicted",
        f"the window is not printed: with 20 s a ridge lies at {_list(ridges(short[-1]))} s, with "
        f"{ACTIVE['medium']:g} s at "
        f"{_list(ridges(study.part('sweep-medium')['gain'].values[-1]))} s, so the preference for 10 s comes from "
        "the window and not from the vehicle",
        tuple(numbers),
        _settings(study) | {"windows_s": list(ACTIVE.values()), "noise_free": True},
    )


def figure_4(study: Study) -> Item:
    """The chosen doublet: estimates settle while it runs, and hardly change in the quiet tail."""
    data = study.part("chosen-doublet")
    sd = data["sd"]
    tail = float((sd.isel(time=-1) / sd.sel(time=ACTIVE["medium"] + 1, method="nearest")).min())
    active = float((sd.sel(time=ACTIVE["medium"] + 1, method="nearest") / sd.sel(time=2.0, method="nearest")).max())
    return Item(
        "figure-4",
        "Figure 4: the doublet of 10 s",
        "not comparable" if active < 0.5 and tail > 0.5 else "contradicted",
        f"no number is printed: during the doublets the standard deviations fall to {active:.2f} or less of their values at "
        f"2 s; in the quiet time after them they keep {tail:.2f} or more of their values at its beginning",
        (
            Number("largest ratio of sds, end of the doublets over 2 s", None, active),
            Number("smallest ratio of sds, end of the trial over end of the doublets", None, tail),
        ),
        _settings(study) | {"data_seed": NOISE_SEED},
    )


def relay(study: Study) -> Item:
    """The self-oscillating test, which the paper names and does not run, beside the doublet."""
    data, doublet = study.part("relay"), study.part("sweep-medium")["gain"].values
    gain, swings = data["gain"].values, data["switches"].values >= 2
    best, still = float(gain[swings].max()), gain[~swings]
    amplitude, threshold = data.attrs["best_amplitude"] / RPM, data.attrs["best_threshold"]
    as_good = best > doublet[-1, _at(10.0)]
    unreached, idle = "", ()
    if still.size:
        unreached = (
            f"; if the vehicle does not reach the reversal, the control stays on one side, and the gain is {still.min():.2f} to "
            f"{still.max():.2f}"
        )
        idle = (Number("best test that does not oscillate [nat]", None, float(still.max())),)
    return Item(
        "relay",
        "The self-oscillating test beside the doublet",
        "not comparable" if as_good else "contradicted",
        f"the paper names the test and shows no result: the best test (+-{amplitude:.0f} rpm, reversed at +-{threshold:.2f} "
        f"m/s) gains {best:.2f} nat, the "
        f"doublet of 10 s {doublet[-1, _at(10.0)]:.2f} and the best doublet {doublet.max():.2f}{unreached}",
        (
            Number("best self-oscillating test [nat]", None, best),
            Number("its amplitude above trim [rpm]", None, float(amplitude)),
            Number("its reversal, change of speed from trim [m/s]", None, float(threshold)),
            *idle,
            Number("share of the grid that oscillates", None, float(swings.mean())),
            Number("doublet of 10 s, largest amplitude [nat]", None, float(doublet[-1, _at(10.0)])),
            Number("best doublet [nat]", None, float(doublet.max())),
        ),
        _settings(study),
    )


def claim_amplitude(study: Study) -> Item:
    """The entropy reduction increases with amplitude."""
    shares = {ACTIVE[name]: _grows(study.part(part)["gain"].values) for name, part in WINDOWS.items()}
    holds = min(shares.values()) == 1.0
    return Item(
        "claim-amplitude",
        "Larger doublets always teach more",
        "reproduced" if holds else "contradicted",
        "" if holds else f"in {1 - min(shares.values()):.1%} of the steps of the grid they teach less",
        tuple(
            Number(f"{window:g} s window: share of steps that add information", None, value)
            for window, value in shares.items()
        ),
        _settings(study),
    )


def claim_ten_seconds(study: Study) -> Item:
    """The maximum is reached around 10 s, with diminishing increase beyond."""
    fisher = study.part("iteration")
    best = {name: float(PERIODS[study.part(part)["gain"].values[-1].argmax()]) for name, part in WINDOWS.items()}
    teaches = fisher["alone"].sel(coefficient="X_u")
    ten, longer = (float(teaches.sel(design=f"doublets of {period} s")) for period in (10, 29))
    holds = all(abs(period - 10.0) <= 1.0 for period in best.values())
    return Item(
        "claim-ten-seconds",
        "Information peaks near a period of 10 s",
        "reproduced" if holds else "contradicted",
        ""
        if holds
        else "the most informative period is "
        + ", ".join(f"{best[name]:g} s for a window of {ACTIVE[name]:g} s" for name in best)
        + f"; with 58 s, doublets of 29 s reduce the standard deviation of X_u to {longer:.2f}, those of 10 s "
        f"to {ten:.2f}",
        tuple(
            Number(f"{ACTIVE[name]:g} s window: most informative period [s]", 10.0, period)
            for name, period in best.items()
        ),
        _settings(study),
    )


def claim_ridges(study: Study) -> Item:
    """Ridges lie where a whole doublet drops out."""
    explained = []
    for name, part in WINDOWS.items():
        counts = np.floor(ACTIVE[name] / PERIODS + 1e-9)
        for ridge in ridges(study.part(part)["gain"].values[-1]):
            i = _at(ridge)
            explained.append(bool(counts[i + 1] < counts[i]))
    holds = bool(explained) and all(explained)
    return Item(
        "claim-ridges",
        "Ridges lie where one whole doublet fewer fits",
        "reproduced" if holds else "contradicted",
        ""
        if holds
        else f"{explained.count(False)} of {len(explained)} ridges do not"
        if explained
        else "there are none",
        (
            Number("ridges at the largest amplitude", None, len(explained)),
            Number("of these, before a lost doublet", None, sum(explained)),
        ),
        _settings(study),
    )


def claim_quiet_time(study: Study) -> Item:
    """A long quiet time after the doublets minimises the jumps."""
    jumps = {
        name: float(max(0.0, -np.diff(study.part(part)["gain"].values[-1]).min())) for name, part in WINDOWS.items()
    }
    holds = jumps["short"] < jumps["long"]
    return Item(
        "claim-quiet-time",
        "A long quiet time makes the jumps smaller",
        "reproduced" if holds else "contradicted",
        ""
        if holds
        else "the largest drop from one period to the next is "
        + ", ".join(f"{jumps[name]:.2f} nat with {60 - ACTIVE[name]:g} s of quiet" for name in jumps)
        + ": quiet time leaves less time for doublets, and of fewer doublets each lost one counts more",
        tuple(
            Number(f"{ACTIVE[name]:g} s window: largest drop between periods [nat]", None, value)
            for name, value in jumps.items()
        ),
        _settings(study),
    )


def ridges(gain: Float[np.ndarray, " P"]) -> list[float]:
    """Return the periods after which a longer doublet teaches less, because one whole doublet fewer fits."""
    return [float(PERIODS[i]) for i in range(1, gain.size - 1) if gain[i] > gain[i - 1] and gain[i] > gain[i + 1]]


def _grows(gain: np.ndarray) -> float:
    """Share of the steps from one amplitude to the next that add information."""
    return float(np.mean(np.diff(gain, axis=0) > 0))


def _at(period: float) -> int:
    return int(np.argmin(np.abs(PERIODS - period)))


def _list(periods: list[float]) -> str:
    return ", ".join(f"{period:g}" for period in periods) or "no period"


def _settings(study: Study) -> dict:
    reading = study.reading
    return {
        "reading": reading.name,
        "amplitudes_rpm": [round(reading.lowest / RPM, 6), round(reading.highest / RPM, 6)],
        "duration_s": 60.0,
    }
