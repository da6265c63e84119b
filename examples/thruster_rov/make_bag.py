"""A minute of a thruster-driven ROV as a ROS 2 bag holds them: `python make_bag.py FOLDER` writes FOLDER/pool and FOLDER/thrust.csv.

Eight pulse widths in one message without a header, an IMU (gyro and attitude), a DVL, a depth cell and motion capture, each at its own
rate. The vehicle
is the catalogue's BlueROV2 Heavy with damping, buoyancy and thrusters of its own; its thrusters push it along and about each axis in turn,
through several turns of the heading and over the vertical.
"""

import sys
from pathlib import Path

import jax
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from seatrial.numerics.integrate import rk4_step
from seatrial.vehicles.actuators import Actuator, with_actuators
from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.thrusters import allocation

RATE, DURATION = 50, 60
TRUTH = {
    **{"X_u": -11.0, "X_uabsu": -120.0, "Y_vabsv": -180.0, "Z_w": -28.0, "Z_wabsw": -150.0},
    **{"K_pabsp": -1.5, "M_q": -0.6, "M_qabsq": -0.7, "N_rabsr": -1.9},
    **{"net_weight": -1.5, "z_b": -0.008, "gain_f_3": 0.8},
}
BEYOND = ("net_weight", "z_b", "gain_f_3")
"""What this vehicle has otherwise than the catalogue: thruster 3 is worn."""
LAG = 0.15
"""Time constant of the thrusters, s."""
NOISE = {"gyro": 0.005, "attitude": 0.01, "dvl": 0.01, "depth": 0.02, "mocap": 0.005}
FULL, DEAD = 40.0, 25.0
"""Thrust, N, at 400 us from neutral, and where it begins, us."""


def thrust_of(pulse: np.ndarray) -> np.ndarray:
    """Thrust of a pulse width in microseconds, N: a square law beyond the dead zone, four fifths of it astern."""
    beyond = np.maximum(np.abs(pulse - 1500.0) - DEAD, 0.0) / (400.0 - DEAD)
    return FULL * beyond**2 * np.where(pulse < 1500.0, -0.8, 1.0)


def pulses() -> np.ndarray:
    """Pulse width of each thruster at each instant, us, shape (n, 8): pushes along and about each axis, a few seconds each."""
    rng, matrix = np.random.default_rng(4), allocation(load_vehicle("bluerov2_heavy").thrusters)
    largest = np.array([50.0, 50.0, 60.0, 4.0, 4.0, 4.0])
    wanted = np.zeros((RATE * DURATION, 6))
    at = 0
    while at < len(wanted):
        push = largest * rng.uniform(-1, 1, 6) * (rng.random(6) < 0.4)
        hold = RATE // 10 * int(10 * rng.uniform(0.6, 3.0))
        wanted[at : at + hold] = push
        at += hold
    wanted[: RATE * 2] = 0.0
    force = np.clip(wanted @ np.linalg.pinv(matrix).T, -0.8 * FULL, FULL)
    share = np.sqrt(np.abs(force) / np.where(force < 0, 0.8 * FULL, FULL))
    return np.rint(1500.0 + np.sign(force) * np.where(share > 0, DEAD + (400.0 - DEAD) * share, 0.0))


