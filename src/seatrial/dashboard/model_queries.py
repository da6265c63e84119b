"""Questions that need the vehicle and so the whole package; answered in the thinking process."""

import tempfile
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from seatrial.campaign.config.campaign import Campaign
from seatrial.campaign.config.load import check_text, load_campaign
from seatrial.campaign.config.priors import numbers_of
from seatrial.campaign.config.toml import toml_content
from seatrial.campaign.config.vehicle_campaign import vehicle_campaign_text
from seatrial.campaign.data.import_logs import Trials, read_tables, read_untrimmed
from seatrial.campaign.data.simulate import chosen_of
from seatrial.campaign.data.unmapped import unmapped
from seatrial.campaign.design.problem import plan_of, prior_draws
from seatrial.campaign.design.schedule import write_schedule
from seatrial.campaign.design.sweep import designs_of
from seatrial.campaign.inference.judge_predictions import predict_held_back
from seatrial.campaign.prior.cautions import file_cautions
from seatrial.campaign.store.results import Results
from seatrial.campaign.store.stored_result import StepState, Store, read_result
from seatrial.campaign.workflow.status import standing
from seatrial.cli.campaign_text import CAMPAIGN, read_file
from seatrial.cli.questions import Question, answered, published_of, question, questions
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError
from seatrial.core.normal import Z90
from seatrial.core.record import Record
from seatrial.core.record_file import read_record
from seatrial.core.signals import RATES
from seatrial.core.units import quantity
from seatrial.core.usual_priors import USUAL_SHARE
from seatrial.dashboard import result_plots as drawings
from seatrial.dashboard.downsample import Envelope, Load, load_of
from seatrial.dashboard.logs import StampedColumn, isolated, samples_of
from seatrial.dashboard.record_views import Index, about, in_shown, index_of, origin_of, view_of
from seatrial.dashboard.terms import usual_terms
from seatrial.dashboard.tweak_queries import start_text as start_text
from seatrial.dashboard.tweak_queries import tweaked as tweaked
from seatrial.dashboard.view_models import (
    COMPARED,
    AxisAbout,
    Clicked,
    ExportTarget,
    FormData,
    Margin,
    OfferedTerm,
    RecordAbout,
)
from seatrial.design.integrals import motion_signals
from seatrial.design.results import SweptDesigns
from seatrial.design.safety import judge_safety
from seatrial.design.sweep import Sweep
from seatrial.design.trial_design import plan_as_run
from seatrial.export.from_campaign import of_campaign
from seatrial.export.target import Exporter
from seatrial.export.trials.trial import read_trial
from seatrial.export.trials.write import FORMATS, check_format
from seatrial.export.vehicle import ExportedVehicle, same_mass
from seatrial.export.write import carried_by, check_exportable, exporter_names, make_exporter
from seatrial.logs.align import common_interval
from seatrial.manoeuvres.family import design_words
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.manoeuvres.schedule import schedule_of
from seatrial.vehicles.catalogue import load_vehicle, vehicle_names

MOST_PREDICTED = 100_000
"""Samples of a record that are predicted while somebody waits, at most: 200 draws are simulated over each."""

OF_CHAINS = ("initial", "residuals", "sampler", "chains", "warmup", "draws", "thin")
"""Keys of `[estimation]` that need nothing else in the file."""
Answers = tuple[tuple[str, str], ...]  # As they are typed, by key


def steps(folder: str) -> tuple[StepState, ...]:
    """Which steps are current."""
    return standing(Path(folder))


def ready() -> bool:
    """Return True once everything is imported, units are known, and JAX has found its device."""
    quantity("1 rpm", "rad/s", "nothing")
    return drawings.ready() and bool(jnp.zeros(1).sum() == 0)


def export_rests(folder: str) -> tuple[str, ...]:
    """Published vehicles from which may be taken what a campaign does not model: whole ones that agree with what it does."""
    try:
        alone, _ = of_campaign(folder)
    except InputError:
        return ()
    published = {name: load_vehicle(name) for name in vehicle_names()}
    return tuple(
        name
        for name, one in published.items()
        if set(one.moves) == set(RATES) and one.written is None and same_mass(alone.hull, one.hull)
    )


