"""The script that sends a trial, against an ArduSub over UDP: it moves an armed vehicle the way its model goes, and else says why not."""

import importlib.util
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from seatrial.campaign.config.load import load_campaign
from seatrial.campaign.design.schedule import write_schedule
from seatrial.campaign.store.stored_result import Store
from seatrial.core.errors import InputError
from seatrial.export.trials.trial import DEFAULT_SPEED, EitherWayError, Stick, Trial, read_trial, stick_of
from seatrial.export.trials.write import write_plain, write_trial
from seatrial.vehicles.axis_equation import axes_vehicle, axis_equation
from seatrial.vehicles.catalogue import load_vehicle, vehicle_names
from tests.campaign.yaw_campaign import write_yaw

QUICK = {
    "PERIOD": 0.01,
    "BEAT": 0.1,
    "SILENCE": 1.0,
    "ANSWER": 0.4,
    "PATIENCE": 0.8,
    "SETTLE": 0.15,
    "REST": 0.2,
    "STALL": 5.0,
}
AXES = ("u", "v", "w", "r")
"""Motions of the fake's motors, in its order."""


def trial_of(control, axis="x", sign=1, rows=((0.0, 0.0), (0.0, 1.0), (0.6, 1.0))):
    time_s, value = np.array(rows).T
    limits = (-2.0, 2.0, None)
    stick = Stick(axis, sign)
    return Trial("test", "design", "a step", control, time_s, value, *limits, (), "", lambda: stick)


