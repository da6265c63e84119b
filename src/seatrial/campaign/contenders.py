"""The two most probable structures side by side: what choosing between them changes in speed, and which trial would decide."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from seatrial.campaign.config import Campaign
from seatrial.campaign.contender_runs import compare_speeds, expected_nats, noise_of
from seatrial.campaign.design_words import design_words
from seatrial.campaign.designs import design_key, design_next
from seatrial.campaign.estimate import Estimate, estimate_all
from seatrial.campaign.store import Store, is_current, key_of, write_dataset
from seatrial.campaign.trials import Trials
from seatrial.campaign.watch import SILENT, Watch
from seatrial.core.dataset_file import open_dataset
from seatrial.design.sweep import Sweep
from seatrial.selection.structures import Structure
from seatrial.selection.verdict import DECIDED, Selection

NEXT = "the next trial"
ENOUGH = 3.0
"""Expected log Bayes factor, nats, that decides: odds of twenty to one."""


@dataclass(frozen=True, eq=False)
class Contenders:
    """The best structure and the runner-up, as stored.

    Attributes:
        data: `time`, `best`, `difference`, `lower` and `upper` on `sample`, one manoeuvre after another, `which` by its index: speed of
            the best, and by how much it exceeds the runner-up's, with its 90 % band; `largest`, `rms` and `excitation` by
            `manoeuvre`, the fitted records and then the next trial; `nats` by `amplitude` and `period`: the expected log Bayes
            factor, NaN where a limit is broken.
    """

    data: xr.Dataset

    @property
    def labels(self) -> tuple[str, str]:
        """Best and runner-up."""
        return self.data.attrs["best"], self.data.attrs["runner_up"]

    @property
    def decisive(self) -> tuple[int, int]:
        """Indices of the amplitude and the period that would tell most."""
        nats = self.data["nats"].values
        return _largest(nats)

    @property
    def nats(self) -> float:
        """Expected log Bayes factor of that design."""
        return float(self.data["nats"].values[self.decisive])

    @property
    def shown(self) -> tuple[int, int]:
        """Manoeuvres worth a picture: the fitted record of most excitation, and the next trial."""
        return int(np.argmax(self.data["excitation"].values[:-1])), self.data.sizes["manoeuvre"] - 1

    def where(self, manoeuvre: int) -> str:
        """Name of a manoeuvre in a sentence."""
        name = str(self.data["manoeuvre"].values[manoeuvre])
        return name if manoeuvre == self.data.sizes["manoeuvre"] - 1 else f"run {name}"

    def curve(self, manoeuvre: int) -> xr.Dataset:
        """Samples of one manoeuvre."""
        return self.data.isel(sample=np.flatnonzero(self.data["which"].values == manoeuvre))

    def lines(self, selection: Selection) -> list[str]:
        """What the runner-up would change, what is undecided, and which trial would decide, in words."""
        return [self.difference_words(), undecided_words(selection), self.trial_words(selection)]

    def difference_words(self) -> str:
        """What choosing the runner-up would change in speed."""
        data = self.data
        parts = [
            f"{float(data['largest'][i]):.2g} m/s (rms {float(data['rms'][i]):.2g}) in {self.where(i)}"
            for i in reversed(self.shown)
        ]
        noise = data.attrs["noise"]
        end = f"the sensor's noise is {noise:.2g} m/s" if np.isfinite(noise) else "the speed is not measured"
        change = f"{self.labels[1]}, {data.attrs['change']}"
        return f"the runner-up ({change}) would change the speed by at most {' and '.join(parts)}; {end}"

    def trial_words(self, selection: Selection) -> str:
        """Which design of the best family would decide between the two, or that none would."""
        best, runner = self.labels
        first, second = -np.sort(-selection.probability)[:2]
        if first >= DECIDED * (first + second):
            return f"these data have decided between {best} and {runner}; no trial is needed for that"
        trial = self.data.attrs["trial"]
        told = f"{self.nats:.2g} nat of evidence expected, {ENOUGH:g} decide"
        if self.nats > ENOUGH:
            return f"to decide between {best} and {runner}, run a {trial}: {told}"
        return (
            f"no design of this family would decide between {best} and {runner}; the best would be a {trial}: {told}. "
            "Widen the limits, run for longer, or use a better sensor"
        )


def contending(selection: Selection) -> tuple[Structure, ...]:
    """The two most probable structures, the best first; fewer where there are not two."""
    order = np.argsort(-selection.probability, kind="stable")[:2]
    return tuple(selection.structures[index] for index in order)


def undecided_words(selection: Selection) -> str:
    """Name the terms about which these data leave doubt."""
    doubtful = [f"{term} ({p:.2f})" for term, p in selection.inclusion.items() if 1 - DECIDED < p < DECIDED]
    if not doubtful:
        return "these data decide about every optional term"
    return f"not settled beyond doubt: {', '.join(doubtful)}; in brackets the probability that it is needed"


def change_words(best: Sequence[str], other: Sequence[str]) -> str:
    """How another set of terms differs: `with X_u, without X_du3`."""
    more, fewer = ([term for term in a if term not in b] for a, b in ((other, best), (best, other)))
    return ", ".join(f"{word} {' and '.join(terms)}" for word, terms in (("with", more), ("without", fewer)) if terms)


def find_contenders(
    campaign: Campaign, selection: Selection, trials: Trials, watch: Watch = SILENT
) -> Contenders | None:
    """Estimate the two contenders where that has not been done, and compare them; None where there is one structure only."""
    pair = contending(selection)
    if len(pair) < 2:
        return None
    best, runner = estimate_all(replace(campaign, shortlist=pair), trials, watch)
    terms = [term for term in best.structure.terms if term in best.names]
    sweep = design_next(campaign, best.structure, best.draws(terms), best.key, watch).best
    return compare_contenders(campaign, best, runner, trials, sweep, watch)


def compare_contenders(
    campaign: Campaign, best: Estimate, runner: Estimate, trials: Trials, sweep: Sweep, watch: Watch = SILENT
) -> Contenders:
    """Compare what two structures predict, and search the family for the design that tells them apart; a current result is read.

    Args:
        campaign: configuration.
        best: posterior of the most probable structure.
        runner: posterior of the next one.
        trials: records.
        sweep: designs of the next trial: their grid, which of them break a limit, and the best.
        watch: who is told.
    """
    path = Store(campaign.folder).contenders
    key = key_of("contenders", design_key(campaign), best.key, runner.key, trials.key)
    if not is_current(path, key):
        progress = watch.progress("compare the best structure with the runner-up")
        progress(0, 1)
        write_dataset(path, _dataset(campaign, best, runner, trials, sweep), key)
        progress(1, 1)
    return Contenders(open_dataset(path))


def _dataset(campaign: Campaign, best: Estimate, runner: Estimate, trials: Trials, sweep: Sweep) -> xr.Dataset:
    found = compare_speeds(campaign, best, runner, trials, sweep)
    join = {name: np.concatenate([getattr(one, name) for one in found]) for name in found[0].CURVES}
    control = sweep.family.control
    commands, nats = (
        [record.channel(control) for record in trials.fit],
        expected_nats(campaign, best, runner, trials, sweep),
    )
    row, column = _largest(nats)
    commands.append(sweep.best_manoeuvre().sample(sweep.family.sample_time)[1])
    return xr.Dataset(
        {
            **{name: ("sample", column) for name, column in join.items()},
            "which": ("sample", np.repeat(np.arange(len(found)), [one.time.size for one in found])),
            "largest": ("manoeuvre", [one.largest for one in found]),
            "rms": ("manoeuvre", [one.rms for one in found]),
            "excitation": ("manoeuvre", [float(np.nanstd(command)) for command in commands]),
            "nats": (("amplitude", "period"), nats),
        },
        coords={
            "manoeuvre": [*(record.label for record in trials.fit), NEXT],
            "amplitude": sweep.amplitude,
            "period": sweep.period,
        },
        attrs={
            "best": best.structure.label,
            "runner_up": runner.structure.label,
            "change": change_words(best.structure.terms, runner.structure.terms),
            "noise": noise_of(campaign, best, campaign.leading)
            if campaign.leading in campaign.channels
            else float("nan"),
            "control": control,
            "trial": design_words(sweep.family, float(sweep.amplitude[row]), float(sweep.period[column])),
        },
    )


def _largest(nats: np.ndarray) -> tuple[int, int]:
    row, column = np.unravel_index(np.nanargmax(nats), nats.shape)
    return int(row), int(column)
