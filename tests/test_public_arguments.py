"""What nobody can mean is refused by every public function, by the name of the argument, and never in silence or with a traceback."""

import inspect
import re
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import seatrial as st

RPM = 2 * np.pi / 60
VEHICLE = st.load_vehicle("remus100_surge")
MODEL = VEHICLE.build(free=["X_uabsu", "T_nabsn"])
FAMILY = st.Family("n", 1200 * RPM, duration=12.0, active=10.0, sample_time=0.1, kind="doublet")
SCHEDULE = FAMILY.schedule(200 * RPM, 8.0)
TRUTH = {**VEHICLE.coefficients, "sigma_u": 0.02}
PRIORS = {
    "X_uabsu": st.half_normal(10.0, upper=0.0),
    "T_nabsn": st.LogNormal(6e-4, 1.5),
    "sigma_u": st.Uniform(0.01, 1.0),
}


@pytest.fixture(scope="module")
def record():
    return st.simulate(MODEL, TRUTH, SCHEDULE, ["u"], start={"u": 1.5}, key=1)


@pytest.fixture(scope="module")
def posterior(record):
    return st.make_posterior(MODEL, record, PRIORS, start={"u": 1.5})


def test_errors_are_weighed_of_a_posterior_and_its_mode(posterior):
    mode = st.find_mode(posterior, key=1)
    assert repr(st.error_budget(posterior, mode)).startswith("Standard deviations with all errors, SI")
    refused(r"mode\n.*\n.*a Mode\n.*find_mode", st.error_budget, posterior, posterior)
    refused(r"stated\n.*\n.*\n.*StatedErrors", st.error_budget, posterior, mode, 0.05)
    refused(r"inertia of stated errors\n.*-0.1", st.StatedErrors, inertia=-0.1)


def refused(message, function, *arguments, **named):
    """Check that a call is refused with all four parts, and that they say this."""
    with pytest.raises(st.InputError) as error:
        function(*arguments, **named)
    text = str(error.value)
    assert all(f"\n  {part}: " in text for part in ("found", "expected", "remedy"))
    assert re.search(message, text), text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": VEHICLE}, r"model\n.*a PublishedVehicle.*\n.*a VehicleModel\n.*build"),
        ({"model": None}, "model"),
        ({"schedule": FAMILY}, "schedule"),
        ({"sensors": "u"}, r'sensors\n.*\n.*a list\n.*\["u"\]'),
        ({"sensors": None}, "sensors"),
        ({"sensors": []}, r"sensors\n.*none"),
        ({"sensors": ["u", "u"]}, '"u" twice'),
        ({"sensors": ["uu"]}, 'did you mean "u"'),
        ({"sensors": [0.02]}, r"sensors\[0\]"),
        ({"values": None}, "none of X_uabsu"),
        ({"values": ["X_u"]}, r"values\n"),
        ({"values": TRUTH | {"sigma_v": 0.1}}, '"sigma_v", which nothing uses'),
        ({"values": TRUTH | {"bias_u": 0.1}}, '"bias_u", which nothing uses'),
        ({"values": TRUTH | {"X_uu": 0.1}}, '"X_uu", which nothing uses'),
        ({"values": TRUTH | {"X_udot": -99.0}}, r'values\["X_udot"\]'),
        ({"values": TRUTH | {"X_uabsu": np.nan}}, r'values\["X_uabsu"\]\n.*nan'),
        ({"values": TRUTH | {"X_uabsu": "-3"}}, r'values\["X_uabsu"\]'),
        ({"values": TRUTH | {"sigma_u": -0.1}}, r'values\["sigma_u"\]\n.*-0.1\n.*0 or more'),
        ({"values": TRUTH | {"delay": -1.0}}, r'values\["delay"\]'),
        ({"values": TRUTH | {"lag_u": -1.0}, "sensors": [st.Sensor("u", lag=True)]}, r'values\["lag_u"\]'),
        (
            {"values": TRUTH | {"tau_u": 0.0}, "sensors": [st.Sensor("u", "coloured")]},
            r'values\["tau_u"\].*\n.*\n.*above 0',
        ),
        ({"values": TRUTH | {"process_u": -1.0}}, r'values\["process_u"\]'),
        ({"start": {"u": 1.5, "v": 0.0}}, '"v", which nothing uses'),
        ({"start": {"u": np.nan}}, r'start\["u"\]'),
        ({"start": 1.5}, "start\n"),
        ({"rates": {"v": 5.0}}, '"v", which nothing uses'),
        ({"rates": {"u": 0.0}}, r'rates\["u"\]'),
        ({"rates": {"u": -5.0}}, r'rates\["u"\]'),
        ({"rates": {"u": 50.0}}, r'rates\["u"\]\n.*50 samples a second\n.*to 10,'),
        ({"rates": {"u": 1e-3}}, r'rates\["u"\]'),
        ({"rates": 5.0}, "rates\n"),
        ({"key": None}, "key"),
        ({"key": 1.5}, "key"),
        ({"key": [1, 2]}, r"key\n.*2 keys"),
        ({"label": None}, "label"),
    ],
)
def test_simulate(changes, message):
    usual = {"model": MODEL, "values": TRUTH, "schedule": SCHEDULE, "sensors": ["u"], "start": {"u": 1.5}}
    refused(message, st.simulate, **{**usual, **changes})


