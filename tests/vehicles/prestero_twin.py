"""Prestero's equations of the REMUS 100 in plain NumPy with Euler angles, written out from the thesis and not from the package.

Positions x, y, z north, east and down; velocities over ground, of which those relative to a uniform current make the forces.
"""

import numpy as np

M, W, B, ZG = 30.48, 299.0, 306.0, 0.0196
IXX, IYY, IZZ = 0.177, 3.45, 3.45
XUD, YVD, YRD, ZWD, ZQD, KPD, MWD, MQD, NVD, NRD = -0.93, -35.5, 1.93, -35.5, -1.93, -0.0704, -1.93, -4.88, 1.93, -4.88
PUBLISHED = {
    "X_0": 3.86, "X_uabsu": -1.62, "Y_vabsv": -1310.0, "Y_rabsr": 0.632, "Y_uv": -28.6, "Y_ur": 5.22, "Y_uudelta_r": 9.64,
    "Z_wabsw": -1310.0, "Z_qabsq": -0.632, "Z_uw": -28.6, "Z_uq": -5.22, "Z_uudelta_s": -9.64, "K_0": -0.543,
    "K_pabsp": -0.13, "M_wabsw": 3.18, "M_qabsq": -188.0, "M_uw": 24.0, "M_uq": -2.0, "M_uudelta_s": -6.15,
    "N_vabsv": -3.18, "N_rabsr": -94.0, "N_uv": -24.0, "N_ur": -2.0, "N_uudelta_r": -6.15,
}  # fmt: skip
MASS_MATRIX = np.array(
    [
        [M - XUD, 0, 0, 0, M * ZG, 0],
        [0, M - YVD, 0, -M * ZG, 0, -YRD],
        [0, 0, M - ZWD, 0, -ZQD, 0],
        [0, -M * ZG, 0, IXX - KPD, 0, 0],
        [M * ZG, 0, -MWD, 0, IYY - MQD, 0],
        [0, -NVD, 0, 0, 0, IZZ - NRD],
    ]
)
INVERSE = np.linalg.inv(MASS_MATRIX)


def rotation(phi, theta, psi):
    """Body to north, east, down."""
    s1, c1, s2, c2, s3, c3 = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    return np.array(
        [
            [c3 * c2, -s3 * c1 + c3 * s2 * s1, s3 * s1 + c3 * c1 * s2],
            [s3 * c2, c3 * c1 + s1 * s2 * s3, -c3 * s1 + s2 * s3 * c1],
            [-s2, c2 * s1, c2 * c1],
        ]
    )


def forces(nu, angles, dr, ds, c=PUBLISHED, drive=(3.86, -0.543)):
    """Right-hand side of the six equations, for velocities through the water and the propeller's thrust and torque."""
    u, v, w, p, q, r = nu
    phi, theta, _ = angles
    st, ct, sp, cp = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    xwq, xqq, xvr, xrr, ywp, ypq, zvp, zrp = ZWD, ZQD, -YVD, -YRD, -ZWD, -ZQD, YVD, YRD
    mvp, mrp, nwp, npq = -YRD, 4.86, ZQD, -4.86
    x = -(W - B) * st + c["X_uabsu"] * u * abs(u) + (xwq - M) * w * q + xqq * q**2 + (xvr + M) * v * r + xrr * r**2
    x += -M * ZG * p * r + drive[0]
    y = (W - B) * ct * sp + c["Y_vabsv"] * v * abs(v) + c["Y_rabsr"] * r * abs(r) + c["Y_uv"] * u * v
    y += (ywp + M) * w * p + (c["Y_ur"] - M) * u * r - M * ZG * q * r + ypq * p * q + c["Y_uudelta_r"] * u**2 * dr
    z = (W - B) * ct * cp + c["Z_wabsw"] * w * abs(w) + c["Z_qabsq"] * q * abs(q) + c["Z_uw"] * u * w
    z += (
        (c["Z_uq"] + M) * u * q
        + (zvp - M) * v * p
        + M * ZG * (p**2 + q**2)
        + zrp * r * p
        + c["Z_uudelta_s"] * u**2 * ds
    )
    k = -ZG * W * ct * sp + c["K_pabsp"] * p * abs(p) - (IZZ - IYY) * q * r - M * ZG * w * p + M * ZG * u * r + drive[1]
    m = -ZG * W * st + c["M_wabsw"] * w * abs(w) + c["M_qabsq"] * q * abs(q) + (mrp - (IXX - IZZ)) * r * p
    m += M * ZG * v * r - M * ZG * w * q + c["M_uq"] * u * q + c["M_uw"] * u * w + mvp * v * p
    m += c["M_uudelta_s"] * u**2 * ds
    n = c["N_vabsv"] * v * abs(v) + c["N_rabsr"] * r * abs(r) + c["N_uv"] * u * v + (npq - (IYY - IXX)) * p * q
    n += nwp * w * p + c["N_ur"] * u * r + c["N_uudelta_r"] * u**2 * dr
    return np.array([x, y, z, k, m, n])


def rate(state, dr, ds, drive=(3.86, -0.543), c=PUBLISHED, current=(0.0, 0.0, 0.0)):
    """Rate of (u, v, w, p, q, r, x, y, z, phi, theta, psi), velocities over ground."""
    angles = state[9:]
    matrix = rotation(*angles)
    omega = state[3:6]
    water = matrix.T @ np.asarray(current)
    relative = state[:6] - np.concatenate([water, np.zeros(3)])
    moved = INVERSE @ forces(relative, angles, dr, ds, c, drive)
    moved[:3] -= np.cross(omega, water)
    phi, theta, _ = angles
    turn = omega[1] * np.sin(phi) + omega[2] * np.cos(phi)
    turned = [omega[0] + turn * np.tan(theta), omega[1] * np.cos(phi) - omega[2] * np.sin(phi), turn / np.cos(theta)]
    return np.concatenate([moved, matrix @ state[:3], turned])


def trajectory(start, rudder, plane, step, drive=None, **options):
    """States at every sample, shape (n, 12), by classical Runge-Kutta; fins, thrust and torque (n, 2) are held over each step."""
    states = [np.asarray(start, float)]
    drive = np.tile((3.86, -0.543), (len(rudder), 1)) if drive is None else drive
    for held in zip(rudder[:-1], plane[:-1], drive[:-1], strict=True):
        x = states[-1]
        k1 = rate(x, *held, **options)
        k2 = rate(x + step / 2 * k1, *held, **options)
        k3 = rate(x + step / 2 * k2, *held, **options)
        k4 = rate(x + step * k3, *held, **options)
        states.append(x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    return np.array(states)
