"""Reading a campaign's TOML file: whatever is wrong with it is found before any work is done."""

from collections.abc import Collection, Mapping, Sequence
from math import inf
from pathlib import Path
from textwrap import indent

from seatrial.campaign.config.assumed_unknowns import assumed_unknowns, check_disturbances
from seatrial.campaign.config.autopilot_table import AutopilotSettings, read_autopilot
from seatrial.campaign.config.campaign import Campaign, sensor_models
from seatrial.campaign.config.design_table import check_design, check_utility, read_limits, read_own, read_power
from seatrial.campaign.config.earlier_campaigns import found_before, unknowns_before, with_fixed, with_known
from seatrial.campaign.config.import_table import read_imports
from seatrial.campaign.config.named_files import find
from seatrial.campaign.config.priors import read_priors
from seatrial.campaign.config.schema import CampaignFile, EstimationTable, FilterTable, Goal, GoalTable, PlanTable
from seatrial.campaign.config.sensor_table import measured_angles, read_mounts, read_sensors, with_attitude
from seatrial.campaign.config.templates import example_of
from seatrial.campaign.config.toml import FileKeys, parse_toml, read_text
from seatrial.campaign.config.truth import check_truth
from seatrial.campaign.config.vehicle import WholeVehicle
from seatrial.campaign.config.vehicle_table import read_vehicle
from seatrial.campaign.store.stored_result import FILE_NAME, campaign_folder
from seatrial.core.argument_checks import check_path
from seatrial.core.coefficients import CoefficientName, base_name, configuration_name
from seatrial.core.display_units import shown_unit
from seatrial.core.errors import InputError, located, nearest, not_among
from seatrial.core.signals import ANGLES, BATTERY, PROPULSION, QUATERNION, is_thruster, signal_unit, thruster_controls
from seatrial.estimation.posterior.record_posterior import BY_CONFIGURATION
from seatrial.estimation.posterior.unknowns import may_differ, may_vary, unknowns_of
from seatrial.estimation.priors import Prior
from seatrial.estimation.simulation.sensor_errors import Sensor
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.messages.catalogue import entry_of
from seatrial.selection.structures import Structure
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.tether import LINEAR, TETHER
from seatrial.vehicles.thrusters import controls_of

_AHEAD = {"n": "1200 rpm", "tau_X": "20 N"}  # An example of a value of each control that holds a speed


def load_campaign(folder: Path | str) -> Campaign:
    """Read and check the campaign of a folder, or of the campaign file itself.

    Args:
        folder: of `campaign.toml`, or the path of this file.

    Returns:
        the content of the file, in SI.

    Raises:
        InputError: no such file, one that is too large or not UTF-8, malformed TOML, unknown or missing key, wrong type, unit or name.
    """
    folder = campaign_folder(check_path(folder, "campaign, folder"))
    path = folder / FILE_NAME
    if not path.is_file():
        raise InputError(
            str(path),
            found="no such file",
            expected=f"a campaign folder with {FILE_NAME}",
            remedy=f"correct the path, or create one with `seatrial init {folder} --log FILE` or, without a log, `seatrial init {folder}`",
        )
    return check_text(folder, read_text(path))


def check_text(folder: Path, text: str) -> Campaign:
    """Check a campaign file by its text, which may be what is to be written there.

    Raises:
        InputError: as `load_campaign`.
    """
    keys = FileKeys(folder / FILE_NAME, text)
    file = parse_toml(keys.path, text, CampaignFile, example_of)
    campaign = _campaign(file, keys)
    _check_effects(file, campaign, keys)
    return campaign