def test_what_has_no_part_in_a_motion_may_stand_among_the_values():
    """All that is published of a vehicle does for a model of some of it; a fixed value may be said again."""
    whole = st.load_vehicle("remus100_prestero")
    model = whole.build(moves=["u"], free=["X_uabsu"])
    values = {**whole.hull.fixed, **whole.coefficients, "sigma_u": np.float64(0.0)}
    made = st.simulate(model, values, SCHEDULE, ["u"], start={"u": 1.5}, key=np.int64(3))
    assert np.isfinite(made.channel("u")).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": VEHICLE}, "a VehicleModel"),
        ({"records": []}, r"records\n.*none"),
        ({"records": None}, "records"),
        ({"records": ["trial"]}, r"records\[0\]"),
        ({"priors": None}, "priors"),
        ({"priors": [st.Normal(0.0, 1.0)]}, "priors"),
        ({"priors": PRIORS | {"sigma_u": st.Uniform}}, r'priors\["sigma_u"\]'),
        ({"start": {"U": 1.5}}, '"U", which nothing uses'),
        ({"start_sd": {"v": 1.0}}, "start_sd"),
        ({"start_sd": {"u": -1.0}}, r'start_sd\["u"\]'),
        ({"own": "sigma_u"}, r'own\n.*\n.*\n.*\["sigma_u"\]'),
        ({"sensors": "u"}, "sensors"),
        ({"priors": {"T_nabsn": PRIORS["T_nabsn"], "sigma_u": PRIORS["sigma_u"]}}, r"a prior of X_uabsu \(kg/m\)"),
        ({"priors": PRIORS | {"X_uu": PRIORS["X_uabsu"]}}, '"X_uu", which nothing uses'),
        (
            {"priors": PRIORS | {"tau_u": PRIORS["sigma_u"]}},
            r'make it Sensor\("u", noise="coloured"\), or leave tau_u out',
        ),
        ({"sensors": ["v"]}, 'channel "v"'),
        ({"own": ["bias_u"]}, '"bias_u", which nothing uses'),
    ],
)
def test_make_posterior(record, changes, message):
    refused(message, st.make_posterior, **{"model": MODEL, "records": record, "priors": PRIORS, **changes})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: st.ChainSettings(chains=0), "chains"),
        (lambda: st.ChainSettings(chains=-4), "chains"),
        (lambda: st.ChainSettings(chains=4.0), "chains"),
        (lambda: st.ChainSettings(warmup=250), r"warmup\n.*\n.*multiple of 100"),
        (lambda: st.ChainSettings(draws=50), r"draws\n.*\n.*multiple of 100"),
        (lambda: st.ChainSettings(draws=0), "draws"),
        (lambda: st.ChainSettings(thin=3), "a divisor of 100"),
        (lambda: st.ChainSettings(thin=0), "thin"),
        (lambda: st.SMCSettings(particles=0), "particles"),
        (lambda: st.SMCSettings(moves=0), "moves"),
        (lambda: st.SMCSettings(target_ess=1.5), "target_ess"),
        (lambda: st.NestedSettings(live=0), "live"),
        (lambda: st.NestedSettings(draws="many"), "draws"),
        (lambda: st.EvidenceSettings(repeats=1), "repeats"),
        (lambda: st.EvidenceSettings(smc=512), "smc"),
        (lambda: st.Sensor("u", "pink"), "white, coloured, heavy"),
        (lambda: st.Sensor(None), "Sensor, channel"),
        (lambda: st.Sensor("u", bias=0.1), "Sensor, bias"),
        (lambda: st.CoefficientName.parse(None), "coefficient name"),
        (lambda: st.posterior_of_density({}, lambda values: 0.0), "log_density"),
        (lambda: st.posterior_of_density(lambda values: 0.0, None), "priors"),
        (lambda: st.posterior_of_density(lambda v: v["a"], {"a": st.Normal(0.0, 1.0)}, ["1"]), "units"),
        (
            lambda: st.posterior_of_density(lambda v: v["a"], {"a": st.Normal(0.0, 1.0)}, {"b": "kg"}),
            'units\n.*"b", which',
        ),
        (lambda: st.posterior_of_density(lambda v: v["a"], {"a": st.Normal(0.0, 1.0)}, {"a": 3}), r'units\["a"\]'),
        *[
            (lambda prior=prior: st.posterior_of_density(lambda v: -(v["a"] ** 2), {"a": prior}), r'priors\["a"\]')
            for prior in (st.Uniform(jnp.array(1.0), -5.0), st.Normal(jnp.array(np.nan), 1.0), st.Uniform, 1.0)
        ],
    ],
)
def test_settings_and_parts(make, message):
    refused(message, make)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: st.sample(p, st.ChainSettings()), "settings="),
        (lambda p: st.sample(p, "mcmc"), "independence-metropolis"),
        (lambda p: st.sample(p, "nutz"), 'did you mean "nuts"'),
        (lambda p: st.sample(p, "tempered-smc", settings=st.ChainSettings()), "SMCSettings"),
        (lambda p: st.sample(p, None), "method"),
        (lambda p: st.sample(p, settings=100), "ChainSettings"),
        (lambda p: st.sample(None), "posterior"),
        (lambda p: st.sample(p, key="1"), "key"),
        (lambda p: st.find_mode(MODEL), "posterior"),
        (lambda p: st.find_mode(p, starts=0), "starts"),
        (lambda p: st.find_mode(p, tries=0), "tries"),
        (lambda p: st.profile_likelihood(p, p), "mode"),
        (lambda p: st.log_evidence(None), "posterior"),
        (lambda p: st.log_evidence(p, key=st.EvidenceSettings()), "key"),
        (lambda p: st.log_evidence(p, settings=4), "settings"),
        (lambda p: st.compare([p, p]), "posteriors"),
        (lambda p: st.compare({"a": p, "b": None}), r'posteriors\["b"\]'),
        (lambda p: st.compare({"a": p}), "two at least"),
        (lambda p: st.predict(p, None, None), "draws"),
        (lambda p: st.predict(None, None, None), "posterior"),
        (lambda p: st.tweak(None, None, None, {}), "posterior"),
        (lambda p: st.tweak(p, None, None, {}), "mode"),
    ],
)
def test_what_is_done_with_a_posterior(posterior, call, message):
    refused(message, call, posterior)