@pytest.fixture
def load(tmp_path):
    """Loads the script of a trial as a module, its times shortened."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}

    def loaded(trial, **times):
        (path,) = write_trial(trial, tmp_path / "out", ("mavlink",))
        spec = importlib.util.spec_from_file_location("trial", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        for name, value in {**QUICK, **times}.items():
            assert hasattr(module, name)
            setattr(module, name, value)
        return module

    yield loaded
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture
def sail(load, capsys):
    """Sends a trial to a fake; returns the exit status, what was printed, and the fake."""
    fakes = pytest.importorskip("tests.export.fake_ardusub", reason="pymavlink")
    made = []

    def sent(*options, trial=None, times=None, **habits):
        script, port = load(trial or trial_of("n"), **(times or {})), free_port()
        fake = fakes.FakeSub(port, fakes.Habits(**habits))
        made.append(fake)
        fake.start()
        status = script.main(["--send", f"udpin:127.0.0.1:{port}", *options])
        fake.close()
        return status, capsys.readouterr().out, fake

    yield sent
    for fake in made:
        fake.going = False


def free_port():
    """Finds a free UDP port below those the system gives to senders, one of which would take it between here and the script."""
    for port in range(20_000 + os.getpid() % 10_000, 32_000):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise AssertionError("no free UDP port")


NEUTRAL = (0, 0, 500, 0)


def test_a_trial_is_armed_sent_and_ends_neutral_and_disarmed(sail):
    status, output, fake = sail("--arm", mode=2)
    assert status == 0, output
    assert "finished; neutral was sent, and the vehicle disarmed" in output
    assert [(number, value) for number, value in fake.commands] == [(176, 1.0), (400, 1.0), (400, 0.0)]
    assert fake.sticks[0] == fake.sticks[-1] == NEUTRAL
    assert (500, 0, 500, 0) in fake.sticks, "half of the largest limit"
    assert not fake.armed
    assert fake.beats_heard >= 5
    pushed = np.array(fake.moves)
    assert pushed[:, 1].max() == pytest.approx(0.25), "half a stick at half a gain"
    assert not pushed[:, 2:].any()
    gaps = np.diff(pushed[:, 0])
    assert np.median(gaps) < 0.03


def test_an_operator_may_arm_it(sail):
    status, output, fake = sail(arms_itself_after=0.6)
    assert status == 0, output
    assert fake.commands == []
    assert fake.armed, "it is the operator's to disarm"
    assert fake.sticks[-1] == NEUTRAL


STOPPED = {
    "never armed by its operator": ({}, (), "the vehicle was not armed in 0.8 s"),
    "armed only in words": ({"arms": False}, ("--arm",), "arming was accepted, but its heartbeat does not show it"),
    "unsupported": ({"answer": 3}, ("--arm",), "COMPONENT_ARM_DISARM was answered with UNSUPPORTED"),
    "denied": ({"answer": 2, "mode": 2}, ("--arm",), "DO_SET_MODE was answered with DENIED"),
    "no answer": ({"answer": None}, ("--arm",), "COMPONENT_ARM_DISARM was not answered in 3 tries of 0.4 s"),
    "another mode": ({"armed": True, "mode": 2}, (), "in mode ALT_HOLD, not MANUAL"),
    "silent, with a companion that is not": ({"silent_after": 0.2}, ("--arm",), "heartbeat lost"),
    "disarmed midway": ({"disarms_after": 0.3}, ("--arm",), "the vehicle was disarmed, 0."),
    "mode changed midway": ({"changes_mode_after": 0.3}, ("--arm",), "the vehicle went into mode ALT_HOLD, 0."),
    "failsafe midway": ({"fails_after": 0.3}, ("--arm",), "the vehicle reports a failsafe, 0."),
    "sticks of another": (
        {"owner": 254},
        ("--arm",),
        "takes sticks of system 254 alone, and we are system 255: give --system-id 254",
    ),
    "sticks that tilt": (
        {"switches": {"RollPitch": 1.0}},
        ("--arm",),
        "RollPitch is on: sticks would mean roll and pitch",
    ),
    "two vehicles": (
        {"second": True},
        ("--arm",),
        "several autopilots are heard, systems [1, 2]: name yours by --vehicle",
    ),
    "another autopilot": (
        {"kind": (12, 12)},
        ("--arm",),
        "the autopilot is no ArduSub (autopilot 12, vehicle type 12)",
    ),
    "a copter": ({"kind": (3, 2)}, ("--arm",), "the autopilot is no ArduSub"),
    "an actuator that is not there": (
        {"answer": 3, "armed": True},
        ("--mode", "actuator"),
        "DO_SET_ACTUATOR was answered with UNSUPPORTED",
    ),
    "an actuator without an answer": (
        {"answer": None, "armed": True},
        ("--mode", "actuator"),
        "DO_SET_ACTUATOR was not answered in 0.4 s",
    ),
}


@pytest.mark.parametrize("case", STOPPED)
def test_whatever_is_wrong_is_said_and_ends_neutral(sail, case):
    habits, options, sentence = STOPPED[case]
    trial = trial_of("n", rows=((0.0, 0.0), (0.0, 1.0), (30.0, 1.0)))
    status, output, fake = sail(*options, trial=trial, **habits)
    assert status == 1
    assert sentence in output
    assert output.splitlines()[-1].startswith("stopped: ")
    neutral = [stick for stick in fake.sticks if stick in (NEUTRAL, (0.0,))]
    if "midway" in case or "silent" in case:
        assert (500, 0, 500, 0) in fake.sticks
        assert fake.silent or fake.sticks[-1] == NEUTRAL
    else:
        assert fake.sticks == neutral, "it never moved"
    assert fake.silent or not (fake.armed and "--arm" in options)


def test_a_named_vehicle_among_two_is_enough(sail):
    status, output, _ = sail("--arm", "--vehicle", "1", second=True)
    assert status == 0, output


def test_sticks_of_its_own_number_are_sent(sail):
    status, output, _ = sail("--arm", "--system-id", "254", owner=254)
    assert status == 0, output


def test_an_actuator_is_answered_every_time(sail):
    status, output, fake = sail("--mode", "actuator", "--arm", kind=(12, 12))
    assert status == 0, output
    assert max(fake.sticks) == (0.5,)
    assert fake.sticks[-1] == (0.0,)


def test_no_vehicle_sends_nothing(load, capsys):
    pytest.importorskip("pymavlink")
    assert load(trial_of("n")).main(["--send", f"udpin:127.0.0.1:{free_port()}"]) == 1
    assert "stopped: no heartbeat of the autopilot in 0.8 s; nothing was sent" in capsys.readouterr().out


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError("a defect"), OSError("no such device")])
def test_neutral_comes_first_whatever_happens(load, capsys, error):
    fakes = pytest.importorskip("tests.export.fake_ardusub", reason="pymavlink")
    script, port = load(trial_of("n", rows=((0.0, 1.0), (30.0, 1.0)))), free_port()
    fake = fakes.FakeSub(port, fakes.Habits())
    fake.start()
    listen = script.Vehicle.listen

    def breaks(vehicle):
        listen(vehicle)
        if fake.moving_since is not None and not broken:
            broken.append(1)
            raise error

    broken, script.Vehicle.listen = [], breaks
    arguments = ["--arm", "--send", f"udpin:127.0.0.1:{port}"]
    if isinstance(error, ValueError):
        with pytest.raises(ValueError, match="a defect"):
            script.main(arguments)
    else:
        assert script.main(arguments) == 1
    fake.close()
    assert fake.sticks[-1] == NEUTRAL
    assert not fake.armed
    assert "neutral was sent, and the vehicle disarmed" in capsys.readouterr().out


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_at_neutral(tmp_path, number):
    fakes = pytest.importorskip("tests.export.fake_ardusub", reason="pymavlink")
    (path,) = write_trial(trial_of("n", rows=((0.0, 1.0), (60.0, 1.0))), tmp_path / "out", ("mavlink",))
    path.write_text(path.read_text().replace("SETTLE = 2.0", "SETTLE = 0.2").replace("REST = 1.0", "REST = 0.3"))
    port = free_port()
    fake = fakes.FakeSub(port, fakes.Habits(armed=True))
    fake.start()
    command = [sys.executable, "-u", str(path), "--send", f"udpin:127.0.0.1:{port}"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    threading.Thread(target=partial(_interrupt, fake, process, number), daemon=True).start()
    output, _ = process.communicate(timeout=60)
    fake.close()
    assert process.returncode == 1, output
    assert output.splitlines()[-1] == "aborted; neutral was sent"
    assert fake.sticks[-1] == NEUTRAL
    assert (500, 0, 500, 0) in fake.sticks


def _interrupt(fake, process, number):
    while fake.moving_since is None and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(number)


def test_the_script_prints_and_sends_nothing_by_default(load, capsys):
    rows = [(0.0, 0.5), (0.3, 0.5), (0.3, 3.0), (0.8, 3.0)]
    assert load(trial_of("tau_Z", "z", -1, rows), PERIOD=0.05).main([]) == 0
    output = capsys.readouterr().out
    assert "nothing is sent" in output
    assert "tau_Z = 2 N  +0.6667 of full  stick z 167" in output, "clipped at the upper limit, and down"
    assert output.splitlines()[-1].endswith("neutral")


@pytest.mark.parametrize(
    ("full", "complaint"), [("0.5", "goes to 1 rpm, beyond --full 0.5"), ("nan", "above 0"), ("inf", "above 0")]
)
def test_a_trial_beyond_full_stick_is_refused(load, capsys, full, complaint):
    trial = trial_of("n", rows=((0.0, 0.0), (1.0, np.pi / 30)))._replace(lower=None, upper=None)
    with pytest.raises(SystemExit) as stopped:
        load(trial).main(["--full", full])
    assert stopped.value.code == 2
    assert complaint in capsys.readouterr().err


def test_the_script_needs_nothing_but_python(tmp_path):
    (path,) = write_trial(trial_of("n"), tmp_path / "out", ("mavlink",))
    done = subprocess.run(
        [sys.executable, "-I", "-S", str(path)], capture_output=True, text=True, timeout=60, env={"PATH": os.devnull}
    )
    assert done.returncode == 0, done.stderr
    assert "dry run" in done.stdout


def accepted():
    """Every vehicle of the catalogue with every control of it that has a stick."""
    for name in vehicle_names():
        for control in load_vehicle(name).controls:
            yield pytest.param(name, control, id=f"{name}-{control}")


def test_a_connection_that_is_none_is_said_in_a_sentence(load, capsys):
    script = load(trial_of("n"))
    with pytest.raises(SystemExit) as ended:
        script.main(["--send", "nonsense"])
    assert ended.value.code == 2
    assert "--send nonsense: " in capsys.readouterr().err


@pytest.mark.parametrize(("name", "control"), list(accepted()))
def test_the_stick_moves_the_vehicle_as_its_model_goes(load, name, control):
    """Half a second of the model under a positive and a negative command; the fake's motors are to push the same way."""
    fakes = pytest.importorskip("tests.export.fake_ardusub", reason="pymavlink")
    published = load_vehicle(name)
    model = published.build(attitude="euler")
    known = {"u": DEFAULT_SPEED, **published.hull.trim}
    size = {"n": 150.0}.get(control, 0.1)
    value = np.array([-size, size])
    if control.startswith("f_"):
        with pytest.raises(InputError, match=f"{control}, one thruster of several"):
            stick_of(model, published.coefficients, control, value, known)
        return
    stick = stick_of(model, published.coefficients, control, value, known)
    ends = [simulated(model, published.coefficients, {**known, control: end}) for end in value]
    moved = dict(zip(model.states, ends[1] - ends[0], strict=True))
    script = load(trial_of(control, *stick, rows=((0.0, 0.0), (1.0, 1.0))))
    fake = fakes.FakeSub(free_port(), fakes.Habits(armed=True))
    x, y, z, r = script.sticks(1.0)
    fake._steer(type("Sticks", (), {"x": x, "y": y, "z": z, "r": r}))
    pushes = dict(zip(AXES, fake.moves[-1][1:], strict=True))
    if control == "n":
        assert pushes["u"] * moved["u"] > 0
    elif control == "delta_r":
        assert pushes["r"] * moved["r"] > 0
    else:
        assert control == "delta_s"
        assert pushes["w"] * -moved["q"] > 0, "nose up is up"
    assert sum(push != 0 for push in pushes.values()) == 1