def _campaign(file: CampaignFile, keys: FileKeys) -> Campaign:
    """Everything in SI, so that mistakes are found before any work is done."""
    folder, priors_from = keys.path.parent, tuple(file.vehicle.priors_from)
    earlier = found_before(folder, file.vehicle, keys)
    with located(keys.where("structure")):
        rules = file.structure.compiled()
    terms = rules.always + rules.optional
    angles = tuple(angle for angle in ANGLES if angle in (*measured_angles(file.sensors, file.mounts), *file.limits))
    table = with_attitude(with_fixed(file.vehicle, earlier, terms), file.sensors, keys)
    before = unknowns_before(earlier)
    vehicle = read_vehicle(table, keys, terms, angles, tuple(dict.fromkeys((*file.prior, *before))))
    with located(keys.where("vehicle")):
        model = vehicle.model(Structure("full", terms))
    before = {one.name: before[one.name] for one in model.unknowns if one.name in before}
    tables = with_known(
        {**before, **file.prior}, earlier, vehicle.published, file.vehicle.published_prior_sd, keys, terms
    )
    units = {term.text: model.unit_of(term) for term in model.coefficients}
    sensors = read_sensors(file.sensors, keys, model)
    mounts = read_mounts(file.mounts, sensors, file.prior, keys)
    estimation = file.estimation
    _check_estimation(estimation, keys, units, model, sensors)
    configurations = () if file.imported is None else file.imported.configurations
    _check_configurations(file, keys, configurations, model)
    noise = {channel: sensor.noise for channel, sensor in sensors.items()}
    models: list[Sensor] = []
    for channel, sensor in sensors.items():
        key = "estimation.residuals" if sensor.residuals is None else f"sensors.{channel}.residuals"
        with located(keys.where(key)):
            models += sensor_models({channel: sensor}, mounts, estimation.residuals)
    check_disturbances(tables, estimation.likelihood, model, keys.where)
    assumed = assumed_unknowns(estimation, model, tables)
    unknown = unknowns_of(model, models, assumed, noise)[len(units) :]
    inertia = 1.0 if vehicle.hull.mass is None else vehicle.hull.mass
    differing = BY_CONFIGURATION if estimation.by_configuration is None else estimation.by_configuration
    parts = [configuration_name(name, one) for name in differing if name in may_differ(model) for one in configurations]
    priors = read_priors(tables, keys, units, unknown, rules.never, inertia, parts)
    _check_gains(priors, model, keys)
    _check_start_values(estimation, priors, parts, keys)
    process_noise = _process_noise(file.filter, keys, units, model)
    _check_source(file, keys, model)
    autopilot, design, own, power = AutopilotSettings(), file.design, None, None
    if design is not None:
        autopilot = read_autopilot(file.autopilot, keys, model, tuple(sensors), vehicle.hull.trim, design.sample_time)
    commands = (*model.controls, *autopilot.trim)
    limits, motion_limits = read_limits(file.limits, keys, model, commands)
    if design is not None:
        check_design(design, keys, commands, {**vehicle.hull.trim, **autopilot.trim}, tuple(sensors))
        check_utility(design, keys, is_one_structure=not rules.optional, has_autopilot=bool(autopilot.loops))
        if design.schedule is not None:
            where = keys.where("design.schedule")
            with located(where):
                own = read_own(find(folder, design.schedule, where), commands, limits, design.sample_time)
        if file.power is not None or design.per == "joule":
            power = read_power(file.power, keys, design.control)
    for code in file.checks.accept:
        entry_of(code, keys.where("checks.accept"))  # refuses what the catalogue does not have
    laws = vehicle.laws if isinstance(vehicle, WholeVehicle) else ()
    laws = dict(zip(thruster_controls(len(laws), commanded_force=True), laws, strict=True))
    # A log may have columns of thrusters that push along no axis of the model.
    named = map(CoefficientName.parse, (*terms, *vehicle.hull.fixed))
    thrusters = controls_of(vehicle.body.thrusters, named) if isinstance(vehicle, WholeVehicle) else ()
    volts = (BATTERY,) if any(law.voltage for law in laws.values()) else ()
    recorded = dict.fromkeys((*commands, *model.channel_units(), *thrusters, *volts))
    campaign = Campaign(
        name=file.campaign.name,
        seed=file.campaign.seed,
        vehicle=vehicle,
        structure=file.structure,
        priors=priors,
        prior_units={name: table.unit for name, table in tables.items() if table.unit is not None},
        sensors=sensors,
        mounts=mounts,
        trial_design=design,
        own_schedule=own,
        control_limits=limits,
        motion_limits=motion_limits,
        autopilot=autopilot,
        power=power,
        goal=None if file.goal is None else _goal(file.goal, keys, units),
        plan=file.plan or PlanTable(),
        truth=file.truth,
        imports=None if file.imported is None else read_imports(file.imported, keys, tuple(recorded), laws),
        process_noise=process_noise,
        estimation=estimation,
        selection=file.selection,
        compute=file.compute,
        accepted=frozenset(file.checks.accept),
        priors_from=priors_from,
        folder=folder,
        text=keys.text,
    )
    if file.vehicle.current and file.imported is not None and estimation.initial != "estimated":
        raise InputError(
            keys.where("estimation.initial"),
            found=f'"{estimation.initial}" with a current that is a state of each trial',
            expected='"estimated": no log contains the velocity of the water at the start',
            remedy='set initial = "estimated", or remove vehicle.current',
        )
    _ = campaign.full, campaign.prediction(model)
    check_truth(campaign)
    _check_start(campaign, is_trim_stated=design is not None and design.trim is not None)
    return campaign


