"""Records of several configurations: a linear motion whose posterior is the normal equations, and the same sums written plainly."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import seatrial as st
from seatrial.core.errors import InputError
from seatrial.estimation.prediction.posterior_by_run import split_runs
from tests.estimation_cases import make_trial

SAMPLES, STEP, NOISE = 60, 0.2, 0.03
TRUE = {"gain": 0.04, "offset@empty": 0.02, "offset@loaded": -0.05}
PRIOR_SD = {"gain": 0.5, "offset@empty": 0.3, "offset@loaded": 0.4}


def linear(params, state, control):
    """Speed is a straight sum of both coefficients: their posterior is normal, known in closed form."""
    return (params["offset"] + params["gain"] * control[0],)


MODEL = st.make_model("linear", linear, {"u": "m/s"}, {"n": "rad/s"}, {"gain": "m/(rad s)", "offset": "m/s^2"})
TIME = STEP * np.arange(SAMPLES)
REV = {"empty": np.sign(np.sin(TIME)), "loaded": np.sign(np.cos(0.7 * TIME))}


def column(configuration):
    """Return what a unit gain, and a unit offset, add to the speed at each sample."""
    driven = np.concatenate([[0.0], np.cumsum(STEP * 2 * np.pi * REV[configuration])[:-1]])
    return np.column_stack([driven, TIME])


def trial(configuration, label, seed):
    gain, offset = TRUE["gain"], TRUE[f"offset@{configuration}"]
    speed = column(configuration) @ [gain, offset] + NOISE * np.random.default_rng(seed).normal(size=SAMPLES)
    return make_trial(TIME, REV[configuration], label, u=speed).in_configuration(configuration)


RECORDS = [trial("empty", "1", 1), trial("loaded", "2", 2)]
NORMAL = {name: st.Normal(0.0, sd) for name, sd in PRIOR_SD.items()}
KNOWN_NOISE = {"sigma_u": st.Normal(NOISE, 1e-4)}
OPTIONS = {"sensors": ["u"], "start": [[0.0]], "by_configuration": ["offset"]}


def posterior_of(records, names=tuple(TRUE), **options):
    priors = {name: NORMAL[name] for name in names} | KNOWN_NOISE
    return st.make_posterior(MODEL, records, priors, **OPTIONS | {"start": [[0.0]] * len(records)} | options)


def normal_equations(records, names):
    """Mean and covariance of the coefficients by weighted least squares with the priors as further rows."""
    precision, right = np.diag([PRIOR_SD[name] ** -2.0 for name in names]), np.zeros(len(names))
    for record in records:
        design = np.zeros((SAMPLES, len(names)))
        for values, name in zip(
            column(record.configuration).T, ("gain", f"offset@{record.configuration}"), strict=True
        ):
            design[:, names.index(name)] = values
        precision, right = precision + design.T @ design / NOISE**2, right + design.T @ record.channel("u") / NOISE**2
    return np.linalg.solve(precision, right), np.linalg.inv(precision)


def test_of_a_linear_motion_the_posterior_is_that_of_the_normal_equations():
    posterior = posterior_of(RECORDS)
    assert posterior.names == ("gain", "offset@empty", "offset@loaded", "sigma_u")
    mode = st.find_mode(posterior, key=1)
    mean, cov = normal_equations(RECORDS, posterior.names[:3])
    sd = np.sqrt(np.diag(cov))
    assert np.asarray(mode.values[:3]) == pytest.approx(mean, abs=0.02 * sd.min())
    assert mode.sd[:3] == pytest.approx(sd, rel=1e-3)
    (row,) = st.configuration_differences(mode)
    assert (row.name, row.unit, row.first, row.second) == ("offset", "m/s^2", "empty", "loaded")
    assert row.change == pytest.approx(mean[2] - mean[1], abs=0.02 * sd.min())
    assert row.sd == pytest.approx(np.sqrt(cov[1, 1] + cov[2, 2] - 2 * cov[1, 2]), rel=1e-3)
    assert abs(row.sd / np.hypot(*sd[1:]) - 1) > 0.02, "the correlation matters"


def test_together_a_common_coefficient_has_the_variance_that_pools_both():
    """Its informations add, less that of the prior, which each alone counts once."""
    alone = []
    for record in RECORDS:
        posterior = posterior_of([record], ("gain", f"offset@{record.configuration}"))
        assert posterior.names[1] == f"offset@{record.configuration}"
        alone.append(st.find_mode(posterior, key=1).sd[0])
    pooled = (sum(sd**-2.0 for sd in alone) - PRIOR_SD["gain"] ** -2) ** -0.5
    together = st.find_mode(posterior_of(RECORDS), key=1).sd[0]
    assert together == pytest.approx(pooled, rel=1e-3)
    assert together < 0.9 * min(alone)


SURGE = st.load_vehicle("remus100_surge").build(free=["X_u", "X_uabsu", "T_nabsn"])
PRIORS = {
    "X_u": st.Normal(-1.2, 0.3),
    "X_uabsu@clean": st.Normal(-3.0, 0.5),
    "X_uabsu@fouled": st.Normal(-3.5, 0.5),
    "T_nabsn": st.Normal(6e-4, 1e-4),
    "sigma_u": st.LogUniform(0.01, 0.1),
}
RUNS = {"a": "clean", "b": "fouled", "c": "clean", "d": "fouled"}


def surge_record(label, configuration, seed):
    speed = 1.5 + 0.1 * np.random.default_rng(seed).standard_normal(40)
    record = make_trial(0.1 * np.arange(40), np.full(40, 20.0), label, u=speed)
    return record.in_configuration(configuration) if configuration else record


SURGE_RECORDS = [surge_record(label, one, seed) for seed, (label, one) in enumerate(RUNS.items())]


@pytest.fixture(scope="module", params=["output error", "filter error", "own bias"])
def joint(request):
    options = {"sensors": ["u"], "by_configuration": ["X_uabsu"]}
    priors = PRIORS | ({"process_u": st.LogUniform(0.001, 0.1)} if request.param == "filter error" else {})
    if request.param == "own bias":
        priors |= {"bias_u": st.Normal(0.0, 0.1)}
        options |= {"sensors": [st.Sensor("u", bias=True)], "own": ["bias_u"]}
    return st.make_posterior(SURGE, SURGE_RECORDS, priors, **options), options, priors


def plain_priors(priors, configuration):
    """Priors of a posterior of one configuration alone, which knows no other."""
    return {
        name.partition("@")[0]: prior
        for name, prior in priors.items()
        if name.endswith(configuration) or "@" not in name
    }


def test_likelihood_is_the_sum_over_trials_of_a_vehicle_without_configurations(joint):
    posterior, options, priors = joint
    z = np.asarray(posterior.sample_prior(jax.random.key(3), 1))[0]
    values = dict(zip(posterior.names, np.asarray(posterior.constrain(z)), strict=True))
    total = 0.0
    for record in SURGE_RECORDS:
        one = st.make_posterior(
            SURGE,
            replace(record, configuration=""),
            plain_priors(priors, record.configuration),
            **options | {"by_configuration": ()},
        )
        own = {name: values.get(name, values.get(f"{name}@{record.configuration}")) for name in one.names}
        total += float(one.likelihood(own, one.data))
    assert float(posterior.log_likelihood(z)) == pytest.approx(total, rel=1e-12)


def test_parts_of_a_posterior_by_run_sum_to_it(joint):
    """The parts serve to leave one run out: each knows the values of its own configuration."""
    posterior, _, _ = joint
    runs = split_runs(posterior)
    z = np.asarray(posterior.sample_prior(jax.random.key(4), 1))[0]
    parts = [
        float(one.log_likelihood(np.concatenate([z[runs.shared], z[runs.own[r]]]))) for r, one in enumerate(runs.parts)
    ]
    assert sum(parts) == pytest.approx(float(posterior.log_likelihood(z)), rel=1e-12)


def test_a_record_is_predicted_by_its_configuration():
    posterior = st.make_posterior(SURGE, SURGE_RECORDS, PRIORS, sensors=["u"], by_configuration=["X_uabsu"])
    table = np.asarray(posterior.constrain(posterior.sample_prior(jax.random.key(5), 30)))
    draws = dict(zip(posterior.names, table.T, strict=True))
    for configuration in ("clean", "fouled"):
        record = surge_record("new", configuration, 9)
        found = st.predict(posterior, draws, record)
        plain = st.make_posterior(
            SURGE, replace(record, configuration=""), plain_priors(PRIORS, configuration), sensors=["u"]
        )
        own = {name: draws.get(name, draws.get(f"{name}@{configuration}")) for name in plain.names}
        expected = st.predict(plain, own, replace(record, configuration=""))
        assert found.mean == pytest.approx(expected.mean, rel=1e-12)
        assert found.motion_sd == pytest.approx(expected.motion_sd, rel=1e-9)
    for configuration, words in (("", "no configuration"), ("scraped", 'configuration "scraped"')):
        with pytest.raises(InputError, match=rf'(?s)record "new".*{words}.*clean, fouled'):
            st.predict(posterior, draws, surge_record("new", configuration, 9))


def test_net_weight_and_centre_of_buoyancy_differ_by_default():
    model = st.load_vehicle("bluerov2_heavy").build(moves=["w"], free=["Z_w"], unknowns=("net_weight",))
    time, random = 0.1 * np.arange(40), np.random.default_rng(1)
    records = []
    for label in ("empty", "loaded"):
        columns = {name: random.normal(size=40) for name in dict.fromkeys((*model.states, *model.controls))}
        table = {name: (name, "N" if name[0] == "f" else "m/s" if name == "w" else "rad") for name in columns}
        columns["t"] = time
        records.append(st.record(columns, commanded=model.controls, label=label, **table).in_configuration(label))
    priors = {"Z_w": st.Normal(-30.0, 10.0), "net_weight": st.Normal(0.0, 10.0), "sigma_w": st.LogUniform(0.1, 10.0)}
    posterior = st.make_posterior(model, records, priors, sensors=["w"])
    assert posterior.names == ("Z_w", "net_weight@empty", "net_weight@loaded", "sigma_w")
    common = st.make_posterior(model, records, priors, sensors=["w"], by_configuration=())
    assert common.names == ("Z_w", "net_weight", "sigma_w")


@pytest.mark.parametrize(
    ("records", "options", "words"),
    [
        (
            [SURGE_RECORDS[0], surge_record("x", "", 1)],
            {"by_configuration": ()},
            'record "x".*no configuration.*one of each record',
        ),
        ([surge_record("x", "", 1)], {"by_configuration": ["X_u"]}, 'record "x".*coefficients differ by it'),
        (SURGE_RECORDS, {"by_configuration": ["sigma_u"]}, 'by_configuration.*"sigma_u".*X_u, X_uabsu, T_nabsn'),
        (
            SURGE_RECORDS,
            {"by_configuration": ["X_u"], "own": ["X_u"]},
            '"X_u", which differs from trial to trial as well',
        ),
        (SURGE_RECORDS, {"by_configuration": ["X_u"]}, "found: *none of X_uabsu"),
    ],
)
def test_bad_configurations(records, options, words):
    with pytest.raises(InputError, match=f"(?s){words}"):
        st.make_posterior(SURGE, records, PRIORS, sensors=["u"], **options)


@pytest.mark.parametrize("name", ["", "a@b", "a[b]", " a", "x" * 41, 3])
def test_a_configuration_has_a_plain_name(name):
    with pytest.raises(InputError, match='record "a", configuration'):
        SURGE_RECORDS[0].in_configuration(name)


def test_a_stored_record_keeps_its_configuration(tmp_path):
    from seatrial.core.record_file import read_record, write_record

    write_record(SURGE_RECORDS[1], tmp_path / "b.nc")
    assert read_record(tmp_path / "b.nc").configuration == "fouled"
    assert 'configuration "fouled"' in repr(SURGE_RECORDS[1])
