"""Lanes at once, on a processor and as on an accelerator, whose branch runs here on a processor under another name."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.compiled import batching as lanes
from seatrial.compiled import engine
from seatrial.compiled.batching import backend, lanes_at_once, map_in_step, map_lanes
from seatrial.design.sweep import in_blocks, sweep_family
from seatrial.estimation.posterior.output_error import output_error
from seatrial.estimation.posterior.pointwise import pointwise_log_likelihood
from seatrial.estimation.posterior.slopes import likelihood_slopes
from seatrial.estimation.priors import Uniform
from seatrial.filters.square_root import LargeUnscentedKalmanFilter
from seatrial.filters.unscented import UnscentedKalmanFilter
from seatrial.sampling.target import evaluate
from seatrial.sampling.tempered_smc import SMCSettings, sample_tempered_smc
from seatrial.selection.criteria import deviances
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.simulate import simulate
from tests.cases import RPM, TRUTH, U0, paper_model
from tests.design.test_sweep import SHORT, paper_space
from tests.estimation_cases import make_trial, naive_doublets, naive_speed, posterior, short_posterior

KEY = jax.random.key(5)
SAMPLES = 1000
ROUNDING = 1e-11
"""Relative. One lane computes the same terms whatever runs beside it, but the compiler orders sums, contracts products and chooses
exp and log by the shape of the block: 2e-16 for each of some hundred to a thousand operations in a row, times the cancellation in a sum
of squares or a determinant. Whole blocks of lanes exchanged, or one left out, would show in the first digit."""
RUN = 1e-6
"""Relative, of a run of thousands of moves whose steps are made of what was computed before: no move is decided otherwise."""


@pytest.fixture
def accelerator(monkeypatch):
    """Call to go on as on an accelerator; what was compiled before is forgotten, and again at the end."""

    def go_on(memory: int = lanes.MEMORY) -> None:
        monkeypatch.setattr(lanes, "backend", lambda: "gpu")
        monkeypatch.setattr(lanes, "MEMORY", memory)
        monkeypatch.setattr(engine, "_keeps_programs", False)  # they are those of a processor
        jax.clear_caches()

    yield go_on
    monkeypatch.undo()
    jax.clear_caches()


def total(x):
    """Sum over two arrays as long as the lane: 3 times its bytes, its own included."""
    return jnp.sum(jnp.sin(x) * 2.0)


def many(count):
    return np.zeros((count, SAMPLES))


@pytest.mark.parametrize("count", [1, 63, 5000])
def test_processor_takes_its_own_number(count):
    assert backend() == "cpu"
    assert lanes_at_once(jax.vmap(total), many(count), cpu=64) == 64


@pytest.mark.parametrize(("count", "expected"), [(1, 64), (64, 64), (65, 128), (1000, 1024), (1024, 1024)])
def test_accelerator_takes_all_in_a_power_of_two(accelerator, count, expected):
    accelerator()
    assert lanes_at_once(jax.vmap(total), many(count), cpu=64) == expected


def test_memory_bounds_lanes(accelerator):
    """A lane takes its 1000 numbers, as many twice, and a sum: 24 008 bytes."""
    for fitting, expected in ((100, 64), (64, 64), (63, 32), (1, 1), (0, 1)):
        accelerator(24_008 * fitting)
        assert lanes_at_once(jax.vmap(total), many(5000), cpu=64) == expected
        assert lanes_at_once(jax.jit(jax.vmap(total)), many(5000), cpu=64) == expected


def test_memory_counts_a_loop_once_and_what_all_lanes_share_once(accelerator):
    """A lane is a number, the sum of one turn and of the last, and the stack of 1000 sums, also turned; cosines are shared."""
    shared = np.ones((20, SAMPLES))

    def run(x):
        base = jnp.cos(jnp.asarray(shared)).sum(0)
        step = lambda total, b: (total + b, total)  # noqa: E731
        return jax.vmap(lambda one: jax.lax.scan(step, one, base)[1])(x)

    lane = 8 * (3 + 2 * SAMPLES)
    for fitting, expected in ((128, 128), (127, 64)):
        accelerator(21 * 8 * SAMPLES + lane * fitting)
        assert lanes_at_once(run, np.zeros(5000), cpu=64) == expected


def test_what_leaves_jax_gets_the_number_of_a_processor(accelerator):
    accelerator()
    assert lanes_at_once(lambda x: np.sin(np.asarray(x)), many(5000), cpu=64) == 64


def test_default_device_decides(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert backend() == "gpu"
    for device in (jax.devices("cpu")[0], "cpu"):
        with jax.default_device(device):
            assert backend() == "cpu"


@pytest.mark.parametrize("cpu", [1, 3, 64])
@pytest.mark.parametrize("fitting", [None, 1, 4, 10**6])
def test_map_over_lanes_is_the_plain_loop(accelerator, cpu, fitting):
    x = np.random.default_rng(0).normal(size=(37, SAMPLES))
    expected = [np.sin(row).sum() * 2.0 for row in x]
    if fitting is not None:
        accelerator(24_008 * fitting)
    found = jax.jit(lambda x: map_lanes(total, x, cpu))(x)
    assert found == pytest.approx(np.array(expected), rel=ROUNDING)


@pytest.mark.parametrize("fitting", [None, 4, 10**6])
def test_designs_in_blocks_keep_their_rows(accelerator, fitting):
    """Also where the last block is filled up, and for two arrays side by side."""
    x, y = np.random.default_rng(0).normal(size=(207, SAMPLES)), np.arange(207)
    if fitting is not None:
        accelerator(24_008 * fitting)
    twice, numbered = in_blocks(lambda x, y: (jax.vmap(total)(x), 2 * y), x, y)
    assert twice == pytest.approx(2 * np.sin(x).sum(1), rel=ROUNDING)
    assert (numbered == 2 * y).all()


def test_few_things_in_a_step(accelerator):
    x = jnp.linspace(0.0, 3.0, 7)
    pair = [map_in_step(lambda one: (jnp.sin(one), one**2), x)]
    loops = jax.make_jaxpr(lambda x: map_in_step(jnp.sin, x))(x)
    accelerator()
    pair.append(map_in_step(lambda one: (jnp.sin(one), one**2), x))
    for found in pair:
        assert np.array(found) == pytest.approx(np.array([np.sin(x), x**2]), rel=ROUNDING)
    assert "scan" in str(loops)
    assert "scan" not in str(jax.make_jaxpr(lambda x: map_in_step(jnp.sin, x))(x))


def surge():
    """Two trials of unequal length, with samples missing, two channels and unknown noise, under wide priors."""
    records, rng = [], np.random.default_rng(3)
    for label, n, start in (("a", 730, U0), ("b", 410, 1.2)):
        time = np.arange(n) * 0.02
        rev_per_s = naive_doublets(time, 200, 4, active=8)
        speed = naive_speed(rev_per_s, np.full(n, 0.02), start) + 0.05 * rng.normal(size=n)
        speed[100:130] = np.nan
        records.append(make_trial(time, rev_per_s, label, u=speed, udot=0.1 * rng.normal(size=n)))
    free = "X_u", "T_nabsn"
    likelihood, data = output_error(paper_model(*free), records, ["u", "udot"], [[U0], [1.2]])
    priors = {name: Uniform(*(0.5 * TRUTH[name] + side * abs(TRUTH[name]) for side in (-2, 2))) for name in free}
    return posterior({**priors, "sigma_u": Uniform(0.0, 0.1), "sigma_udot": Uniform(0.0, 0.3)}, likelihood, data)


def densities():
    """Densities, deviances and densities of single measurements at 300 draws of the prior of a surge posterior."""
    target = surge()
    z = target.sample_prior(KEY, 300)
    values = jax.vmap(target.constrain)(z)
    return (
        evaluate(target, np.asarray(z)),
        np.asarray(deviances(target, values)),
        pointwise_log_likelihood(target, np.asarray(values).reshape(2, 150, -1)),
    )


def slopes():
    """Likelihood, gradient and information at a draw."""
    target = surge()
    return tuple(map(np.asarray, likelihood_slopes(target, target.constrain(target.sample_prior(KEY, 1)[0]))))


def sweep_of(method):
    found = sweep_family(paper_space(), SHORT, np.linspace(100, 200, 9) * RPM, np.linspace(2, 10, 11), method=method)
    return found.gain, found.peak_speed, found.final_sd


def whole_vehicle():
    """Trajectories of 70 vehicles of six degrees of freedom, whose four stages are a loop on a processor."""
    vehicle = load_vehicle("remus100_prestero")
    model = vehicle.build(positions=("x", "y", "z"))
    share = np.random.default_rng(1).uniform(0.9, 1.1, 70)
    params = {name: value * share for name, value in vehicle.coefficients.items()}
    start = np.array([1.5, *np.zeros(8), 1.0, *np.zeros(3)])
    control = np.zeros((50, len(model.controls)))
    return (np.asarray(jax.vmap(lambda own: simulate(model, own, control, np.full(50, 0.01), start))(params)),)


CASES = {
    "densities": densities,
    "sweep": lambda: sweep_of(None),
    "slopes": slopes,
    "sweep, sigma points in a loop": lambda: sweep_of(UnscentedKalmanFilter()),
    "sweep, arrays": lambda: sweep_of(LargeUnscentedKalmanFilter()),
    "whole vehicle": whole_vehicle,
}
BLOCKS = "sweep", "sweep, arrays"
"""Cases that are also cut into blocks of a few; how blocks are cut and joined is that of the tests above."""


@pytest.mark.proof
@pytest.mark.parametrize(
    ("case", "memory"), [*((case, lanes.MEMORY) for case in CASES), *((case, 1 << 20) for case in BLOCKS)]
)
def test_numbers_are_those_of_the_processor(accelerator, case, memory):
    """All lanes at once, and in blocks of a few."""
    expected = CASES[case]()
    accelerator(memory)
    for found, reference in zip(CASES[case](), expected, strict=True):
        scale = np.abs(reference[np.isfinite(reference)]).max()
        assert scale > 0
        assert found == pytest.approx(reference, rel=ROUNDING, abs=ROUNDING * scale, nan_ok=True)


@pytest.mark.proof
def test_runs_are_those_of_the_processor(accelerator):
    """Tempered SMC: its evidence and every particle."""
    target = short_posterior("X_u", "X_uabsu", "T_nabsn")

    def run():
        smc = sample_tempered_smc(target, KEY, SMCSettings(192))
        return (np.append(smc.particles.ravel(), smc.log_evidence),)

    expected = run()
    accelerator()
    for found, reference in zip(run(), expected, strict=True):
        assert found == pytest.approx(reference, rel=RUN, abs=RUN)
