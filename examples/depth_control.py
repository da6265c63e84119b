"""A depth controller that keeps its bound: designed for 100 vehicles of the posterior, or for their mean.

Usage: `python examples/depth_control.py [FIGURE.svg]`; a minute of processor time. It needs CasADi: `pip install ".[export]"`.

The vehicle is to run as near as possible above a bound of 3 m. A short trial gives a posterior of a REMUS 100. `seatrial.export_vehicle`
writes linear models of its mean and of 100 draws. CasADi finds the depth to ask for and the gain of depth, so that the depth follows a ramp
to the bound with least error and never exceeds it: once for the mean, once for all 100 scenarios. Both controllers then dive 200 other
vehicles of the posterior, with all their nonlinear forces and the limits of the fin.
"""

import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.io import loadmat
from scipy.linalg import solve_continuous_are

import seatrial as st

TERMS = ("Z_uw", "Z_uq", "Z_uudelta_s", "M_uw", "M_uq", "M_uudelta_s")
SPEED, BOUND, RISE, EFFORT = 1.5, 3.0, 10.0, 50.0
"""Speed ahead, m/s; depth that no vehicle may exceed, m; time of the ramp, s; weight of the fin in the regulator."""
STEP, DURATION, FIN = 0.1, 25.0, 0.237
"""Of a simulation, s; limit of the fin, rad."""
SCENARIOS, CASES = 100, 200
TIME = np.arange(0.0, DURATION, STEP)
RAMP = np.minimum(TIME / RISE, 1.0)


class Controller(NamedTuple):
    """Depth to ask for, m, and gains of q, theta and z, from which the fin follows, rad."""

    depth: float
    gains: np.ndarray


def main(figure: str = "") -> None:
    """Find both controllers, try them, and print in how many cases each keeps the bound."""
    try:
        import casadi  # noqa: F401
    except ImportError:
        raise SystemExit('this example needs CasADi: pip install ".[export]"') from None
    st.configure()
    vehicle = st.load_vehicle("remus100_longitudinal")
    draws = posterior(vehicle)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        st.export_vehicle(vehicle, "control", folder, draws=draws, speeds=(SPEED,), count=SCENARIOS, seed=1)
        st.export_vehicle(vehicle, "draws", folder, draws=draws, count=CASES, seed=2)
        models, cases = loadmat(folder / "linear_models.mat", simplify_cells=True), dict(np.load(folder / "draws.npz"))
    shown = {}
    for kind in ("mean", "scenarios"):
        controller = design(models, kind)
        shown[kind] = dive(vehicle, cases, models, controller)
        kept = (shown[kind].max(0) <= BOUND).mean()
        print(f"designed for the {kind}: asks for {controller.depth:.3f} m with {controller.gains[2]:.3f} rad/m: "
              f"{kept:.1%} of {CASES} vehicles stay above {BOUND} m")  # fmt: skip
    if figure:
        draw(shown, Path(figure))
    means, scenarios = ((depth.max(0) <= BOUND).mean() for depth in shown.values())
    assert scenarios >= 0.95 > means


def posterior(vehicle: st.Vehicle) -> st.Draws:
    """Return draws of the normal posterior of a trial of twelve seconds, in which the stern plane moves twice a second or slower."""
    model, random = vehicle.build(free=list(TERMS), positions=["z"]), np.random.default_rng(4)
    time = np.arange(0.0, 12.0, 0.1)
    fin = np.repeat(random.choice([-0.1, 0.1], 24), 5) - 0.06
    start = {"u": SPEED, "w": 0.0, "q": 0.0, "theta": 0.0, "z": 2.0}
    noise = {"q": 0.03, "theta": 0.02, "z": 0.05}
    truth = {name: vehicle.coefficients[name] for name in TERMS} | {f"sigma_{name}": sd for name, sd in noise.items()}
    schedule = st.Schedule(time, {"n": np.full(time.size, 108.6), "delta_s": fin})
    record = st.simulate(model, truth, schedule, list(noise), start=start, rates=dict.fromkeys(noise, 10.0), key=1)
    priors = {name: st.Normal(truth[name], 0.5 * abs(truth[name])) for name in TERMS}
    priors |= {f"sigma_{name}": st.LogUniform(sd / 5, sd * 5) for name, sd in noise.items()}
    mode = st.find_mode(st.make_posterior(model, record, priors, start=start), key=1, starts=64, tries=1)
    at = [mode.names.index(name) for name in TERMS]
    normal = random.multivariate_normal(np.asarray(mode.values)[at], mode.cov[np.ix_(at, at)], (2, 2000))
    units = tuple(mode.units[i] for i in at)
    return st.Draws(normal, normal[..., 0], 0.5, 0, TERMS, units, normal)