def _check_gains(priors: Collection[str], model: VehicleModel, keys: FileKeys) -> None:
    """Refuse a common gain of thrusters each of which has its own: their product alone acts."""
    for letter in dict.fromkeys(name[0] for name in model.controls if is_thruster(name)):
        own = [f"gain_{name}" for name in model.controls if is_thruster(name) and name[0] == letter]
        if f"gain_{letter}" in priors and all(name in priors for name in own):
            raise InputError(
                keys.where(f"prior.gain_{letter}"),
                found=f"a gain of all thrusters, and {', '.join(own)}",
                expected="one or the other, because they multiply: only their products act",
                remedy=f"remove [prior.gain_{letter}], or the gain of one thruster, to which those of the others are then relative",
            )


def _check_effects(file: CampaignFile, campaign: Campaign, keys: FileKeys) -> None:
    """Check keys that only the whole campaign shows to have no effect.

    Raises:
        InputError: the first of them.
    """
    table, sought = file.vehicle, {CoefficientName.parse(name) for name in campaign.full.terms}
    thrusts = {term.axis for term in sought} | {CoefficientName.parse(name).axis for name in campaign.hull.fixed}
    for key in sorted({"thrust_deduction", "wake"} & table.model_fields_set):
        if "T" not in thrusts:
            raise keys.without_effect(
                f"vehicle.{key}", "no thrust T_… is estimated or fixed", "remove it, or add thrust such as T_nabsn"
            )
    tether = campaign.hull.tether if isinstance(campaign.hull, Hull) else None
    if tether is not None and not (tether.linear or tether.quadratic or set(TETHER) & set(campaign.priors)):
        raise keys.without_effect(
            "vehicle.tether", "it has no drag", f"give linear or quadratic, or [prior.{LINEAR}], or remove it"
        )
    axes = set() if campaign.vehicle.is_surge else {one.axis for one in campaign.vehicle.equations(campaign.full)}
    for name in table.fixed:
        term = CoefficientName.parse(name)
        if term in sought and table.published_prior_sd is None:
            raise keys.without_effect(
                f"vehicle.fixed.{name}", f"[structure] has {name} sought", "remove it here, or there"
            )
        if term not in sought and axes and ("X" if term.axis == "T" else term.axis) not in axes:
            raise keys.without_effect(f"vehicle.fixed.{name}", f"no term of [structure] is on the axis {term.axis}")
    sensor = file.sensors.get("u")
    if (
        sensor is None or sensor.reference == "water"
    ):  # a current along the course adds to nothing else that is measured
        for key, is_stated in (
            ("estimation.current", file.estimation.current != "none"),
            (f"truth.{CURRENT}", CURRENT in file.truth),
        ):
            if is_stated:
                raise keys.without_effect(key, "no sensor measures the speed u over ground")
    if file.design is not None and "probability" in file.design.model_fields_set and not campaign.motion_limits:
        raise keys.without_effect(
            "design.probability", "[limits] bounds no motion", "remove it, or limit the motion: [limits.distance]"
        )


