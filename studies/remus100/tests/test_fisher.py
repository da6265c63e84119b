"""Fisher information against finite differences of a plain loop, and against numbers measured elsewhere."""

import jax.numpy as jnp
import numpy as np
import pytest

from seatrial.manoeuvres.relay import RelayFamily, run_relay
from studies.remus100.fisher import fisher_information
from tests.cases import N0, RPM, THRUST, TRUTH, U0, X_U, X_UU, paper_model, surge_rate
from tests.design.test_sweep import paper_space
from tests.estimation_cases import SIGMA, THRUST_UNIT, naive_doublets, naive_speed

TIME = np.arange(6000) * 0.01
PRINTED = np.array([1.0, 1.0, THRUST_UNIT])
"""SI value of one printed unit of X_u, X_uabsu and T_nabsn."""


def information(*rev_per_s, doubted=None, step=0.01, noise=None):
    truth = TRUTH | ({} if doubted is None else {"X_du3": doubted})
    control = 2 * np.pi * np.stack(rev_per_s)[..., None]
    return fisher_information(paper_model(*truth), truth, control, step, [U0], noise or {"u": SIGMA})


def half_log_det(found, scale=PRINTED):
    return 0.5 * np.linalg.slogdet(found * np.outer(scale, scale))[1]


def sds(found):
    return np.sqrt(np.diag(np.linalg.inv(found)))


def naive_information(rev_per_s, step, noise, h=1e-4):
    """Central differences of u and udot in (X_u, X_uabsu, T in N/(rev/s)^2, X_du3), all moved versions in one loop."""
    truth = np.array([X_U, X_UU, THRUST, 0.1])
    size = h * np.abs(truth)
    moved = truth[:, None] + np.hstack([np.diag(size), -np.diag(size)])
    named = dict(zip(("x_u", "x_uu", "thrust", "cubic"), moved, strict=True))
    u = naive_speed(rev_per_s, np.full(rev_per_s.size, step), start=np.full(8, U0), **named)
    outputs = {"u": u, "udot": surge_rate(u, rev_per_s[:, None], **named)}
    slopes = np.concatenate(
        [(outputs[name][:, :4] - outputs[name][:, 4:]) / (2 * size * sd) for name, sd in noise.items()]
    )
    scale = np.array([1.0, 1.0, (2 * np.pi) ** 2, 1.0])
    return slopes.T @ slopes * np.outer(scale, scale)


@pytest.mark.parametrize("noise", [{"u": 0.05}, {"u": 0.05, "udot": 0.2}], ids=["speed", "speed and acceleration"])
def test_against_differences_of_a_plain_loop(noise):
    """Differences of 1e-4 of each coefficient leave relative errors of 1e-8 in the slopes."""
    rev_per_s = naive_doublets(np.arange(150) * 0.1, 200, 5, active=10)
    found = information(rev_per_s, doubted=0.1, step=0.1, noise=noise)[0]
    scale = 1 / np.sqrt(np.diag(found))
    expected = naive_information(rev_per_s, 0.1, noise)
    np.testing.assert_allclose(found * np.outer(scale, scale), expected * np.outer(scale, scale), atol=1e-6)


def test_designs_in_one_call_are_those_alone():
    designs = [naive_doublets(TIME[:500], 200, period, active=4) for period in (1, 2, 4)]
    together = information(*designs)
    alone = np.concatenate([information(design) for design in designs])
    np.testing.assert_allclose(together, alone, rtol=1e-10)


def test_half_the_noise_is_four_times_the_information():
    design = naive_doublets(TIME[:500], 200, 2, active=4)
    np.testing.assert_allclose(information(design, noise={"u": SIGMA / 2}), 4 * information(design), rtol=1e-12)


def test_trim_alone_cannot_tell_drag_from_thrust():
    """Without a manoeuvre the speed stays, and the three coefficients matter only through their sum of forces."""
    values = np.linalg.eigvalsh(information(np.full(500, 12.5))[0] * np.outer(PRINTED, PRINTED))
    assert values[0] < 1e-10 * values[-1]
    assert values[1] < 1e-10 * values[-1]


@pytest.mark.parametrize(("period", "golden"), [(10, 10.9), (20, 11.75)])
def test_golden_information_of_doublets(period, golden):
    """Of (X_u, X_uabsu, 100 T), T in N/(rev/s)^2: no plateau at 10 s."""
    found = information(naive_doublets(TIME, 200, period))[0]
    assert half_log_det(found) == pytest.approx(golden, abs=0.02)


@pytest.mark.parametrize(("rpm", "golden"), [(200, 11.310), (100, 3.265), (150, 4.422)])
def test_golden_information_of_self_oscillation(rpm, golden):
    """Relay over the whole minute, threshold 0.35 m/s, which 100 and 150 rpm never reach."""
    family = RelayFamily((("n", N0),), "n", "u", U0, duration=60.0, sample_time=0.01)
    control = run_relay(paper_space(), family, rpm * RPM, 0.35, jnp.array([U0, X_U, X_UU, THRUST])).control
    found = information(np.asarray(control)[:, 0] / (2 * np.pi))[0]
    assert half_log_det(found) == pytest.approx(golden, abs=0.005)


@pytest.mark.parametrize(("period", "active", "doubted", "drag"), [(10, 40, 5.61, 0.37), (29, 58, 1.416, 0.24)])
def test_golden_standard_deviations_of_the_doubted_term(period, active, doubted, drag):
    """The paper's doublet, and the best one tried: 29 s, twice in 58 s."""
    found = sds(information(naive_doublets(TIME, 200, period, active), doubted=0.1)[0])
    assert (found[3], found[0]) == (pytest.approx(doubted, abs=0.005), pytest.approx(drag, abs=0.005))