def export_targets(folder: str, rest: str) -> tuple[ExportTarget, ...]:
    """Ask each target whether it can hold what the campaign has, and what of it the target does not support.

    Args:
        folder: of the campaign.
        rest: published vehicle that supplies what it does not model; empty for none.
    """
    place = Path(folder) / "export" / "trial"
    found, refusal = _tried(of_campaign, folder, rest=rest or None)
    targets = [
        ExportTarget(name, False, refusal, ()) if refusal else _export_target(make_exporter(name), found[0])
        for name in exporter_names()
    ]
    trial, refusal = _tried(read_trial, folder)
    of_trial = ((name, refusal or _tried(check_format, trial, name, place)[1]) for name in FORMATS)
    return *targets, *(ExportTarget(name, True, refusal, ()) for name, refusal in of_trial)


def _export_target(exporter: Exporter, vehicle: ExportedVehicle) -> ExportTarget:
    _, refusal = _tried(check_exportable, exporter, vehicle)
    return ExportTarget(exporter.name, False, refusal, () if refusal else carried_by(exporter, vehicle).lost)


def _tried(question: Callable[..., Any], *about: Any, **more: Any) -> tuple[Any, str]:
    """Return an answer, and why there is none: as a sentence, or empty."""
    try:
        return question(*about, **more), ""
    except InputError as error:
        return None, error.sentence()


def form_data(folder: str) -> FormData:
    """Read a campaign for the forms."""
    campaign = load_campaign(folder)
    controls, imports = campaign.model(campaign.full).controls, campaign.imports
    return FormData(
        imports is not None,
        campaign.is_simulated,
        (*controls, *campaign.channels),
        tuple(controls),
        () if imports is None else imports.fit,
        () if imports is None else imports.predict,
    )


def limits_form(folder: str) -> tuple[str, tuple[Question, ...]]:
    """Return the text of a campaign file, and questions about the limits of every signal that may have some, stated ones first."""
    campaign = load_campaign(folder)
    model = campaign.model(campaign.full)
    control = model.controls[0] if campaign.trial_design is None else campaign.family.control
    commands, stated = (*model.controls, *campaign.autopilot.trim), toml_content(campaign.path, campaign.text)
    names = dict.fromkeys((control, *stated.get("limits", {}), *commands, *motion_signals(model)))
    bounds = {f"limits.{name}": ("lower", "upper", "rate")[: 3 if name in commands else 2] for name in names}
    units = {f"limits.{name}": shown_unit(name)[1] for name in names}
    return campaign.text, tuple(
        one._replace(default=f"none; such as 1 {units[table]}{'/s' * (key == 'rate')}")
        for one in questions(campaign.text, bounds)
        for table, _, key in [one.key.rpartition(".")]
    )


def model_form(folder: str) -> tuple[str, tuple[Question, ...]]:
    """Return the text of a campaign file, and the questions about its terms, priors, noise and chains."""
    text = read_file(Path(folder))
    return text, asked_of_model(text, ())


def asked_of_model(text: str, answers: Answers) -> tuple[Question, ...]:
    """Return the questions about the model of a campaign file that some answers leave; errors as `edited`."""
    text = answered(text, dict(answers))
    content = toml_content(CAMPAIGN, text)
    tables: dict[str, Sequence[str]] = {"structure": ("always", "optional", "rules")}
    for name, prior in content.get("prior", {}).items():
        tables[f"prior.{name}"] = ("distribution", *numbers_of(prior.get("distribution")), "unit")
    tables |= {f"sensors.{name}": ("residuals",) for name in content.get("sensors", {})}
    return questions(text, {**tables, "estimation": OF_CHAINS})


def offered_terms(folder: str) -> tuple[OfferedTerm, ...]:
    """Return the usual terms of the vehicle of a campaign; none if its file cannot be used."""
    try:
        campaign = load_campaign(folder)
    except InputError:
        return ()
    vehicle = toml_content(campaign.path, campaign.text)["vehicle"]
    published, model, terms = published_of(vehicle), campaign.model(campaign.full), []
    for name in usual_terms(model.states, (*model.controls, *campaign.hull.trim)):
        prior = "Nothing is published of it: its prior is a range to correct."
        if value := published.get(name):
            share = vehicle.get("published_prior_sd", f"{USUAL_SHARE:.0%}")
            prior = (
                f"Published value {value:.4g}: its prior is normal about that, with a standard deviation of {share}."
            )
        terms.append(OfferedTerm(name, prior))
    return tuple(terms)