def test_draws_are_a_container_of_names(posterior):
    shape = (2, 5, 3)
    draws = st.Draws(np.zeros(shape), np.zeros(shape[:2]), 1.0, 0, posterior.names, ("1",) * 3, np.ones(shape))
    assert list(draws) == ["X_uabsu", "T_nabsn", "sigma_u"]
    assert len(draws) == 3
    assert "X_uabsu" in draws
    assert "X_u" not in draws
    assert 0 not in draws
    assert {name: draws[name].shape for name in draws} == dict.fromkeys(posterior.names, (2, 5))
    refused('did you mean "X_uabsu"', lambda: draws["X_uabs"])
    refused("draws\n.*0", lambda: draws[0])
    refused("names", draws.array, "X_uabsu")


def test_settings_and_key_are_keywords_in_one_order():
    order = ("settings", "key", "progress")
    functions = {name: thing for name in st.__all__ if inspect.isfunction(thing := getattr(st, name))}
    for name, function in functions.items():
        parameters = inspect.signature(function).parameters
        assert not {"keys", "seed", "rng"} & set(parameters), name
        assert [one for one in parameters if one in order] == [one for one in order if one in parameters], name
        assert all(parameters[one].kind is inspect.Parameter.KEYWORD_ONLY for one in order if one in parameters), name
    assert {"sample", "compare", "log_evidence"} <= set(functions)