def design(models: dict, kind: str) -> Controller:
    """Return the controller that follows a ramp to the bound with least error and keeps the bound in every linear model."""
    import casadi as ca

    states, inputs = list(models["states"]), list(models["inputs"])
    place = [states.index(name) for name in ("q", "theta", "z")]
    a, b, held = models["A"], models["B"], (models["trim_states"], models["trim_inputs"])
    drawn = [models[f"ensemble_{key}"] for key in ("A", "B", "trim_states", "trim_inputs")]
    systems = [(a, b, *held)] if kind == "mean" else list(zip(*(np.moveaxis(one, -1, 0) for one in drawn), strict=True))
    fin = inputs.index("delta_s")

    # Regulator of the mean vehicle, of which CasADi may change the gain of depth.
    weights = np.diag([1.0 if i in place else 0.0 for i in range(len(states))]) + 1e-6 * np.eye(len(states))
    cost = solve_continuous_are(a, b[:, [fin]], weights, np.array([[EFFORT]]))
    gains = -(b[:, [fin]].T @ cost / EFFORT)[0, place]

    choice, x, ramp = ca.SX.sym("choice", 2), ca.SX.sym("x", len(states)), ca.SX.sym("ramp")
    parts = [ca.SX.sym(name, *np.atleast_2d(one.T).T.shape) for name, one in zip("abst", systems[0], strict=True)]
    away = x + parts[2] - held[0]  # from the trim of the mean, which is all that the controller has
    command = gains[0] * away[place[0]] + gains[1] * away[place[1]] + choice[1] * (x[place[2]] - choice[0] * ramp)
    driven = ca.vertcat(*(command if i == fin else 0 for i in range(len(inputs)))) + held[1] - parts[3]
    rate = ca.Function("rate", [x, choice, ramp, *parts], [parts[0] @ x + parts[1] @ driven])
    k1 = rate(x, choice, ramp, *parts)
    k2 = rate(x + STEP / 2 * k1, choice, ramp, *parts)
    k3 = rate(x + STEP / 2 * k2, choice, ramp, *parts)
    k4 = rate(x + STEP * k3, choice, ramp, *parts)
    step = ca.Function("step", [x, choice, ramp, *parts], [x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])

    unknown, run = ca.MX.sym("choice", 2), step.mapaccum("run", TIME.size)
    deepest, error = [], 0
    for system in systems:
        numbers = [ca.repmat(ca.DM(np.atleast_2d(one.T).T), 1, TIME.size) for one in system]
        depth = run(held[0] - system[2], ca.repmat(unknown, 1, TIME.size), RAMP[None], *numbers)[place[2], :]
        deepest.append(ca.mmax(depth))
        error += ca.sumsqr(depth - BOUND * RAMP[None]) / len(systems)
    quiet = {
        "ipopt.hessian_approximation": "limited-memory",
        "ipopt.print_level": 0,
        "print_time": False,
        "ipopt.max_iter": 25,
        "ipopt.tol": 1e-4,
    }
    solver = ca.nlpsol("solver", "ipopt", {"x": unknown, "f": error, "g": ca.vertcat(*deepest)}, quiet)
    low, high = np.array([0.5 * BOUND, 2.0 * gains[2]]), np.array([BOUND, 0.5 * gains[2]])
    bounds = {"lbx": np.minimum(low, high), "ubx": np.maximum(low, high), "lbg": -np.inf, "ubg": BOUND}
    depth, gain = np.array(solver(x0=[0.9 * BOUND, gains[2]], **bounds)["x"]).ravel()
    return Controller(float(depth), np.array([gains[0], gains[1], gain]))


def dive(vehicle: st.Vehicle, cases: dict, models: dict, controller: Controller) -> np.ndarray:
    """Return the depths of all cases under a controller, m, shape (times, cases)."""
    import jax
    import jax.numpy as jnp

    model = vehicle.build(free=list(TERMS), positions=["z"])
    states, inputs = list(models["states"]), list(models["inputs"])
    trim = dict(zip(states, models["trim_states"], strict=True)) | dict(zip(inputs, models["trim_inputs"], strict=True))
    gains = controller.gains
    params = dict(zip(map(str, cases["names"]), jnp.asarray(cases["draws"].T), strict=True))

    @jax.jit
    def step(x: tuple, reference: float) -> tuple:
        at = dict(zip(model.states, x, strict=True))
        fin = gains[0] * at["q"] + gains[1] * (at["theta"] - trim["theta"]) + gains[2] * (at["z"] - reference)
        held = {"n": trim["n"], "delta_s": jnp.clip(trim["delta_s"] + fin, -FIN, FIN)}
        control = tuple(held[name] for name in model.controls)

        def moved(rates: tuple, share: float) -> tuple:
            return tuple(a + share * STEP * b for a, b in zip(x, rates, strict=True))

        k1 = model.derivative(params, x, control)
        k2 = model.derivative(params, moved(k1, 0.5), control)
        k3 = model.derivative(params, moved(k2, 0.5), control)
        k4 = model.derivative(params, moved(k3, 1.0), control)
        return moved(tuple(a + 2 * b + 2 * c + d for a, b, c, d in zip(k1, k2, k3, k4, strict=True)), 1 / 6)

    x = tuple(jnp.full(CASES, trim[name] if name != "z" else 0.0) for name in model.states)
    depth = []
    for reference in controller.depth * RAMP:
        depth.append(np.asarray(x[model.states.index("z")]))
        x = step(x, reference)
    return np.array(depth)


def draw(shown: dict[str, np.ndarray], path: Path) -> None:
    """Draw the depth of every fourth case, and the bound."""
    from seatrial.core.files import write_text
    from seatrial.report.drawing import draw_svg
    from seatrial.report.figures.style import BLUE, ORANGE, WIDE, label_axes, new_figure, own_settings

    with own_settings():
        figure, axes = new_figure(1.5 * WIDE, [110.0, 110.0])
        for panel, (kind, depth) in zip(axes, shown.items(), strict=True):
            kept = (depth.max(0) <= BOUND).mean()
            for one in depth.T[::4]:
                panel.plot(TIME, one, color=BLUE if one.max() <= BOUND else ORANGE, linewidth=0.6)
            panel.axhline(BOUND, color=ORANGE, linewidth=1.2, linestyle="--")
            panel.set_ylim(1.25 * BOUND, 0.0)
            label_axes(panel, y="depth [m]")
            panel.text(
                0.98,
                0.9,
                f"designed for the {kind}: {kept:.1%} keep the bound",
                transform=panel.transAxes,
                ha="right",
                va="top",
            )
        label_axes(axes[-1], "time [s]")
        write_text(path, draw_svg(figure, "depth-control"))


if __name__ == "__main__":
    main(*sys.argv[1:2])