def beginning(folder: str, vehicle: str, log: str = "", named: str = "") -> tuple[str, tuple[Question, ...]]:
    """Return the file of a new campaign as `seatrial init` writes it, and the questions about it.

    Args:
        folder: where it is to stand.
        vehicle: published one; empty for one's own.
        log: of a trial; empty before there is one.
        named: path of the log from the campaign's folder, as it will be.

    Raises:
        InputError: as `vehicle_campaign_text`, or a log that takes too much.
    """
    about = Path(folder), vehicle, Path(log) if log else None, named
    text = isolated(log, vehicle_campaign_text, *about) if log else vehicle_campaign_text(*about)
    return text, asked(text, ())


def asked(text: str, answers: Answers) -> tuple[Question, ...]:
    """Return the questions about a new campaign that some answers leave, limits of its control always; errors as `edited`."""
    text = answered(text, dict(answers))
    control = toml_content(CAMPAIGN, text)["design"]["control"]
    unit, ends = shown_unit(control)[1], [("limits", control, key) for key in ("lower", "upper")]
    limits = {".".join(one): question(one, None)._replace(default=f"none; such as 1 {unit}") for one in ends}
    there = {one.key: one for one in questions(text) if one.key != "campaign.name"}
    return tuple((there | {key: one for key, one in limits.items() if key not in there}).values())


def edited(folder: str, text: str, answers: Answers) -> tuple[str, tuple[str, ...]]:
    """Return the text of a campaign file with other values, checked, and what to know about it though it can be used.

    Raises:
        InputError: what is wrong with it.
    """
    text = answered(text, dict(answers))
    return text, check(folder, text)


def check(folder: str, text: str) -> tuple[str, ...]:
    """Check a campaign file before it is written; returns what to know about it though it can be used.

    Raises:
        InputError: what is wrong with it.
    """
    return tuple(file_cautions(check_text(Path(folder), text)))


def channels_without_column(folder: str, text: str) -> dict[str, str]:
    """Return the channels that a campaign file needs of its logs and does not map, each with the reason.

    Raises:
        InputError: what is wrong with it.
    """
    return unmapped(check_text(Path(folder), text))


def cautions(folder: str) -> tuple[str, ...]:
    """Return what to know about a campaign file before a trial, though it can be used."""
    return tuple(file_cautions(load_campaign(folder)))


def look_at(folder: str, which: str, family: int, row: int, column: int) -> Clicked:
    """Look at one design of a stored sweep: its control, its room inside every limit, and its schedule.

    Args:
        folder: of the campaign.
        which: `design` or `next`.
        family: as the file counts them.
        row: of its amplitude.
        column: of its period.
    """
    campaign, store = load_campaign(folder), Store(Path(folder))
    path = store.design if which == "design" else store.next_design
    stored = read_result(SweptDesigns, path, f"seatrial {which} {folder}")
    kind = stored.families[family]
    sweep = next(one for one in designs_of(campaign, stored).sweeps if one.family.kind == kind)
    if not (0 <= row < sweep.amplitude.size and 0 <= column < sweep.period.size):
        raise InputError("design", found="none there", expected="one of the grid", remedy="reload the page")
    chosen = chosen_of(sweep, (row, column))
    manoeuvre = chosen.manoeuvre(campaign.families)
    planned = schedule_of(manoeuvre, sweep.family.sample_time)
    with tempfile.TemporaryDirectory() as place:
        schedule = write_schedule(Path(place) / "schedule.csv", manoeuvre, sweep.family.sample_time).read_text()
    margins = (
        *_of_control(campaign.limits, sweep, planned.controls[manoeuvre.control]),
        *_of_motion(campaign, which, sweep, (row, column)),
    )
    words, values = design_words(sweep.family, chosen.amplitude, chosen.period), planned.controls[manoeuvre.control]
    return Clicked(words, np.asarray(planned.time), values * shown_unit(manoeuvre.control)[0], margins, schedule)