DESIGN = {
    "model": MODEL,
    "belief": PRIORS,
    "families": FAMILY,
    "amplitude": [20.0],
    "period": [8.0],
    "noise": {"u": 0.02},
}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": VEHICLE}, "a VehicleModel"),
        ({"belief": None}, "belief"),
        ({"belief": {"X_uabsu": 1.0}}, "belief"),
        ({"belief": {"T_nabsn": PRIORS["T_nabsn"]}}, "none of X_uabsu"),
        ({"families": st.Family("delta_r", 0.0, duration=12.0, active=10.0, sample_time=0.1)}, "a value of n"),
        ({"families": []}, "families"),
        ({"families": "doublet"}, "families"),
        ({"amplitude": 20.0}, "amplitude"),
        ({"amplitude": [np.nan]}, r"amplitude\[0\]"),
        ({"amplitude": [20.0, 0.0]}, r"amplitude\[1\]\n.*which moves nothing"),
        ({"rates": {"u": 1000.0}}, r'rates\["u"\]\n.*1000 samples a second\n.*to 10, one at every time'),
        ({"rates": {"u": 0.01}}, r'rates\["u"\]\n.*0.01 samples a second'),
        ({"period": []}, "period"),
        ({"key": 0.5}, "key"),
        ({"noise": {}}, "noise"),
        ({"noise": 0.02}, "noise"),
        ({"noise": {"u": 0.0}}, r'noise\["u"\]'),
        ({"noise": {"x": 1.0}}, "noise"),
        ({"start": {"U": 1.0}}, "start"),
        ({"held": {"delta_r": 0.0}}, "held"),
        ({"limits": (0.0, 1.0)}, "limits"),
        ({"rates": {"v": 1.0}}, "rates"),
        ({"rates": {"u": 0.0}}, r'rates\["u"\]'),
    ],
)
def test_design_trial(changes, message):
    refused(message, st.make_design_problem, **{**DESIGN, **changes})


@pytest.mark.parametrize("name", ["sigma_u", "tau_u", "lag_u", "drift_u", "drift_time_u", "dof_u", "delay"])
@pytest.mark.parametrize("prior", [st.Normal(0.0, 0.1), st.Uniform(-1.0, 1.0)])
def test_what_has_no_sign_has_a_prior_above_zero(record, name, prior):
    kind = {"tau": "coloured", "dof": "heavy", "drift": "drifting"}.get(name.partition("_")[0], "white")
    sensor, size = st.Sensor("u", kind, lag=name == "lag_u"), st.LogUniform(0.01, 1.0)
    priors = {**PRIORS, **{one: size for one in sensor.parameters if one != "sigma_u"}}
    message = rf'priors\["{name}"\]\n.*(Normal|Uniform)\(.*which allows values below 0\n.*\n.*half_normal'
    refused(message, st.make_posterior, MODEL, record, priors | {name: prior}, [sensor], start={"u": 1.5})


def test_a_trace_below_zero_and_a_bias_of_either_sign_are_allowed(record):
    priors = PRIORS | {"sigma_u": st.Normal(0.02, 0.002), "bias_u": st.Normal(0.0, 0.1)}
    st.make_posterior(MODEL, record, priors, [st.Sensor("u", bias=True)], start={"u": 1.5})


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: st.find_mode(p, key="a"), r"key\n.*'a'\n.*a seed, or a key of jax\.random\.key"),
        (lambda p: st.sample(p, progress=3), r"progress\n.*3\n"),
        (lambda p: st.compare({"a": p, "b": p}, progress=3), "progress"),
        (lambda p: st.predict_from_prior(None), r"campaign\n.*None"),
        (lambda p: a_few_draws().thinned([10000]), r"places\[0\]\n.*10000\n.*from 0 to 9"),
        (lambda p: a_few_draws().thinned([0.5]), r"places\[0\]"),
        (lambda p: a_few_draws().thinned(3), r"places\n"),
    ],
)
def test_before_anything_is_computed(posterior, call, message):
    refused(message, call, posterior)


