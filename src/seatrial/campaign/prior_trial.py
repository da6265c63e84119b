"""The trial over which a campaign's priors are shown: its control, where it starts, and the priors that belong to it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from seatrial.campaign.config import Campaign
from seatrial.campaign.designs import design_first, is_designed
from seatrial.campaign.problem import build_posterior, initial_state
from seatrial.campaign.simulated import FIRST
from seatrial.campaign.store import Store
from seatrial.campaign.trials import get_trials
from seatrial.campaign.watch import SILENT, Watch
from seatrial.core.record import Record
from seatrial.estimation.priors import Prior
from seatrial.manoeuvres.manoeuvre import Manoeuvre, check_limits
from seatrial.vehicles.model import VehicleModel


@dataclass(frozen=True, eq=False)
class PriorTrial:
    """What is simulated.

    Attributes:
        words: what it is.
        label: of the record; empty without one.
        time: s, shape (n,).
        control: SI, in the model's order, shape (n, n_controls).
        start: state at the first sample, SI.
        measured: u as measured, m/s, NaN where not, shape (n,); None where it is not.
        priors: of the full structure's coefficients and nuisances.
        units: SI unit of each.
    """

    words: str
    label: str
    time: Float[np.ndarray, " n"]
    control: Float[np.ndarray, "n n_controls"]
    start: tuple[float, ...]
    measured: Float[np.ndarray, " n"] | None
    priors: Mapping[str, Prior]
    units: Mapping[str, str]

    @property
    def step(self) -> Float[np.ndarray, " n"]:
        """Time to the next sample, s; the last is not used."""
        gaps = np.diff(self.time)
        return np.append(gaps, gaps[-1])


def prior_trial(campaign: Campaign, watch: Watch = SILENT) -> PriorTrial:
    """First fitted record; where a campaign has none yet, its best design if there is one, else its largest.

    Raises:
        InputError: logs that cannot be read, or no design inside the limits.
    """
    model = campaign.model(campaign.full)
    record = _record(campaign, watch)
    if record is None:
        return _designed(campaign, model, watch)
    parameters = build_posterior(campaign, campaign.full, [record]).parameters
    return PriorTrial(
        f"the control of record {record.label}",
        record.label,
        record.time,
        np.column_stack([record.channel(name) for name in model.controls]),
        initial_state(campaign, model, record),
        record.channel("u") if "u" in campaign.channels else None,
        {parameter.name: parameter.prior for parameter in parameters},
        {parameter.name: parameter.unit for parameter in parameters},
    )


def _record(campaign: Campaign, watch: Watch) -> Record | None:
    """First fitted record: logs are read, but nothing is designed or simulated for the sake of it."""
    is_run = is_designed(campaign) and Store(campaign.folder).record(FIRST).is_file()
    if not campaign.has_records or (campaign.is_simulated and not is_run):
        return None
    return get_trials(campaign, watch).fit[0]


def _designed(campaign: Campaign, model: VehicleModel, watch: Watch) -> PriorTrial:
    """A member of a designed family from trim; other controls are held at theirs."""
    manoeuvre, words = (
        (design_first(campaign, watch).best.best_manoeuvre(), "the best design")
        if is_designed(campaign)
        else (_largest(campaign), "the largest input of [design] inside the limits")
    )
    time, driven = manoeuvre.sample(campaign.family.sample_time)
    held = campaign.hull.trim
    columns = [
        driven if name == manoeuvre.control else np.full(time.size, held.get(name, 0.0)) for name in model.controls
    ]
    priors = {
        term.text: (campaign.prior(term.text, model.unit_of(term)), model.unit_of(term)) for term in model.coefficients
    }
    if campaign.has_delay:
        priors["delay"] = campaign.prior("delay", "s"), "s"
    return PriorTrial(
        words,
        "",
        time,
        np.column_stack(columns),
        tuple(held.get(state, 0.0) for state in model.states),
        None,
        {name: prior for name, (prior, _) in priors.items()},
        {name: unit for name, (_, unit) in priors.items()},
    )


def _largest(campaign: Campaign) -> Manoeuvre:
    """Member of the first family of the largest amplitude inside the limits, and of the longest period that fits."""
    family, limits, (amplitudes, periods) = campaign.families[0], campaign.limits(), campaign.grid()
    fitting = periods[family.fits(periods)]
    period = float(fitting.max() if fitting.size else periods.min())
    members = [family.manoeuvre(float(amplitude), period) for amplitude in amplitudes[::-1]]
    for member in members:
        if not limits.excess(member.sample(family.sample_time)[1], family.sample_time):
            return member
    check_limits(members[-1], limits, family.sample_time)
    return members[-1]