def whole_log(folder: str, run: str, files: tuple) -> RecordAbout:
    """Return what the files of a run hold, before any trimming; read again when the files change, of which `files` tells."""
    record, _ = _untrimmed(folder, run, files)
    roles = {channel.name: str(channel.role) for channel in record.channels}
    provenance = record.provenance
    return about(roles, record.time.size, float(record.time[-1]), provenance.options, provenance.source)


def whole_log_view(folder: str, run: str, files: tuple, start: float, end: float, columns: int) -> dict[str, Envelope]:
    """Curves of `whole_log` between two times, in the units in which they are shown."""
    record, index = _untrimmed(folder, run, files)
    curves = view_of(index, _rows(record), start, end, columns)
    return {name: in_shown(name, curve) for name, curve in curves.items()}


def axis_about(folder: str, text: str, run: str, files: tuple, compared: tuple[StampedColumn, ...] = ()) -> AxisAbout:
    """Return which channels the logs of a run would give, by a campaign file that is not saved yet, and when each was recorded.

    Args:
        folder: of the campaign.
        text: of the file.
        run: label of the record.
        files: stamps of the logs.
        compared: columns that are drawn one over another.
    """
    tracks = _tracks(folder, text, run, files, compared)
    spans = [(float(one.time[0]), float(one.time[-1])) for one in tracks.values()]
    channels = [(*span, one.role) for span, one in zip(spans, tracks.values(), strict=True) if one.role != COMPARED]
    return AxisAbout(
        tuple(tracks),
        tuple("" if one.role == COMPARED else shown_unit(name)[1] for name, one in tracks.items()),
        tuple(one.role for one in tracks.values()),
        tuple(one.log for one in tracks.values()),
        tuple(spans),
        common_interval(channels),
    )


def axis_view(
    folder: str,
    text: str,
    run: str,
    files: tuple,
    compared: tuple[StampedColumn, ...],
    start: float,
    end: float,
    columns: int,
) -> dict[str, Envelope]:
    """Curves of `axis_about` between two times, in the units in which they are shown."""
    curves = {}
    for name, one in _tracks(folder, text, run, files, compared).items():
        (curve,) = view_of(one.index, one.load, start, end, columns).values()
        curves[name] = curve if one.role == COMPARED else in_shown(name, curve)
    return curves


def candidate(folder: str, label: str, run: str) -> dict[str, np.ndarray]:
    """Predict one record by one structure, as `seatrial predict` does by the chosen one.

    Returns:
        `time` in s, and of each channel its mean and the ends of its 90 % band in the unit in which it is shown, each of shape (n,).

    Raises:
        InputError: a structure without a posterior, or a record too long.
    """
    campaign, store = load_campaign(folder), Store(Path(folder))
    record = read_record(store.record(run))
    if record.time.size > MOST_PREDICTED:
        raise InputError(
            f"run {run}",
            found=f"{record.time.size} samples",
            expected=f"at most {MOST_PREDICTED} to predict from the page",
            remedy="cut the record, or give [import] a step",
        )
    estimate = Results(Path(folder)).posterior(label)
    (curves,) = predict_held_back(campaign, estimate, Trials((record,), (record,), "")).curves
    columns = {"time": curves["time"] + origin_of(record.provenance.options, record.provenance.source)}
    for at, name in enumerate(campaign.channels):
        mean, sd, factor = curves["mean"][:, at], curves["sd"][:, at], shown_unit(name)[0]
        for part, values in ((name, mean), (f"{name} lower", mean - Z90 * sd), (f"{name} upper", mean + Z90 * sd)):
            columns[part] = values * factor
    return columns


class _Track(NamedTuple):
    """One channel or column of a log on the clock that all of them share: its times, s, its rows without gaps, and their index."""

    log: str
    role: str
    time: np.ndarray
    load: Load
    index: Index


