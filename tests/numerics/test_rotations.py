import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seatrial.numerics.rotations import (
    angle_rates,
    angles_of_quaternion,
    matrix_of_angles,
    matrix_of_quaternion,
    quaternion_of_angles,
    quaternion_rate,
    times,
    total,
)

ANGLES = [(0.3, -0.4, 1.2), (-2.5, 1.3, -3.0), (0.0, 0.5, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 2.0), (0.2, 0.3, 0.0)]
each = pytest.mark.parametrize("angles", ANGLES)


@each
def test_matrices_and_quaternions_of_angles(angles):
    expected = Rotation.from_euler("ZYX", angles[::-1])
    assert np.allclose(np.array(matrix_of_angles(*angles), float), expected.as_matrix(), atol=1e-14)
    quaternion = np.array(quaternion_of_angles(*angles))
    x, y, z, w = expected.as_quat()
    assert np.allclose(quaternion * np.sign(quaternion[0] * w), [w, x, y, z], atol=1e-14)
    assert np.allclose(matrix_of_quaternion(tuple(quaternion)), expected.as_matrix(), atol=1e-14)
    assert np.allclose(angles_of_quaternion(tuple(1.3 * quaternion)), angles, atol=1e-13)


@each
def test_rates_are_those_of_small_turns(angles):
    rotation, h = np.array([0.3, -0.5, 0.7]), 1e-6
    after, before = (Rotation.from_euler("ZYX", angles[::-1]) * Rotation.from_rotvec(s * h * rotation) for s in (1, -1))
    expected = (after.as_euler("ZYX") - before.as_euler("ZYX"))[::-1] / (2 * h)
    assert np.allclose(np.array(angle_rates(angles[0], angles[1], tuple(rotation)), float), expected, atol=1e-8)
    q = tuple(np.array(quaternion_of_angles(*angles)))
    slope = np.array(quaternion_rate(q, tuple(rotation), pull=1.0))
    x, y, z, w = (after.as_quat() * np.sign(after.as_quat() @ before.as_quat()) - before.as_quat()) / (2 * h)
    sign = np.sign(before.as_quat()[3] * q[0])
    assert np.allclose(slope, sign * np.array([w, x, y, z]), atol=1e-8)


def test_known_zeros_and_ones_leave_no_trace():
    thing = object()
    assert times(thing, 0.0) == 0.0
    assert times(1.0, thing) is thing
    assert total((0.0, thing, 0.0)) is thing
    assert total(()) == 0.0