def _process_noise(
    table: FilterTable, keys: FileKeys, coefficients: Mapping[str, str], model: VehicleModel
) -> dict[str, float]:
    """Standard deviation that states and coefficients, by their units, gain in one second, SI, of those that are named."""
    units, noise = {**{state: signal_unit(state) for state in model.states}, **coefficients}, {}
    for name, written in table.process_noise.items():
        key = f"filter.process_noise.{name}"
        if name not in units:
            raise not_among(keys.where(key), name, units, found=f'"{name}", which is no state and no coefficient')
        noise[name] = written if isinstance(written, float) else keys.si(written, units[name], key)
        if not 0 <= noise[name] < inf:
            raise InputError(
                keys.where(key), found=f"{written}", expected="0 or more", remedy="0 means that the model is perfect"
            )
    return noise


def _check_estimation(
    table: EstimationTable, keys: FileKeys, known: Collection[str], model: VehicleModel, measured: Collection[str]
) -> None:
    """Check what varies and what begins: of coefficients, which are `known`, and of channels that are `measured`."""
    allowed = tuple(dict.fromkeys([*known, *(one.name for one in may_vary(model))]))
    for name in table.varying:
        if name not in allowed:
            reason = "no coefficient, and no unknown of the vehicle that has a prior and either sign"
            raise not_among(keys.where("estimation.varying"), name, allowed, found=f'"{name}", which is {reason}')
    if table.initial == "estimated" and set(QUATERNION) <= set(model.states) and QUATERNION[0] not in measured:
        raise InputError(
            keys.where("estimation.initial"),
            found='"estimated" with the attitude as a quaternion that no sensor shows',
            expected="a measured attitude, or one of independent numbers",
            remedy='add [sensors.attitude], or set vehicle.attitude = "euler" or initial = "measured"',
        )


def _check_start_values(
    table: EstimationTable, priors: Mapping[str, Prior], parts: Sequence[str], keys: FileKeys
) -> None:
    """Check that the search for the mode begins from values of parameters that their priors allow.

    A coefficient that differs between configurations is no parameter: its values in them, the `parts`, are.
    """
    differing = set(map(base_name, parts))
    known = {name: prior for name, prior in priors.items() if name not in differing}
    known |= {name: priors.get(name) or priors[base_name(name)] for name in parts if base_name(name) in priors}
    for name, value in table.start_values.items():
        where = keys.where(f"estimation.start_values.{name}")
        if name not in known:
            raise not_among(where, name, known, found=f'"{name}", which is not estimated')
        lower, upper = known[name].bounds
        if not lower < value < upper:
            raise InputError(
                where,
                found=f"{value:g}",
                expected=f"a value between {lower:g} and {upper:g}, the bounds of its prior, in SI",
                remedy="correct the value, or widen the prior",
            )


def _check_configurations(
    file: CampaignFile, keys: FileKeys, configurations: Collection[str], model: VehicleModel
) -> None:
    """Check the names of the coefficients that differ between configurations of the vehicle."""
    allowed, where = may_differ(model), keys.where("estimation.by_configuration")
    for name in file.estimation.by_configuration or ():
        if name not in allowed:
            raise InputError(
                where,
                found=f'"{name}", which is no unknown of the vehicle that has a prior',
                expected="one of " + ", ".join(allowed),
                remedy=nearest(
                    name, allowed, f"add [prior.{name}], if it is an unknown of the vehicle, or leave it out"
                ),
            )
        goals = () if file.goal is None else file.goal.sd
        twice = "estimation.varying" if name in file.estimation.varying else f"goal.sd.{name}" if name in goals else ""
        if twice or not configurations:
            raise InputError(
                where,
                found=f'"{name}", ' + (f"and the key {twice}" if twice else "and no run with a configuration"),
                expected="a coefficient with one value for each configuration of the runs, and no other use of it",
                remedy="remove one of the two" if twice else 'write configuration = "loaded" under [[import.files]]',
            )