def motion(pulse: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """States at each instant, and their names."""
    vehicle = load_vehicle("bluerov2_heavy")
    model = vehicle.build(attitude="quaternion", positions=("x", "y", "z"), unknowns=BEYOND)
    model = with_actuators(model, {name: Actuator(LAG) for name in model.controls})
    params, force = {**vehicle.coefficients, **TRUTH}, thrust_of(pulse)
    move = jax.jit(lambda state, control: rk4_step(lambda x: model.derivative(params, x, control), state, 1.0 / RATE))
    state = tuple(1.0 if name == "q_w" else 2.0 if name == "z" else 0.0 for name in model.states)
    states = []
    for row in force:
        states.append(state)
        state = move(state, tuple(row))
    return np.array(states, float), model.states


def main(folder: Path) -> None:
    """Simulate and write."""
    folder.mkdir(parents=True, exist_ok=True)
    write_curve(folder)
    pulse = pulses()
    states, names = motion(pulse)
    write_bag(folder / "pool", pulse, dict(zip(names, states.T, strict=True)))


def write_curve(folder: Path) -> None:
    """Write the thrust of each pulse width."""
    tried = np.arange(1100.0, 1901.0)
    rows = [f"{pulse:.0f},{force:.6f}" for pulse, force in zip(tried, thrust_of(tried), strict=True)]
    (folder / "thrust.csv").write_text("pulse_us,thrust_N\n" + "\n".join(rows) + "\n")


def write_bag(path: Path, pulse: np.ndarray, state: dict[str, np.ndarray], seed: int = 8) -> None:
    """Write the messages of all sensors; axes of the messages are forward, left, up and east, north, up (REP 103)."""
    store, rng = get_typestore(Stores.ROS2_HUMBLE), np.random.default_rng(seed)
    types = store.types
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    nothing, nine = vector(0.0, 0.0, 0.0), np.zeros(9)
    kinds = {
        "/thrusters/pwm": ("std_msgs/msg/Int32MultiArray", 10),
        "/imu/data": ("sensor_msgs/msg/Imu", 50),
        "/dvl/twist": ("geometry_msgs/msg/TwistStamped", 10),
        "/depth": ("std_msgs/msg/Float64", 10),
        "/mocap/pose": ("geometry_msgs/msg/PoseStamped", 25),
    }
    turn = np.stack([state[name] for name in ("q_w", "q_x", "q_y", "q_z")])
    turn = turn / np.linalg.norm(turn, axis=0) + 0.5 * NOISE["attitude"] * rng.normal(size=turn.shape)
    w, x, y, z = turn / np.linalg.norm(turn, axis=0)
    half = np.sqrt(0.5)
    turned = half * (w + z), half * (x + y), half * (x - y), half * (w - z)  # its own inverse
    noise = {name: NOISE[name] * rng.normal(size=(3, len(w))) for name in ("gyro", "dvl", "depth")}
    p, q, r = (state[name] + noise["gyro"][i] for i, name in enumerate("pqr"))
    u, v, w_ = (state[name] + noise["dvl"][i] for i, name in enumerate("uvw"))
    depth = state["z"] + noise["depth"][0]
    north, east, down = (state[name] + NOISE["mocap"] * rng.normal(size=len(w)) for name in "xyz")

    def message(topic: str, k: int, stamp: int) -> object:
        if topic == "/thrusters/pwm":
            layout = types["std_msgs/msg/MultiArrayLayout"]([], 0)
            return types[kinds[topic][0]](layout, pulse[k].astype(np.int32))
        if topic == "/depth":
            return types[kinds[topic][0]](float(depth[k]))
        header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), "body")
        attitude = quaternion(*(float(turned[i][k]) for i in (1, 2, 3, 0)))
        if topic == "/mocap/pose":
            point = types["geometry_msgs/msg/Point"](float(east[k]), float(north[k]), -float(down[k]))
            return types[kinds[topic][0]](header, types["geometry_msgs/msg/Pose"](point, attitude))
        if topic == "/imu/data":
            gyro = vector(float(p[k]), -float(q[k]), -float(r[k]))
            return types[kinds[topic][0]](header, attitude, nine, gyro, nine, nothing, nine)
        twist = types["geometry_msgs/msg/Twist"](vector(float(u[k]), -float(v[k]), -float(w_[k])), nothing)
        return types[kinds[topic][0]](header, twist)

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {name: writer.add_connection(name, kind, typestore=store) for name, (kind, _) in kinds.items()}
        for k in range(len(pulse)):
            stamp = 1_700_000_000_000_000_000 + k * 10**9 // RATE
            for name, (kind, rate) in kinds.items():
                if k % (RATE // rate) == 0:
                    writer.write(topics[name], stamp, store.serialize_cdr(message(name, k, stamp), kind))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
