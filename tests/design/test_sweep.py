import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.core.errors import InputError, NumericalError
from seatrial.design.sweep import _share, sweep_family
from seatrial.filters.extended import ExtendedKalmanFilter
from seatrial.filters.square_root import LargeUnscentedKalmanFilter, SquareRootUnscentedKalmanFilter
from seatrial.manoeuvres.family import Family
from seatrial.manoeuvres.manoeuvre import Limits
from seatrial.numerics.gaussian import Gaussian, independent
from seatrial.numerics.integrate import euler_step
from seatrial.numerics.state_space import StateSpace
from seatrial.vehicles.discretise import discretise
from tests.cases import N0, RPM, SCALES, THRUST, U0, X_U, X_UU, paper_model, surge_rate
from tests.estimation_cases import naive_doublets
from tests.filters.textbook import Problem, extended, unscented

TRUTH = np.array([U0, X_U, X_UU, THRUST])
"""Thrust in N/(rev/s)^2, as printed."""
PROCESS_SD = np.sqrt([1e-6, 1e-7, 1e-7, 1e-10])
PRIOR_SD = np.sqrt([1.0, 1e5, 1e5, 10.0])
SHORT = Family("n", N0, duration=12.0, active=10.0, sample_time=0.1)
AMPLITUDES, PERIODS = np.array([100.0, 200.0]) * RPM, np.array([3.0, 10.0])


def paper_space(prior_sd=PRIOR_SD, mean=TRUTH):
    """State space of the golden entropies: u and udot measured with sd 0.1, Euler steps."""
    return discretise(
        paper_model(), ("u", "udot"), independent(mean, prior_sd), PROCESS_SD, np.array([0.1, 0.1]), SCALES, euler_step
    )


def textbook_gain(method, amplitude, period, family=SHORT, prior_sd=PRIOR_SD, mean=TRUTH, truth=TRUTH, seen=(1.0, 1.0)):
    """Entropy reduction of one doublet by a textbook filter over the motion of a plain Euler loop; and that motion."""

    def rate(u, control, x):
        return surge_rate(u, control / (2 * np.pi), *x[1:])

    time = np.arange(round(family.duration / family.sample_time)) * family.sample_time
    control = 2 * np.pi * naive_doublets(time, amplitude / RPM, period, family.active, family.start)
    speed = [truth[0]]
    for c in control[:-1]:
        speed.append(speed[-1] + family.sample_time * rate(speed[-1], c, truth))
    measured = np.column_stack([speed, rate(np.array(speed), control, truth)])
    problem = Problem(
        mean,
        np.diag(prior_sd**2),
        lambda x, c, h: np.array([x[0] + h * rate(x[0], c, x), *x[1:]]),
        lambda x, c: np.array([x[0], rate(x[0], c, x)]),
        np.diag(PROCESS_SD**2),
        0.01 * np.eye(2),
    )
    last = method(problem, control, np.where(seen, measured, np.nan), np.full(time.size, family.sample_time)).covs[-1]
    gain = 0.5 * (2 * np.log(prior_sd[1:]).sum() - np.linalg.slogdet(last[1:, 1:])[1])
    return gain, np.abs(speed).max(), np.sqrt(np.diag(last)[1:])


BELIEF_SD = np.array([0.1, 1.0, 1.0, 0.02])
FILTERS = {
    "extended": (ExtendedKalmanFilter(), extended),
    "on arrays": (LargeUnscentedKalmanFilter(), unscented),
    "square root": (SquareRootUnscentedKalmanFilter(), unscented),
}
each_filter = pytest.mark.parametrize(
    ("method", "naive"),
    [FILTERS["extended"], FILTERS["on arrays"], pytest.param(*FILTERS["square root"], marks=pytest.mark.proof)],
    ids=FILTERS,
)


@each_filter
def test_every_design_alone_by_the_textbook(method, naive):
    sweep = sweep_family(paper_space(BELIEF_SD), SHORT, AMPLITUDES, PERIODS, method=method)
    assert sweep.gain.shape == sweep.peak_speed.shape == (2, 2)
    assert sweep.final_sd.shape == (2, 2, 3)
    for i, amplitude in enumerate(AMPLITUDES):
        for j, period in enumerate(PERIODS):
            gain, peak, sd = textbook_gain(naive, amplitude, period, prior_sd=BELIEF_SD)
            assert sweep.gain[i, j] == pytest.approx(gain, abs=1e-6)
            assert sweep.peak_speed[i, j] == pytest.approx(peak, rel=1e-12)
            assert sweep.final_sd[i, j] == pytest.approx(sd, rel=1e-6)