def a_few_draws():
    z = np.zeros((2, 10, 1))
    return st.Draws(z, z[..., 0], 0.5, 0, ("a",), ("1",), z)


def test_every_other_draw():
    assert a_few_draws().thinned(range(0, 10, 2)).z.shape == (2, 5, 1)


def measured_otherwise(record, changed):
    u = record.channel("u").copy()
    changed(u)
    return replace(record, measurement=u[:, None])


def thinned(u):
    u[1::2] = np.nan


def shifted(u):
    u[3:5] += 1e-3


@pytest.mark.parametrize(
    ("records", "message"),
    [
        (
            lambda one: measured_otherwise(one, thinned),
            r'b"\]\n.*posteriors\["a"\]: \d+ measurements of u of record "trial"',
        ),
        (lambda one: measured_otherwise(one, shifted), r"2 of \d+ measurements of u"),
        (lambda one: replace(one, time=1.01 * one.time), "other times of u"),
        (lambda one: [one, replace(one, label="again")], "2 records against 1"),
    ],
)
def test_posteriors_of_different_data_are_not_compared(record, posterior, records, message):
    other = st.make_posterior(MODEL, records(record), PRIORS, start={"u": 1.5})
    refused(message, st.compare, {"a": posterior, "b": other})


def test_posteriors_of_different_channels_are_not_compared(posterior):
    both = st.simulate(MODEL, TRUTH | {"sigma_udot": 0.1}, SCHEDULE, ["u", "udot"], start={"u": 1.5}, key=1)
    other = st.make_posterior(MODEL, both, PRIORS | {"sigma_udot": st.Uniform(0.01, 1.0)}, start={"u": 1.5})
    refused("measured u, udot against u", st.compare, {"a": posterior, "b": other})


CHANNELS = (st.Channel("n", "rad/s", "control"), st.Channel("u", "m/s", "measurement"))
COLUMNS = {"n": np.ones(4), "u": np.array([1.0, 1.1, 1.2, 1.3])}
RECORD = {"time": np.arange(4.0), "columns": COLUMNS, "channels": CHANNELS, "provenance": st.Provenance("mine", "")}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"channels": ("n", "u")}, r"channels\[0\]"),
        ({"channels": None}, "channels"),
        ({"columns": [1.0]}, "columns"),
        ({"columns": COLUMNS | {"u": "fast"}}, 'channel "u"'),
        ({"columns": COLUMNS | {"u": None}}, 'channel "u"'),
        ({"time": None}, "time"),
        ({"time": "0 1 2"}, "time"),
        ({"time": np.zeros((2, 2))}, "time"),
        ({"provenance": "mine"}, "provenance"),
        ({"label": None}, "label"),
        ({"between": "line"}, "between"),
        ({"between": {"u": "line"}}, "between"),
        ({"between": {"n": "measured"}}, "between, n"),
    ],
)
def test_make_record(changes, message):
    refused(message, st.make_record, **{**RECORD, **changes})