def simulated(model, params, known):
    """State after half a second, by Euler's method in steps of 5 ms."""
    state = np.array([known.get(name, 0.0) for name in model.states])
    control = tuple(known.get(name, 0.0) for name in model.controls)
    values = {term.text: params[term.text] for term in model.coefficients}
    for _ in range(100):
        state = state + 0.005 * np.array([float(x) for x in model.derivative(values, tuple(state), control)])
    return state


@pytest.mark.parametrize(("name", "sign"), [("remus100_fossen", 1), ("remus100_hall_anstee", -1), ("mariner", -1)])
def test_the_same_rudder_turns_vehicles_to_different_sides(name, sign):
    """As their sources say: Fossen's positive rudder turns to starboard, that of the others to port."""
    vehicle = load_vehicle(name)
    known, value = {"u": DEFAULT_SPEED, **vehicle.hull.trim}, np.array([-0.1, 0.1])
    stick = stick_of(vehicle.build(attitude="euler"), vehicle.coefficients, "delta_r", value, known)
    assert stick == Stick("r", sign)


@pytest.mark.parametrize(
    ("control", "term", "stick", "push"),
    [
        ("tau_X", "X_tau_X", Stick("x", 1), (1, 0, 0, 0)),
        ("tau_Y", "Y_tau_Y", Stick("y", 1), (0, 1, 0, 0)),
        ("tau_Z", "Z_tau_Z", Stick("z", -1), (0, 0, 1, 0)),
        ("tau_N", "N_tau_N", Stick("r", 1), (0, 0, 0, 1)),
    ],
)
def test_a_commanded_force_pushes_along_its_own_axis(load, control, term, stick, push):
    fakes = pytest.importorskip("tests.export.fake_ardusub", reason="pymavlink")
    model = axes_vehicle("test", [axis_equation(term[0], (term,), inertia=5.0)])
    value = np.array([0.0, 1.0])
    assert stick_of(model, {term: 1.0}, control, value, {}) == stick
    assert stick_of(model, {term: -1.0}, control, value, {}).sign == -stick.sign
    fake = fakes.FakeSub(free_port(), fakes.Habits(armed=True))
    x, y, z, r = load(trial_of(control, *stick)).sticks(1.0)
    fake._steer(type("Sticks", (), {"x": x, "y": y, "z": z, "r": r}))
    np.testing.assert_allclose(fake.moves[-1][1:], 0.5 * np.array(push), atol=1e-12)