@each_filter
def test_motion_of_the_truth_and_filter_of_the_belief(method, naive):
    mean = TRUTH * [1, 0.75, 0.75, 0.75]
    sweep = sweep_family(paper_space(BELIEF_SD, mean), SHORT, AMPLITUDES, PERIODS, method=method, truth=TRUTH)
    gain, peak, _ = textbook_gain(naive, AMPLITUDES[1], PERIODS[0], prior_sd=BELIEF_SD, mean=mean)
    assert sweep.gain[1, 0] == pytest.approx(gain, abs=1e-6)
    assert sweep.peak_speed[1, 0] == pytest.approx(peak, rel=1e-12)


@each_filter
def test_speed_alone_teaches_less(method, naive):
    measured = np.tile([1.0, 0.0], (SHORT.time().size, 1))
    both = sweep_family(paper_space(BELIEF_SD), SHORT, AMPLITUDES, PERIODS, method=method)
    speed = sweep_family(paper_space(BELIEF_SD), SHORT, AMPLITUDES, PERIODS, method=method, measured=measured)
    gain, _, _ = textbook_gain(naive, AMPLITUDES[0], PERIODS[1], prior_sd=BELIEF_SD, seen=(1.0, 0.0))
    assert (speed.gain < both.gain).all()
    assert speed.gain[0, 1] == pytest.approx(gain, abs=1e-6)


DECAY, COVARIANCE = 0.9, np.array([[0.5, 0.2, 0.0], [0.2, 2.0, -0.3], [0.0, -0.3, 1.0]])


def moves(x, c, h):
    return (DECAY * x[0] + x[1] * c[0] + x[2] * c[0] ** 2,)


def is_seen(x, c):
    return (x[0],)


def linear_space():
    """x' = 0.9 x + a c + b c^2 measured with sd 0.3: linear in the state and the coefficients a and b."""
    belief = Gaussian(jnp.array([0.1, 0.4, -0.2]), jnp.asarray(np.linalg.cholesky(COVARIANCE)))
    return StateSpace(belief, np.zeros(3), np.array([0.3]), ("x", "a", "b"), ("x",), 1, moves, is_seen)


@pytest.mark.parametrize("every", [1, 3])
def test_linear_gaussian_gain_is_that_of_the_fisher_information(every):
    """0.5 ln |I + P F| over x and the coefficients with F the information matrix; x is then marginalised out."""
    family = Family("c", 1.0, duration=12.0, active=10.0, sample_time=0.5)
    time = family.time()
    seen = (np.arange(time.size) % every == 0)[:, None]
    sweep = sweep_family(linear_space(), family, np.array([0.0, 2.0]), np.array([4.0]), measured=seen * 1.0)
    for i, amplitude in enumerate([0.0, 2.0]):
        control = 1.0 + naive_doublets(time, 60 * amplitude, 4.0, 10.0) - 12.5
        rows = [np.array([1.0, 0.0, 0.0])]
        for c in control[:-1]:
            rows.append(DECAY * rows[-1] + [0.0, c, c**2])
        information = sum(np.outer(row, row) for row, s in zip(rows, seen[:, 0], strict=True) if s) / 0.3**2
        after = np.linalg.inv(np.linalg.inv(COVARIANCE) + information)[1:, 1:]
        expected = 0.5 * np.log(np.linalg.det(COVARIANCE[1:, 1:]) / np.linalg.det(after))
        assert sweep.gain[i, 0] == pytest.approx(expected, rel=1e-9)
        assert sweep.final_sd[i, 0] == pytest.approx(np.sqrt(np.diag(after)), rel=1e-9)
    assert sweep.best == (1, 0)


GOLDEN = Family("n", N0, duration=60.0, active=40.0, sample_time=0.01)


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [
        pytest.param(ExtendedKalmanFilter(), 0.05, marks=pytest.mark.proof),
        (LargeUnscentedKalmanFilter(), 1e-3),
        pytest.param(SquareRootUnscentedKalmanFilter(), 1e-3, marks=pytest.mark.proof),
    ],
    ids=FILTERS,
)
def test_golden_entropies(method, tolerance):
    """The golden numbers are the square-root filter's."""
    sweep = sweep_family(
        paper_space(mean=TRUTH * [1, 0.75, 0.75, 0.75]),
        GOLDEN,
        AMPLITUDES,
        np.array([1.0, 10.0, 20.0]),
        method=method,
        truth=TRUTH,
    )
    assert sweep.gain[0, 0] == pytest.approx(21.582, abs=tolerance)
    assert sweep.gain[1, 1:] == pytest.approx([25.078, 25.249], abs=tolerance)
    assert sweep.best == (1, 2)


def test_best_design_as_a_manoeuvre():
    sweep = sweep_family(paper_space(BELIEF_SD), SHORT, AMPLITUDES, PERIODS, method=ExtendedKalmanFilter())
    row, column = sweep.best
    assert sweep.gain[row, column] == sweep.gain.max()
    time, control = sweep.best_manoeuvre().sample(0.1)
    assert np.allclose(control, 2 * np.pi * naive_doublets(time, AMPLITUDES[row] / RPM, PERIODS[column], 10.0))