LOG = {"channels": {"n": ("prop", "rpm"), "u": ("speed", "m/s")}, "controls": ["n"], "time": ("t", "s")}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": "t"}, r"time\n.*'t'\n.*a column and its unit"),
        ({"time": ("t", None)}, "time"),
        ({"channels": ["n", "u"]}, "channels"),
        ({"channels": {"n": "prop"}}, 'channel "n"'),
        ({"channels": {"n": ("prop",)}}, 'channel "n"'),
        ({"channels": {}}, "channels"),
        ({"controls": "n"}, r'\["n"\]'),
        ({"controls": None}, "controls"),
        ({"controls": ["delta_r"]}, "map the control to a column"),
        ({"step": "0.1 s"}, "step"),
        ({"step": 0.0}, "step"),
        ({"start": np.nan}, "start"),
        ({"end": "late"}, "end"),
        ({"delimeter": ";"}, 'did you mean "delimiter"'),
        ({"delimiter": 3}, "delimiter"),
        ({"clock": "exact"}, "as_stamped, even, drop_repeated"),
        ({"axes": None}, "NED, ENU"),
        ({"label": 3}, "label"),
        ({"path": None}, "path"),
    ],
)
def test_read_log(tmp_path, changes, message):
    path = tmp_path / "trial.csv"
    path.write_text("t,prop,speed\n" + "".join(f"{k},{900 + k},{1 + 0.1 * k}\n" for k in range(9)))
    refused(message, st.read_log, **{"path": path, **LOG, **changes})
    assert st.read_log(path, **LOG).time.size == 9


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda folder: st.inspect_log(None), "path"),
        (lambda folder: st.export_vehicle(None, "json", folder), "what"),
        (lambda folder: st.export_vehicle(VEHICLE, None, folder), "stonefish"),
        (lambda folder: st.export_vehicle(VEHICLE, "json", None), "folder"),
        (lambda folder: st.export_vehicle(VEHICLE, "json", folder, draws={"X_u": 1.0}), "draws"),
        (lambda folder: st.load_campaign(None), "folder"),
        (lambda folder: st.init_campaign(None, "design"), "folder"),
        (lambda folder: st.design_first(str(folder)), "load_campaign"),
        (lambda folder: st.get_trials(None), "load_campaign"),
        (lambda folder: st.estimate_all(None, None), "load_campaign"),
        (lambda folder: st.select_structure(None, None), "load_campaign"),
        (lambda folder: st.run_loop(None), "load_campaign"),
        (lambda folder: st.write_report(None), "run_loop"),
        (lambda folder: VEHICLE.build(moves="surge"), "moves"),
        (lambda folder: VEHICLE.build(free="X_u"), "free"),
        (lambda folder: VEHICLE.build(given=None), "given"),
        (lambda folder: VEHICLE.build(positions=[1]), "positions"),
        (lambda folder: VEHICLE.build(attitude="quat"), "quaternion, euler"),
        (lambda folder: VEHICLE.build(actuators={}), "actuators"),
        (lambda folder: VEHICLE.build(angle=["psi"]), 'did you mean "angles"'),
        (lambda folder: VEHICLE.build(current=("0", 0.0, 0.0)), "current"),
        (lambda folder: VEHICLE.terms(moves="all"), "moves"),
        (lambda folder: st.make_vehicle("a", 30.0, {}, symmetric="no"), "symmetric"),
        (lambda folder: st.init_campaign(folder, []), "template"),
        (lambda folder: st.export_vehicle(VEHICLE, ["json"], folder), "to"),
        (lambda folder: VEHICLE.without(None), "X_uabsu"),
    ],
)
def test_files_and_folders(tmp_path, call, message):
    refused(message, call, tmp_path)


def test_what_is_no_table_prints_itself_in_words(posterior, record):
    assert repr(posterior) == (
        'Posterior of X_uabsu [kg/m], T_nabsn [kg m/rad^2], sigma_u [m/s]; record "trial", measured u'
    )
    assert (
        repr(MODEL)
        == 'Vehicle "REMUS 100 (surge)"; states u [m/s]; controls n [rad/s]; free X_uabsu [kg/m], T_nabsn [kg m/rad^2]'
    )
    assert repr(SCHEDULE) == "Schedule: 120 samples over 11.9 s; n from 1000 to 1400 rpm"
    own = st.posterior_of_density(lambda values: values["a"], {"a": st.Normal(0.0, 1.0)})
    assert repr(own) == "Posterior of a [1]; log density of the user"
    for one in (posterior, MODEL, SCHEDULE, record):
        assert one._repr_html_().startswith("<pre>")
    assert "&quot;trial&quot;" in record._repr_html_()


@pytest.mark.parametrize(
    "call",
    [
        lambda p: st.sample(p),
        lambda p: st.find_mode(p),
        lambda p: st.log_evidence(p),
        lambda p: st.compare({"a": p, "b": p}),
        lambda p: st.make_posterior(MODEL, [], PRIORS),
        lambda p: st.posterior_of_density(lambda values: values["a"], {"a": st.Normal(0.0, 1.0)}),
        lambda p: st.simulate(MODEL, TRUTH, SCHEDULE, ["u"]),
        lambda p: st.predict(p, None, None),
        lambda p: st.profile_likelihood(p, None),
        lambda p: st.make_design_problem(**DESIGN),
    ],
)
def test_single_precision_switched_on_later_is_refused(posterior, call):
    jax.config.update("jax_enable_x64", False)
    try:
        refused("JAX in this process\n.*float32, switched on after", call, posterior)
    finally:
        jax.config.update("jax_enable_x64", True)