@pytest.mark.parametrize("gain", [1.0, -1.0])
def test_what_pushes_without_the_control_does_not_count(gain):
    """A constant force of three times what the control does, either way."""
    model = axes_vehicle("test", [axis_equation("X", ("X_tau_X", "X_0"), inertia=5.0)])
    signs = [
        stick_of(model, {"X_tau_X": gain, "X_0": force}, "tau_X", np.array([0.0, 1.0]), {}).sign
        for force in (0.0, 3.0, -3.0)
    ]
    assert signs == [gain] * 3


@pytest.mark.parametrize("control", ["tau_K", "tau_M", "f_5", "n_5"])
def test_a_control_without_a_stick_is_refused(control):
    axis = control[-1] if control.startswith("tau") else "X"
    model = axes_vehicle("test", [axis_equation(axis, (f"{axis}_{control}",), inertia=5.0)]) if axis != "X" else None
    with pytest.raises(InputError, match="with a stick: n, tau_X, tau_Y, tau_Z, tau_N, delta_r, delta_s"):
        stick_of(model, {f"{axis}_{control}": 1.0}, control, np.array([0.0, 1.0]), {})


def test_a_control_without_effect_and_one_of_unknown_sign_are_refused():
    model = axes_vehicle("test", [axis_equation("N", ("N_uudelta_r",), inertia=5.0)])
    value = np.array([-0.1, 0.1])
    with pytest.raises(InputError, match="no effect on r at trim"):
        stick_of(model, {"N_uudelta_r": 1.0}, "delta_r", value, {"u": 0.0})
    with pytest.raises(EitherWayError):
        stick_of(model, {"N_uudelta_r": np.array([1.0, -1.0])}, "delta_r", value, {"u": 1.0})