def _goal(table: GoalTable, keys: FileKeys, units: Mapping[str, str]) -> Goal:
    """Read what ends the campaign; `units` are those of the coefficients that may be named, SI."""
    shares, sds = {}, {}
    for name, written in table.sd.items():
        key = f"goal.sd.{name}"
        if name not in units:
            raise not_among(keys.where(key), name, units)
        relative = isinstance(written, str) and written.rstrip().endswith("%")
        value = _percentage(written) if relative else written
        if isinstance(value, str):
            value = keys.si(value, units[name], key)
        if not 0 < value < inf:
            raise InputError(
                keys.where(key),
                found=f"{written}",
                expected=f'a positive standard deviation in {units[name]}, or a percentage such as "10 %"',
                remedy="state the precision that the controller or the simulator needs",
            )
        (shares if relative else sds)[name] = value
    return Goal(shares, sds, table.decided, table.trials)


def _percentage(written: str) -> float:
    try:
        return float(written.rstrip().removesuffix("%")) / 100
    except ValueError:
        return -1.0


def _check_source(file: CampaignFile, keys: FileKeys, model: VehicleModel) -> None:
    """Check that trials are simulated, or imported, or neither; and that they are designed unless they are imported."""
    if file.truth and file.imported is not None:
        raise InputError(
            str(keys.path),
            found="both [truth] and [import]",
            expected="one of them: a simulated vehicle or a real log",
            remedy="remove one of the two; without both, seatrial designs a trial before any data",
        )
    if file.plan is not None and file.plan.battery < inf and file.power is None:
        raise InputError(
            keys.where("plan.battery"),
            found="a battery without [power]",
            expected="the power that a trial draws from it",
            remedy='add [power] with hotel = "20 W", propulsion = "60 W" and at = "1500 rpm", for example',
        )
    needing = [f"[{name}]" for name in ("autopilot", "power", "plan") if getattr(file, name)]
    if file.design is None and (needing or file.imported is None):
        raise InputError(
            keys.where("design"),
            found="nothing",
            expected=f"[design], {'without [import]' if file.imported is None else 'beside ' + needing[0]}: the range of trials",
            remedy=f"add it; for example\n{indent(_design_example(model.controls[0]), '    ')}",
        )


def _design_example(control: str) -> str:
    """Return a section that designs trials of a control."""
    unit = shown_unit(control)[1]
    least, greatest = {"rpm": (100, 300), "deg": (2, 15)}.get(unit, (2, 20))
    return f'''[design]
control = "{control}"
duration = "60 s"
active = "45 s"
sample_time = "0.1 s"
amplitude = {{ from = "{least} {unit}", to = "{greatest} {unit}", points = 5 }}
period = {{ from = "4 s", to = "32 s", points = 8 }}'''


def _check_start(campaign: Campaign, is_trim_stated: bool) -> None:
    """Check where trials begin, as far as no record shows it."""
    trim, model = campaign.hull.trim, campaign.model(campaign.full)
    if "u" in model.states and "u" not in trim:
        if not campaign.has_records:
            raise InputError(
                campaign.where("vehicle.trim.u"),
                found="nothing",
                expected="the speed at which a trial begins",
                remedy='add trim = { u = "1.5 m/s" } to [vehicle]; "0 m/s" begins at rest',
            )
        if campaign.estimation.initial == "trim":
            raise InputError(
                campaign.where("estimation.initial"),
                found='"trim"',
                expected="a vehicle whose trim speed is known",
                remedy='give vehicle.trim.u, or set initial = "measured" or "estimated"',
            )
    if campaign.has_records:
        return
    control = campaign.family.control
    if control in PROPULSION and trim.get("u") and not is_trim_stated and control not in trim:
        raise InputError(
            campaign.where(f"vehicle.trim.{control}"),
            found="nothing",
            expected=f"the value of {control} that holds the {trim['u']:g} m/s at which a trial begins",
            remedy=f'add {control} = "{_AHEAD[control]}" to the trim of [vehicle]; `seatrial prior` shows the resulting speed',
        )
    campaign.control_trim(model)