LINEAR_FAMILY = Family("c", 1.0, duration=12.0, active=10.0, sample_time=0.5, ramp=1.0)


def limited(limits, amplitudes=(1.0, 2.0, 4.0), periods=(2.0, 5.0, 12.0), family=LINEAR_FAMILY):
    return sweep_family(linear_space(), family, np.array(amplitudes), np.array(periods), limits)


@pytest.mark.parametrize(
    ("limits", "feasible"),
    [
        (Limits(), [[1, 1, 0]] * 3),
        (Limits(upper=3.0), [[1, 1, 0], [1, 1, 0], [0, 0, 0]]),
        (Limits(lower=-0.5), [[1, 1, 0], [0, 0, 0], [0, 0, 0]]),
        (Limits(rate=4.0), [[1, 1, 0], [1, 1, 0], [0, 0, 0]]),
    ],
    ids=["none", "upper", "lower", "rate"],
)
def test_designs_outside_the_limits_have_no_gain(limits, feasible):
    """The control reaches 1 + A and 1 - A, its steepest edge 2 A in 1 s; a period of 12 s does not fit into 10 s."""
    sweep = limited(limits)
    assert np.isfinite(sweep.gain).tolist() == (np.array(feasible) == 1).tolist()
    assert np.isfinite(sweep.gain[sweep.best])
    assert (sweep.gain[np.isfinite(sweep.gain)] == limited(Limits()).gain[np.isfinite(sweep.gain)]).all()


@pytest.mark.parametrize(
    ("limits", "found"),
    [
        (Limits(upper=1.5), ["no design of 3", "amplitude 1 (SI) and period 5 s", "upper limit 1.5 (SI), reaching 2"]),
        (Limits(lower=0.25), ["lower limit 0.25 (SI), reaching 0"]),
        (Limits(upper=1.5, rate=0.5), ["upper limit 1.5 (SI), reaching 2 and rate limit 0.5 (SI)/s, reaching 2"]),
    ],
)
def test_no_design_inside_the_limits(limits, found):
    with pytest.raises(InputError, match="control c") as caught:
        limited(limits, periods=(5.0, 12.0))
    assert all(words in caught.value.found for words in found)
    assert "widen the limits" in caught.value.remedy


def test_the_gentlest_design_is_told_in_the_units_of_the_trade():
    """Of 100 and 200 rpm about trim the first, with all that it breaks."""
    limits, rpm = Limits(upper=SHORT.trim + 5.0), 30 / np.pi
    with pytest.raises(InputError) as caught:
        sweep_family(paper_space(BELIEF_SD), SHORT, np.array([100.0, 200.0]) * np.pi / 30, PERIODS, limits)
    assert "amplitude 100 rpm" in caught.value.found
    assert (
        f"upper limit {(SHORT.trim + 5.0) * rpm:.6g} rpm, reaching {SHORT.trim * rpm + 100.0:.6g}" in caught.value.found
    )


def test_no_period_fits():
    with pytest.raises(InputError, match="periods from 11 s") as caught:
        limited(Limits(), periods=(11.0, 15.0))
    assert "to 10 s, so that it fits into 10 s" in caught.value.expected


def test_no_edge_fits():
    """Edges of 1 s need periods of 2 s at least."""
    with pytest.raises(InputError) as caught:
        limited(Limits(), periods=(1.0, 1.5))
    assert "period" in caught.value.found


def test_motion_that_diverges():
    runaway = np.array([U0, X_U, 60.0, THRUST])
    with pytest.raises(NumericalError, match=r"the extended filter.*all.*first at amplitude.* rpm.*or set filter"):
        sweep_family(paper_space(BELIEF_SD, runaway), SHORT, AMPLITUDES, PERIODS, method=ExtendedKalmanFilter())


def test_only_designs_that_diverge_are_left_out():
    """Beside one beyond all numbers the others are as without it."""
    beside = sweep_family(paper_space(BELIEF_SD), SHORT, np.array([*AMPLITUDES, 1e200]), PERIODS)
    alone = sweep_family(paper_space(BELIEF_SD), SHORT, AMPLITUDES, PERIODS)
    assert np.isnan(beside.gain[-1]).all()
    assert np.isposinf(beside.peak_speed[-1]).all()
    assert beside.gain[:-1] == pytest.approx(alone.gain, rel=1e-9)
    assert beside.best == alone.best


def test_excess_counts_as_a_share_of_the_bound():
    assert _share((2.0, 1.5)) == pytest.approx(1 / 3)
    assert _share((-3.0, -2.0)) == pytest.approx(0.5)
    assert _share((1.0, 0.0)) == pytest.approx(1e9)