@lru_cache(maxsize=1)
def _tracks(folder: str, text: str, run: str, files: tuple, compared: tuple[StampedColumn, ...]) -> dict[str, _Track]:
    """What is compared, then the channels of the logs of a run, measurements first; s from the earliest stamp of these logs."""
    del files  # part of the key only
    tables = read_tables(check_text(Path(folder), text), run)
    origin, tracks = min(table.epoch for table in tables), {}
    for column in compared:
        epoch, (time, values) = samples_of(column)
        log = Path(column.path).name
        if np.isfinite(values).any():
            scaled = (values - np.nanmean(values)) / (np.nanstd(values) or 1.0)
            tracks[f"{column.name} · {log}"] = _track(log, COMPARED, time + float(epoch - origin), scaled)
    for role in ("measurement", "control"):
        for table in tables:
            for channel in table.channels:
                if channel.role == role:
                    time = table.time + float(table.epoch - origin)
                    tracks[channel.name] = _track(table.source, role, time, table.columns[channel.name])
    return tracks


def _track(log: str, role: str, time: np.ndarray, values: np.ndarray) -> _Track:
    known = np.isfinite(values)
    rows = {"time": time[known], "value": values[known]}
    return _Track(log, role, rows["time"], load_of(rows), index_of(rows["time"].size, load_of(rows)))


@lru_cache(maxsize=1)
def _untrimmed(folder: str, run: str, files: tuple) -> tuple[Record, Index]:
    """The files of a run as one record, and its index."""
    del files  # part of the key only
    record = read_untrimmed(load_campaign(folder), run)
    return record, index_of(record.time.size, _rows(record))


def _rows(record: Record) -> Load:
    channels = {name: record.channel(name) for name in (*record.measured, *record.controls)}
    return load_of({"time": record.time, **channels})


def _of_control(limits: Limits, sweep: Sweep, values: np.ndarray) -> list[Margin]:
    control = sweep.family.control
    factor, unit = shown_unit(control)
    fastest = float(np.abs(np.diff(values)).max(initial=0.0) / sweep.family.sample_time)
    rows = [
        (f"{control} at least", limits.lower, float(values.min()), 1, unit),
        (f"{control} at most", limits.upper, float(values.max()), -1, unit),
        (f"rate of {control} at most", limits.rate, fastest, -1, f"{unit}/s"),
    ]
    charts = []
    for what, bound, reached, sign, shown in rows:
        if bound is not None:
            room = sign * (reached - bound) * factor
            kept = room >= -1e-9 * max(1.0, abs(bound * factor))
            charts.append(
                Margin(
                    what,
                    f"{bound * factor:.4g} {shown}",
                    f"{reached * factor:.4g} {shown}",
                    f"{room:.3g} {shown}",
                    kept,
                )
            )
    return charts


def _of_motion(campaign: Campaign, which: str, sweep: Sweep, at: tuple[int, int]) -> list[Margin]:
    """Room inside the limits of the motion, over draws of what is believed."""
    if not campaign.motion_limits:
        return []
    model, draws = _believed(campaign, which)
    plan = plan_of(campaign, model)
    if sweep.length is not None and np.isfinite(sweep.length[at]):
        plan = (
            plan_as_run(plan, sweep)
            if at == sweep.best
            else plan.until(round(float(sweep.length[at]) / sweep.family.sample_time))
        )
    controls = sweep.controls(*at)[: plan.step.shape[0]][None]
    probability = campaign.design.probability
    safety = judge_safety(plan, controls, draws, campaign.motion_limits, probability)
    charts = []
    for i, limit in enumerate(safety.limits):
        factor, unit = limit.shown
        room = float(safety.margin[0, i]) * factor
        reached = f"kept in {int(safety.held[0, :, i].sum())} of {safety.draws} draws"
        charts.append(Margin(limit.words, f"probability {probability:g}", reached, f"{room:.3g} {unit}", room >= 0))
    return charts


def _believed(campaign: Campaign, which: str):
    """Model, and draws of its coefficients that had no part in choosing the design."""
    if which == "design":
        model = campaign.model(campaign.full)
        draws = prior_draws(campaign, model)
        return model, draws[len(draws) // 2 :]
    results = Results(campaign.folder)
    estimate = results.posterior(results.next_design().basis.removeprefix("the posterior of "))
    model = campaign.model(estimate.structure)
    table = estimate.draws([campaign.in_next_trial(term.text) for term in model.coefficients])
    return model, table[:: max(1, len(table) // 400)][:400]
