"""Judges a campaign's records before anything is fitted to them: direction, size, delay, outliers, holes and excitation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Array

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.sensor_table import ATTITUDE
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.data.mount_check import SENSORS, along_body, check_mounts
from seatrial.campaign.data.record_cautions import empty_cells, record_cautions
from seatrial.campaign.data.thruster_check import check_thrusters
from seatrial.campaign.inference.posterior import initial_state, random_key
from seatrial.core.batching import bucket_length, filled
from seatrial.core.display_units import shown_unit
from seatrial.core.programs import program
from seatrial.core.record import SIMULATED, Record
from seatrial.core.signals import HELD, QUATERNION, RATES
from seatrial.design.prior_belief import draw_values
from seatrial.design.trial_plan import TrialPlan
from seatrial.estimation.first_guess import first_guess
from seatrial.estimation.priors import Prior
from seatrial.estimation.record_checks import (
    SUMMED,
    RecordFinding,
    check_clock,
    check_excitation,
    check_limits,
    check_motion,
    check_range,
    check_samples,
    check_signs,
    check_sum,
    check_trim,
    check_turn,
    not_judged,
    not_judged_sum,
    says_direction,
)
from seatrial.vehicles.model import VehicleModel

MOST_CAUSES = 3
"""Findings that are repeated where no model explains a record."""
_NO_CAUSE = ("excitation", "told apart", "limits")
"""Beginnings of checks that say what a record cannot tell, not what is wrong with it."""
COARSE = 0.5
"""Root mean square change of a rate in steps half as long, over its noise, from which steps are too long."""
DRAWS = 32
"""Vehicles drawn from the priors, beside the one at their means, to see whether they go the same way."""


@dataclass(frozen=True, eq=False)
class RecordJudgement:
    """What was found about one record.

    Attributes:
        record: it.
        findings: every check, also those that pass.
        cautions: holes and controls that never move.
    """

    record: Record
    findings: tuple[RecordFinding, ...]
    cautions: tuple[str, ...]

    @property
    def level(self) -> str:
        """The gravest."""
        levels = {finding.level for finding in self.findings}
        return "fail" if "fail" in levels else "caution" if "caution" in levels or self.cautions else "pass"

    def lines(self) -> list[str]:
        """A headline, one line for each trouble, and what passes."""
        head = f"record {self.record.label}: {self.level}; {self.record.time.size} samples over {self.record.time[-1]:.1f} s"
        troubles = [f"  {finding.line}" for finding in self.findings if finding.level != "pass"]
        passed: dict[str, list[str]] = {}
        for finding in self.findings:
            if finding.level == "pass":
                passed.setdefault(finding.check, []).append(finding.signal)
        fine = "; ".join(f"{check} of {', '.join(signals)}" for check, signals in passed.items())
        cautions = [f"  caution {text}" for text in self.cautions]
        return [head, *troubles, *cautions, *((f"  pass    {fine}",) if fine else ())]


def check_records(campaign: Campaign, trials: Trials) -> list[RecordJudgement]:
    """Judge every record, fitted and held back; vehicles of the priors say what is expected, as far as they agree."""
    return [_judge(campaign, record) for record in (*trials.fit, *trials.predict)]


def record_doubts(campaign: Campaign, record: Record) -> list[str]:
    """Say what is to be known of a record before anything that is fitted to it is believed, without a simulation."""
    found = [one for one in _stated(campaign, record) if one.level != "pass"]
    if record.provenance.source != SIMULATED:
        found += check_mounts(campaign, along_body(campaign, record))
    return record_cautions(record) + [
        f"run {record.label}, {one.signal}, {one.check}: {one.value} ({one.threshold}); {one.remedy}" for one in found
    ]


def likely_causes(campaign: Campaign, records: Sequence[Record]) -> list[str]:
    """Return what is gravest of what is found about some records, at most three, in words: why no model may explain them."""
    judged = [_judge(campaign, record) for record in records]
    words: dict[str, list[str]] = {"fail": [], "caution": []}
    for one in judged:
        for each in one.findings:
            if each.level in words and not each.check.startswith(_NO_CAUSE):
                text = f"run {one.record.label}, {each.signal}, {each.check}: {each.value}; {each.remedy}"
                words[each.level].append(text)
    said = [text for one in judged for text in one.cautions]
    return [*words["fail"], *said, *words["caution"]][:MOST_CAUSES]


def summary_line(judged: Sequence[RecordJudgement]) -> str:
    """Count failures and cautions of all records, and say whether to go on."""
    fails = sum(finding.level == "fail" for one in judged for finding in one.findings)
    cautions = sum(finding.level == "caution" for one in judged for finding in one.findings)
    cautions += sum(len(one.cautions) for one in judged)
    counted = ", ".join(
        f"{count} {word}{'s' * (count != 1)}" for count, word in ((fails, "failure"), (cautions, "caution"))
    )
    if fails:
        return f"in all {counted}: correct what fails before anything is estimated"
    return f"in all {counted}: " + (
        "look at each caution, then go on with `estimate`" if cautions else "go on with `estimate`"
    )


def _stated(campaign: Campaign, record: Record) -> list[RecordFinding]:
    """Compare a record with what the campaign states: limits, and of a real one the trim; and its clock with that of any vehicle."""
    driven = {name: record.channel(name) for name in campaign.model(campaign.full).controls}
    findings: list[RecordFinding] = []
    for name in (one for one in campaign.control_limits if one in driven):
        findings += check_limits(name, driven[name], campaign.control_limits[name], *shown_unit(name))
    if record.provenance.source == SIMULATED:
        return findings
    measured = {name: record.channel(name) for name in campaign.channels}
    findings += check_clock(float(np.median(np.diff(record.time))))
    return findings + check_trim(campaign.hull.trim, driven, measured)


def step_cautions(campaign: Campaign, trials: Trials) -> list[str]:
    """Say of which fitted records the steps are too long to simulate this vehicle, by the prior means; of several alike the first."""
    said: dict[str, str] = {}
    for record in (one for one in trials.fit if one.provenance.source != SIMULATED):
        alone, control = _trial(campaign, record)
        mean = {name: values[:1] for name, values in _believed(campaign, alone.model).items()}
        expected = np.asarray(_shown(alone, mean, control))[0, : record.time.size]
        for one in _steps(campaign, record, alone, mean, control, expected):
            said.setdefault(one.signal, f"run {record.label}, channel {one.signal}: {one.value}; {one.remedy}")
    return list(said.values())


def _trial(campaign: Campaign, record: Record) -> tuple[TrialPlan, np.ndarray]:
    """Return a record as a trial in which every sensor gives each sample, without noise, and its controls; both filled up."""
    model, size = campaign.model(campaign.full), bucket_length(record.time.size)
    step = filled(np.diff(record.time), size, 0.0)
    control = filled(np.column_stack([record.channel(name) for name in model.controls]), size)
    start = np.array(initial_state(campaign, model, record))
    return TrialPlan(model, campaign.channels, start, step, np.ones((size, len(campaign.channels)))), control


def _believed(campaign: Campaign, model: VehicleModel) -> dict[str, np.ndarray]:
    """Return the vehicle at the prior means, and some drawn from the priors: each coefficient and unknown, SI, shape (1 + d,)."""
    names = (*(term.text for term in model.coefficients), *(one.name for one in model.unknowns))
    priors = tuple(campaign.prior(name) for name in names)
    mean = np.array([float(prior.mean) for prior in priors])
    tried = np.vstack([mean, draw_values(priors, random_key(campaign.seed, "vehicles of the priors"), DRAWS)])
    return dict(zip(names, tried.T, strict=True))


def _judge(campaign: Campaign, record: Record) -> RecordJudgement:
    alone, control = _trial(campaign, record)
    priors = campaign.coefficient_priors(alone.model)
    mean = np.array([float(prior.mean) for prior in priors])
    n, size = record.time.size, control.shape[0]
    body = along_body(campaign, record)
    measured = {name: body.channel(name) for name in campaign.channels}
    weight = np.column_stack([np.isfinite(column) / campaign.noise[name] for name, column in measured.items()])
    plan = replace(alone, weight=filled(weight, size, 0.0))
    tried = _believed(campaign, alone.model)
    expected, *drawn = np.asarray(_shown(alone, tried, control))[:, :n]
    findings = [
        finding
        for name, column in measured.items()
        for finding in check_samples(name, column, campaign.noise[name], ATTITUDE if name in QUATERNION else name)
    ]
    findings += [*empty_cells(record), *check_thrusters(campaign, body)]
    driven = {name: record.channel(name) for name in alone.model.controls}
    findings += check_signs(plan.names, {**driven, **measured}, campaign.noise)
    findings += _stated(campaign, record)
    is_real, usual = record.provenance.source != SIMULATED, float(np.median(np.diff(record.time)))
    runs_away = not np.isfinite(expected).all()
    steps = _steps(campaign, record, alone, tried, control, expected) if is_real else []
    findings += steps
    if runs_away:
        if not steps:
            remedy = "check units and signs, or narrow the priors, so that the vehicle at their means can be simulated over this record"
            value = "the vehicle at the prior means runs away"
            findings.append(RecordFinding("motion", "direction", "caution", value, "it must not", remedy))
        return RecordJudgement(record, tuple(findings), tuple(record_cautions(record)))
    unsaid, summed = [], []
    turns = [name for name in measured if name in QUATERNION]
    for index, (name, column) in enumerate(measured.items()):
        if name in turns:
            continue
        if name in HELD:
            findings += check_range(name, column, expected[:, index], campaign.noise[name])
        ways = np.array([one[:, index] for one in drawn])
        if name in SUMMED:
            judged = check_sum(name, usual, column, expected[:, index], ways, campaign.noise[name], campaign.has_delay)
            findings += judged or []
            summed += [name] if judged is None else []
        elif says_direction(expected[:, index], ways, campaign.noise[name]):
            findings += check_motion(name, usual, column, expected[:, index], ways, campaign.has_delay)
        else:
            unsaid.append(name)
    mounting = check_mounts(campaign, body) if is_real else []
    findings += mounting
    for group in (one for one in SENSORS if not any(finding.signal.split(", ")[0] in one for finding in mounting)):
        said = [name for name in group if name in measured and name not in unsaid]
        if len(said) > 1:
            places = [campaign.channels.index(name) for name in said]
            findings += check_turn(said, np.column_stack([measured[name] for name in said]), expected[:, places])
    if turns:
        value = "not judged, nor size and delay; errors of all rates add up in it"
        findings.append(RecordFinding(ATTITUDE, "direction", "note", value, "the rates are judged"))
    if summed:
        findings.append(not_judged_sum(summed))
    if unsaid:
        findings.append(not_judged(unsaid))
    if unsaid or turns:
        findings += _excitation_as_moved(record, plan, priors, control)
    else:
        findings += _excitation(plan, priors, mean, control)
    return RecordJudgement(record, tuple(findings), tuple(record_cautions(record)))


def _steps(
    campaign: Campaign,
    record: Record,
    alone: TrialPlan,
    tried: Mapping[str, np.ndarray],
    control: np.ndarray,
    expected: np.ndarray,
) -> list[RecordFinding]:
    """Say where the vehicle at the prior means moves otherwise in steps half as long; of the first half, which has as many of them."""
    half, size = record.time.size // 2, control.shape[0]
    rates = [index for index, name in enumerate(campaign.channels) if name in RATES]
    if not half or not rates:
        return []
    finer = replace(alone, step=filled(np.repeat(np.asarray(alone.step)[:half], 2) / 2, size, 0.0))
    shown = np.asarray(_shown(finer, tried, filled(np.repeat(control[:half], 2, axis=0), size)))[0, : 2 * half : 2]
    noise = np.array([campaign.noise[campaign.channels[index]] for index in rates])
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.sqrt(np.mean(((shown - expected[:half])[:, rates] / noise) ** 2, axis=0))
    usual = float(np.median(np.diff(record.time)))
    names = ", ".join(campaign.channels[index] for index, far in zip(rates, off, strict=True) if not far <= COARSE)
    if not names or not np.isfinite(shown).all():
        return []
    differ = f"differs by up to {off.max():.2g} times the noise" if np.isfinite(off).all() else "does not run away"
    value = f"in steps half as long the simulated motion {differ}"
    remedy = f'the simulation\'s steps of {usual:.2g} s are too long for so quick a vehicle: step = "{usual / 4:.2g} s" under [import]'
    return [RecordFinding(names, "step", "caution", value, f"under {COARSE:g}", remedy)]


def _excitation(
    plan: TrialPlan, priors: tuple[Prior, ...], values: np.ndarray, control: np.ndarray, about: str = ""
) -> list[RecordFinding]:
    """What the record can tell, linearised at some values of the coefficients."""
    before = np.array([float(prior.sd) for prior in priors])
    information = np.asarray(plan.information(values, control))
    after = np.sqrt(np.diag(np.linalg.inv(information + np.diag(before**-2.0))))
    return check_excitation(plan.names, before, after, about)


def _excitation_as_moved(
    record: Record, plan: TrialPlan, priors: tuple[Prior, ...], control: np.ndarray
) -> list[RecordFinding]:
    """The same where the vehicle at the prior means does not move as this one did: at a fit of the measured motion."""
    found = first_guess(plan.model, [record], [tuple(plan.start)], dict(zip(plan.names, priors, strict=True)))
    if found:
        values = np.array([found[name] for name in plan.names])
        if np.isfinite(np.asarray(plan.motion(values, control))).all():
            return _excitation(plan, priors, values, control, "at a fit of the measured motion")
    reason = (
        "the vehicle fitted to the measured motion runs away" if found else "too few velocities are measured to fit it"
    )
    value = "not judged; the vehicle at the prior means does not move as this one did"
    remedy = "use priors of known sign"
    return [RecordFinding("all", "excitation", "note", value, f"but {reason}", remedy)]


@program
def _shown(plan: TrialPlan, values: Mapping[str, Array], control: Array) -> Array:
    """What the sensors would show of several vehicles, shape (d, n, m)."""
    return jax.vmap(lambda one: plan.shown(one, control))(values)