@pytest.fixture
def yaw(tmp_path):
    """A campaign whose prior allows rudders of both signs, and its designed trial."""
    folder = write_yaw(tmp_path / "c")
    campaign = load_campaign(folder)
    store = Store(folder)
    write_schedule(store.schedule(store.design), campaign.family.manoeuvre(0.1, 8.0), 0.1)
    return folder


def test_a_campaign_whose_prior_allows_both_ways_has_no_script_and_the_rest(yaw, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "trial.py").write_text("of an earlier trial")
    paths, without = write_plain(read_trial(yaw), tmp_path / "out")
    assert [path.name for path in paths] == ["trial.csv", "trial.json"]
    assert "either way, by its prior of Y_udelta_r, N_udelta_r" in without
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["trial.csv", "trial.json"]


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_estimate_decides_where_the_prior_does_not(yaw, monkeypatch, sign):
    def estimate(campaign):
        draws = np.random.default_rng(1).normal(1.0, 0.1, (50, len(campaign.full.terms)))
        return SimpleNamespace(structure=campaign.full, draws=lambda names: sign * draws[:, : len(names)])

    monkeypatch.setattr("seatrial.export.trials.trial.stored_estimate", estimate)
    assert read_trial(yaw).find_stick() == Stick("r", sign)


def test_a_prior_of_one_sign_is_enough(yaw):
    path = yaw / "campaign.toml"
    old = '[prior.N_udelta_r]\ndistribution = "normal"\nmean = 0.0\nsd = 1.0'
    assert old in path.read_text()
    path.write_text(
        path.read_text().replace(old, '[prior.N_udelta_r]\ndistribution = "half-normal"\nupper = 0.0\nscale = 1.0')
    )
    assert read_trial(yaw).find_stick() == Stick("r", -1)
