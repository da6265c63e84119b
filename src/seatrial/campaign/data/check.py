"""Judges a campaign's records before anything is fitted to them: direction, size, timing, outliers, holes and excitation."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.sensor_table import ATTITUDE
from seatrial.campaign.data.import_logs import Trials
from seatrial.campaign.data.mount_check import SENSORS, along_body, check_mounts
from seatrial.campaign.data.record_cautions import empty_cells, record_cautions, unused_channels
from seatrial.campaign.data.thruster_check import check_thrusters, mirrored_thrusters
from seatrial.campaign.inference.posterior import initial_state
from seatrial.compiled.batching import bucket_length, filled
from seatrial.compiled.programs import program
from seatrial.compiled.random_keys import random_key
from seatrial.core.findings import LEVELS, Finding, Message, accept
from seatrial.core.record import SIMULATED, Record
from seatrial.core.signals import GAUGE_CHANNELS, QUATERNION, RATES
from seatrial.design.prior_belief import draw_values
from seatrial.design.trial_plan import TrialPlan
from seatrial.estimation.diagnostics.excitation_checks import check_excitation, check_signs
from seatrial.estimation.diagnostics.feedback_check import closed_loop, find_feedback, not_judged_in_loop
from seatrial.estimation.diagnostics.motion_checks import (
    SUMMED,
    check_motion,
    check_range,
    check_sum,
    check_turn,
    says_direction,
)
from seatrial.estimation.diagnostics.record_checks import (
    MAX_STEP_CHANGE,
    check_angle,
    check_limits,
    check_samples,
    check_trim,
    not_judged_yet,
)
from seatrial.estimation.posterior.first_guess import first_guess
from seatrial.estimation.priors import Prior, nominal
from seatrial.estimation.simulation.starts import first_measured, level_start
from seatrial.messages.catalogue import ENTRIES
from seatrial.messages.entry import filled_in
from seatrial.messages.render import remedy, sentence, statement
from seatrial.vehicles.model import VehicleModel

MOST_CAUSES = 3  # Findings that are repeated where no model explains a record
# Codes of what a record cannot determine, which is no fault of it
NO_CAUSE = ("not-excited", "rate-not-measured", "terms-alike", "limits-exceeded", "limits-hardly-used")
# Standard deviation of a motion over its sensor's noise from which the part of a trial that has come tells its
# direction
MOVES = 2.0
# Vehicles drawn from the priors, beside the one at their nominal values, to see whether they go the same way
MAX_PRIOR_VEHICLES = 32


@dataclass(frozen=True, eq=False)
class RecordJudgement:
    """What was found about one record.

    Attributes:
        record: it.
        findings: every check, also those that pass.
        cautions: holes and controls that never move.
    """

    record: Record
    findings: tuple[Finding, ...]
    cautions: tuple[Message, ...]

    @property
    def level(self) -> str:
        """The gravest."""
        levels = {finding.level for finding in self.findings}
        return "alarm" if "alarm" in levels else "caution" if "caution" in levels or self.cautions else "pass"

    def lines(self) -> list[str]:
        """A headline, one line for each finding with its remedy below it, and what passes."""
        head = f"record {self.record.label}: {self.level}; {self.record.time.size} samples over {self.record.time[-1]:.1f} s"
        lines, passed = [head], dict[str, list[str]]()
        for finding in sorted(self.findings, key=lambda one: LEVELS.index(one.level)):
            if finding.level == "pass":
                check = filled_in(ENTRIES[finding.code].template("pass"), finding.subject, finding.values)
                passed.setdefault(check, []).extend(finding.subject)
                continue
            lines.append(f"  {finding.level:<8}{statement(finding)}")
            lines += [f"          -> {do}"] if (do := remedy(finding)) else []
        lines += [f"  caution {one if isinstance(one, str) else sentence(one)}" for one in self.cautions]
        fine = "; ".join(f"{check} of {', '.join(signals)}" for check, signals in passed.items())
        return [*lines, *((f"  pass    {fine}",) if fine else ())]


def check_records(campaign: Campaign, trials: Trials) -> list[RecordJudgement]:
    """Judge every record, fitted and held back; vehicles of the priors say what is expected, as far as they agree."""
    return _judge_all(campaign, (*trials.fit, *trials.predict))


def record_doubts(campaign: Campaign, record: Record) -> list[Message]:
    """Return what to know of a record before a fit to it is believed, without a simulation or a fit."""
    doubts = [one.among(run=record.label) for one in _stated(campaign, record) if one.level not in ("pass", "note")]
    return [*record_cautions(record), *doubts]


def likely_causes(campaign: Campaign, records: Sequence[Record]) -> list[Message]:
    """Return the gravest findings about some records, at most three: why no model may explain them."""
    judged = _judge_all(campaign, records)
    findings = [
        one.among(run=judgement.record.label)
        for judgement in judged
        for one in judgement.findings
        if one.code not in NO_CAUSE
    ]
    alarms, cautions = ([one for one in findings if one.level == level] for level in ("alarm", "caution"))
    holes = [text for judgement in judged for text in judgement.cautions]
    return [*alarms, *holes, *cautions][:MOST_CAUSES]


def summary_line(judged: Sequence[RecordJudgement]) -> str:
    """Count alarms and cautions of all records, and recommend whether to go on."""
    alarms = sum(finding.level == "alarm" for one in judged for finding in one.findings)
    cautions = sum(finding.level == "caution" for one in judged for finding in one.findings)
    cautions += sum(len(one.cautions) for one in judged)
    counted = ", ".join(
        f"{count} {word}{'s' * (count != 1)}" for count, word in ((alarms, "alarm"), (cautions, "caution"))
    )
    if alarms:
        return f"in all {counted}: correct each alarm before you estimate"
    return f"in all {counted}: " + (
        "look at each caution, then continue with `estimate`" if cautions else "continue with `estimate`"
    )


def _stated(campaign: Campaign, record: Record) -> list[Finding]:
    """Compare a record with what the campaign states: limits, and of a real one the trim."""
    driven = {name: record.channel(name) for name in campaign.model(campaign.full).controls}
    findings: list[Finding] = []
    for name, column in driven.items():
        wrong = check_angle(name, column)
        bounds = campaign.control_limits.get(name)
        findings += wrong if wrong or bounds is None else check_limits(name, column, bounds)
    if record.provenance.source == SIMULATED:
        return findings
    measured = {name: record.channel(name) for name in campaign.channels}
    return findings + check_trim(campaign.hull.trim, driven, measured)


def step_cautions(campaign: Campaign, trials: Trials) -> list[Finding]:
    """Report of which fitted records the steps are too long to simulate this vehicle, by the nominal values of the priors."""
    findings = []
    for record in (one for one in trials.fit if one.provenance.source != SIMULATED):
        model = campaign.model(campaign.full)
        alone, control = _trial(campaign.channels, record, model, initial_state(campaign, model, record))
        mean = {name: values[:1] for name, values in _believed(campaign, alone.model).items()}
        expected = np.asarray(_shown(alone, mean, control))[0, : record.time.size]
        steps = _steps(campaign, record, alone, mean, control, expected)
        findings += [one.among(run=record.label) for one in steps]
    return findings


def motion_findings(campaign: Campaign, record: Record, size: int) -> list[Finding]:
    """Judge the part of a trial that has come: what moves against the commands, along other axes or by another size.

    A channel that hardly moves, or would hardly, is not judged.

    Args:
        campaign: the campaign.
        record: so far; a channel may be NaN throughout.
        size: samples to which it is filled up, so that one compiled program serves parts of any length.
    """
    model = campaign.model(campaign.full)
    start = level_start(model, {**campaign.hull.trim, **first_measured(record)})
    alone, control = _trial(campaign.channels, record, model, start, size)
    motion = _motion(campaign, along_body(campaign, record), alone, control)
    if not np.isfinite(motion.expected).all():
        return []
    moves = {
        name: np.isfinite(column).any()
        and min(float(np.nanstd(column)), float(motion.expected[:, index].std())) > MOVES * campaign.noise[name]
        for index, (name, column) in enumerate(motion.measured.items())
    }
    return _directions(campaign, record, motion, [name for name, is_so in moves.items() if is_so]).findings


@dataclass(frozen=True, eq=False)
class _Motion:
    """A record beside what vehicles of the priors do by its commands; n samples, m channels, d vehicles.

    Attributes:
        tried: each coefficient and unknown, at the prior means and then drawn, SI, shape (1 + d,).
        expected: of the first, SI, shape (n, m).
        drawn: of the others, SI, shape (d, n, m).
        measured: by channel, SI, NaN if not measured.
    """

    tried: Mapping[str, np.ndarray]
    expected: np.ndarray
    drawn: np.ndarray
    measured: dict[str, np.ndarray]


def _motion(campaign: Campaign, body: Record, alone: TrialPlan, control: np.ndarray) -> _Motion:
    """Return a record whose sensors look along the body beside what vehicles of the priors do."""
    tried = _believed(campaign, alone.model)
    shown = np.asarray(_shown(alone, tried, control))[:, : body.time.size]
    return _Motion(tried, shown[0], shown[1:], {name: body.channel(name) for name in campaign.channels})


def _trial(
    channels: tuple[str, ...], record: Record, model: VehicleModel, start: tuple[float, ...], size: int = 0
) -> tuple[TrialPlan, np.ndarray]:
    """Return a record as a trial in which every sensor gives each sample, without noise, and its controls; both filled up."""
    size = max(size, bucket_length(record.time.size))
    step = filled(np.diff(record.time), size, 0.0)
    control = filled(np.column_stack([record.channel(name) for name in model.controls]), size)
    return TrialPlan(model, channels, np.array(start), step, np.ones((size, len(channels)))), control


def _believed(campaign: Campaign, model: VehicleModel) -> dict[str, np.ndarray]:
    """Return the vehicle at nominal values, and some drawn from the priors: each coefficient and unknown, SI, shape (1 + d,)."""
    names = (*(term.text for term in model.coefficients), *(one.name for one in model.unknowns))
    priors = tuple(campaign.prior(name) for name in names)
    drawn = draw_values(priors, random_key(campaign.seed, "vehicles of the priors"), MAX_PRIOR_VEHICLES)
    tried = np.vstack([list(map(nominal, priors)), drawn])
    return dict(zip(names, tried.T, strict=True))


def _judge_all(campaign: Campaign, records: Sequence[Record]) -> list[RecordJudgement]:
    """Judge records, all filled up to the longest: that takes less than to compile for each length."""
    size = max((bucket_length(one.time.size) for one in records), default=0)
    return [_judge(campaign, one, size) for one in records]


def _judge(campaign: Campaign, record: Record, size: int) -> RecordJudgement:
    model = campaign.model(campaign.full)
    alone, control = _trial(campaign.channels, record, model, initial_state(campaign, model, record), size)
    body = along_body(campaign, record)
    motion = _motion(campaign, body, alone, control)
    measured = motion.measured
    weight = np.column_stack([np.isfinite(column) / campaign.noise[name] for name, column in measured.items()])
    plan = replace(alone, weight=filled(weight, control.shape[0], 0.0))
    heavy = {sensor.channel for sensor in campaign.sensor_models if sensor.noise == "heavy"}
    findings = [
        finding
        for name, column in measured.items()
        for finding in check_samples(
            name, column, campaign.noise[name], ATTITUDE if name in QUATERNION else name, name in heavy
        )
    ]
    findings += [*empty_cells(record), *unused_channels(campaign.channels, campaign.model(campaign.full), record)]
    driven = {name: record.channel(name) for name in alone.model.controls}
    findings += check_signs(plan.names, {**driven, **measured}, campaign.noise)
    findings += _stated(campaign, record)
    is_real = record.provenance.source != SIMULATED
    steps = _steps(campaign, record, alone, motion.tried, control, motion.expected) if is_real else []
    findings += steps
    if not np.isfinite(motion.expected).all():
        if not steps:
            findings.append(Finding("motion-diverges", "caution", ("motion",), {}, ("tame-priors",)))
        findings += check_thrusters(campaign, body)
        return _judgement(campaign.accepted, record, findings, record_cautions(record))
    for index, (name, column) in enumerate(measured.items()):
        if name in GAUGE_CHANNELS:
            findings += check_range(name, column, motion.expected[:, index], campaign.noise[name])
    turns = [name for name in measured if name in QUATERNION]
    doubted = {one.subject[0] for one in findings if one.code == "trim-contradicted"}
    judged = _directions(campaign, record, motion, list(measured), doubted)
    mounting = _mounting(campaign, body, judged.findings) if is_real else []
    turned = {one.subject for one in mounting}
    moved = [one for one in judged.findings if one.code != "axes-wrong" or one.subject not in turned] + mounting
    findings += closed_loop(judged.feedback)
    wrong = [one for one in moved if one.level == "alarm"]
    late = [one for one in moved if one.code == "clock-shift" and one.level == "caution"]
    findings += [*moved, *check_thrusters(campaign, body, [*wrong, *late], judged.feedback)]
    if summed := (*((ATTITUDE,) if turns else ()), *judged.summed):
        findings.append(Finding("sum-not-judged", "note", summed))
    if judged.unsaid:
        findings.append(Finding("direction-not-judged", "note", tuple(judged.unsaid), {}, ("signed-priors",)))
    priors = campaign.coefficient_priors(alone.model)
    if wrong:
        findings.append(not_judged_yet(["all"], "not-excited", wrong))
    elif judged.unsaid or turns:
        findings += _excitation_as_moved(record, plan, priors, control)
    else:
        findings += _excitation(plan, priors, np.array(list(map(nominal, priors))), control)
    return _judgement(campaign.accepted, record, findings, record_cautions(record, judged.feedback))


def _judgement(
    accepted: frozenset[str], record: Record, findings: Sequence[Finding], cautions: Sequence[Message]
) -> RecordJudgement:
    """Return a judgement in which accepted findings are notes."""
    holes = [one for one in cautions if isinstance(one, str) or one.code not in accepted]
    return RecordJudgement(record, tuple(accept(findings, accepted)), tuple(holes))


class _Directions(NamedTuple):
    """Findings about channels; those of which the priors allow no verdict: rates and speeds, and what errors add up in; closed loops."""

    findings: list[Finding]
    unsaid: list[str]
    summed: list[str]
    feedback: Mapping[str, Sequence[str]]


def _mounting(campaign: Campaign, body: Record, wrong_axes: Sequence[Finding]) -> list[Finding]:
    """Return which sensors are turned, but for those whose axes are found wrong already: swapped, mirrored or of the other convention."""
    wrong = {one.subject for one in wrong_axes if one.code == "axes-wrong" and one.level == "alarm"}
    return [one for one in check_mounts(campaign, body) if one.subject not in wrong]


def _directions(
    campaign: Campaign, record: Record, motion: _Motion, names: Sequence[str], doubted: Collection[str] = ()
) -> _Directions:
    """Judge direction, size, timing and axes of some channels; of those that are `doubted` by the trim, that tells the unit better."""
    expected = {name: motion.expected[:, index] for index, name in enumerate(motion.measured)}
    directions = _Directions([], [], [], find_feedback(record, campaign.noise, expected))
    driving = tuple(campaign.model(campaign.full).controls)
    files, mirrored = _other_files(record, driving), mirrored_thrusters(campaign.vehicle, campaign.full)
    places = {name: index for index, name in enumerate(motion.measured) if name in names and name not in QUATERNION}
    for name, index in places.items():
        measured, expected, ways = motion.measured[name], motion.expected[:, index], motion.drawn[:, :, index]
        if name in SUMMED:
            judged = check_sum(name, record.time, measured, expected, ways, campaign.noise[name], campaign.has_delay)
            directions.findings.extend(judged or [])
            directions.summed.extend([name] if judged is None else [])
        elif says_direction(expected, ways, campaign.noise[name]):
            directions.findings.extend(
                check_motion(
                    name,
                    record.time,
                    measured,
                    expected,
                    ways,
                    campaign.has_delay,
                    driving,
                    name in doubted,
                    files.get(name, ""),
                    mirrored.get(name, ()),
                )
            )
        else:
            directions.unsaid.append(name)
    for group in SENSORS:
        said = [name for name in group if name in places and name not in directions.unsaid]
        if len(said) > 1:
            shown = np.column_stack([motion.measured[name] for name in said])
            directions.findings.extend(check_turn(said, shown, motion.expected[:, [places[name] for name in said]]))
    return directions._replace(findings=not_judged_in_loop(directions.findings, directions.feedback))


def _other_files(record: Record, controls: Collection[str]) -> dict[str, str]:
    """Return the file of each channel that is not in that of all controls: its clock may be another."""
    place = {
        name: (number, file["source"])
        for number, file in enumerate(record.provenance.options.get("files", ()))
        for name in file["channels"]
    }
    driving = {place.get(name) for name in controls}
    return {name: of[1] for name, of in place.items() if driving != {of}}


def _steps(
    campaign: Campaign,
    record: Record,
    alone: TrialPlan,
    tried: Mapping[str, np.ndarray],
    control: np.ndarray,
    expected: np.ndarray,
) -> list[Finding]:
    """Report where the vehicle at the prior means moves otherwise in steps half as long; of the first half, which has as many of them."""
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
    names = tuple(campaign.channels[index] for index, far in zip(rates, off, strict=True) if not far <= MAX_STEP_CHANGE)
    if not names or not np.isfinite(shown).all():
        return []
    differs = float(off.max()) if np.isfinite(off).all() else 0.0  # none of a motion that diverges
    values = {"step": usual, "differs": differs, "shorter": usual / 4}
    return [Finding("steps-too-coarse", "caution", names, values, ("shorter-step",))]


def _excitation(
    plan: TrialPlan, priors: tuple[Prior, ...], values: np.ndarray, control: np.ndarray, about: str = ""
) -> list[Finding]:
    """What the record can tell, linearised at some values of the coefficients."""
    before = np.array([float(prior.sd) for prior in priors])
    information = np.asarray(plan.information(values, control))
    after = np.sqrt(np.diag(np.linalg.inv(information + np.diag(before**-2.0))))
    return check_excitation(plan.names, before, after, about, plan.channels)


def _excitation_as_moved(
    record: Record, plan: TrialPlan, priors: tuple[Prior, ...], control: np.ndarray
) -> list[Finding]:
    """The same where the vehicle at the prior means does not move as this one did: at a fit of the measured motion."""
    guess = first_guess(plan.model, [record], [tuple(plan.start)], dict(zip(plan.names, priors, strict=True)))
    if guess:
        values = np.array([guess[name] for name in plan.names])
        if np.isfinite(np.asarray(plan.motion(values, control))).all():
            return _excitation(plan, priors, values, control, "fit")
    return [Finding("excitation-not-judged", "note", ("all",), {"fitted": bool(guess)}, ("signed-priors",))]


@program
def _shown(plan: TrialPlan, values: Mapping[str, Array], control: Array) -> Array:
    """What the sensors would show of several vehicles, shape (d, n, m)."""
    return jax.vmap(lambda one: plan.shown(one, control))(values)
