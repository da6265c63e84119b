"""Vehicles simulated by plain loops that share no code with seatrial, by midpoint steps: surge, and surge with sway and yaw.

Values are SI, by the names of coefficients; one that is left out is zero.
"""

from collections.abc import Mapping

import numpy as np

SURGE_MASS, DEDUCTION = 31.41, 0.1
"""Effective mass of the surge vehicle, kg; share of the thrust that each hull takes."""
MASS, CENTRE, INERTIA = 30.48, 0.05, 3.45
"""Of the vehicle with three axes: dry mass, kg; centre of gravity ahead of the origin, m; inertia about the origin, kg m^2."""
ADDED = {"X_udot": -0.93, "Y_vdot": -35.5, "Y_rdot": 1.93, "N_vdot": 1.93, "N_rdot": -4.88}
"""Its added mass. Coriolis forces of the added mass are coefficients like others."""


def surge(
    values: Mapping[str, float],
    command: np.ndarray,
    step: float,
    *,
    start: float = 1.5,
    mass: float = SURGE_MASS,
    lag: float = 0.0,
    push: np.ndarray | None = None,
    fine: int = 5,
) -> np.ndarray:
    """Return the surge velocity at the samples, m/s, shape (n,).

    Args:
        values: coefficients.
        command: speed of the propeller from each sample to the next, rad/s, shape (n,).
        step: interval of the samples, s.
        start: surge velocity at the first.
        mass: effective mass, kg.
        lag: of the propeller, s.
        push: further force, N, at each step, shape (n fine,).
        fine: steps from sample to sample.
    """
    c = {name: values.get(name, 0.0) for name in ("X_0", "X_u", "X_uabsu", "X_u3", "X_u4")}
    t = {name: values.get(name, 0.0) for name in ("T_nabsn", "T_un", "T_n", "T_uun", "T_unn")}
    force = np.zeros(command.size * fine) if push is None else push
    h, u, n, shown = step / fine, start, command[0], np.empty(command.size)
    for i, wanted in enumerate(command):
        shown[i] = u
        for j in range(fine):
            turning = n if lag else wanted

            def rate(u: float, n: float = turning, push: float = force[i * fine + j]) -> float:
                thrust = t["T_nabsn"] * n * abs(n) + t["T_un"] * u * n
                thrust += t["T_n"] * n + t["T_uun"] * u * u * n + t["T_unn"] * u * n * n
                drag = c["X_u"] * u + c["X_uabsu"] * u * abs(u) + c["X_u3"] * u**3 + c["X_0"] + c["X_u4"] * u**4
                return ((1 - DEDUCTION) * thrust + drag + push) / mass

            u += h * rate(u + h / 2 * rate(u))
            n += (wanted - n) * (1.0 - np.exp(-h / lag)) if lag else 0.0
    return shown


def three_axes(
    values: Mapping[str, float],
    propeller: np.ndarray,
    rudder: np.ndarray,
    step: float,
    *,
    start: tuple[float, float, float] = (1.5, 0.0, 0.0),
    fine: int = 10,
) -> np.ndarray:
    """Return surge, sway and yaw rate at the samples, m/s and rad/s, shape (n, 3).

    Args:
        values: coefficients.
        propeller: its speed from each sample to the next, rad/s, shape (n,).
        rudder: its angle likewise, rad.
        step: interval of the samples, s.
        start: motion at the first.
        fine: steps from sample to sample.
    """
    names = ("X_uabsu", "X_vr", "X_v2", "Y_uv", "Y_ur", "Y_v", "Y_vabsv", "Y_uudelta_r")
    names = (*names, "N_uv", "N_ur", "N_r", "N_vabsv", "N_rabsr", "N_uudelta_r", "T_nabsn")
    c = {name: values.get(name, 0.0) for name in names}
    m11, m22, m66 = MASS - ADDED["X_udot"], MASS - ADDED["Y_vdot"], INERTIA - ADDED["N_rdot"]
    m26, m62 = MASS * CENTRE - ADDED["Y_rdot"], MASS * CENTRE - ADDED["N_vdot"]
    determinant = m22 * m66 - m26 * m62

    def rates(u: float, v: float, r: float, n: float, angle: float) -> tuple[float, float, float]:
        x = c["X_uabsu"] * u * abs(u) + (1 - DEDUCTION) * c["T_nabsn"] * n * abs(n) + c["X_vr"] * v * r
        x += c["X_v2"] * v * v + MASS * (v * r + CENTRE * r * r)
        y = c["Y_uv"] * u * v + c["Y_ur"] * u * r + c["Y_v"] * v + c["Y_vabsv"] * v * abs(v)
        y += c["Y_uudelta_r"] * u * u * angle - MASS * u * r
        z = c["N_uv"] * u * v + c["N_ur"] * u * r + c["N_r"] * r + c["N_vabsv"] * v * abs(v)
        z += c["N_rabsr"] * r * abs(r) + c["N_uudelta_r"] * u * u * angle - MASS * CENTRE * u * r
        return x / m11, (m66 * y - m26 * z) / determinant, (m22 * z - m62 * y) / determinant

    h, now, shown = step / fine, start, np.empty((propeller.size, 3))
    for i, (n, angle) in enumerate(zip(propeller.tolist(), rudder.tolist(), strict=True)):
        shown[i] = now
        for _ in range(fine):
            half = [a + h / 2 * b for a, b in zip(now, rates(*now, n, angle), strict=True)]
            u, v, r = (a + h * b for a, b in zip(now, rates(*half, n, angle), strict=True))
            now = (u, v, r)
    return shown


def drift(sd: float, memory: float, count: int, step: float, random: np.random.Generator) -> np.ndarray:
    """Return an Ornstein-Uhlenbeck process."""
    kept, now, result = np.exp(-step / memory), sd * random.standard_normal(), np.empty(count)
    for i in range(count):
        result[i] = now
        now = kept * now + sd * np.sqrt(1 - kept**2) * random.standard_normal()
    return result
