"""The script that sends a trial over MAVLink, as `seatrial.export.trials.write` writes it with another head; it imports nothing of
seatrial's. Sources: MAVLink common message set, MANUAL_CONTROL (69), COMMAND_LONG (76), COMMAND_ACK (77); ArduSub, joystick.cpp,
failsafe.cpp and GCS_MAVLink_Sub.cpp.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from typing import Any, NoReturn

# The trial
CONTROL, UNIT = "n", "rpm"
# Stick that stands for CONTROL, and the way in which it is moved for a positive one: x ahead, y to starboard, z up, r
# to starboard.
AXIS, SIGN = "x", 1
LOWER, UPPER, RATE = None, None, None  # Limits in UNIT, and UNIT a second; None for none
FULL = 1.0
# Time, s, and control, in UNIT; straight lines between.
ROWS = [
    (0.0, 0.0),
    (1.0, 0.0),
]
# Every trial

# Seconds between sticks: ArduSub takes its pilot for lost after FS_PILOT_TIMEOUT, 3 s, and overrides after
# RC_OVERRIDE_TIME, 3 s.
PERIOD = 0.05
BEAT = 1.0  # Seconds between our heartbeats: ArduSub takes its ground station for lost after FS_GCS_TIMEOUT, 5 s
SILENCE = 3.0  # Seconds without a heartbeat of the autopilot after which the trial is given up
ANSWER, TRIES = 1.0, 3  # Seconds in which a command is answered, and how often it is sent
PATIENCE = 30.0  # Seconds in which the vehicle appears, and is armed by its operator
# Seconds of neutral before arming, in which other vehicles show themselves, and after it, in which motors spool up.
SETTLE = 2.0
REST = 1.0  # Seconds of neutral at the end
STALL = 0.5  # Seconds that this computer may lose between two sticks; the trial would no longer be the designed one

ARDUPILOT, SUBMARINE, NO_AUTOPILOT, GROUND_STATION = 3, 12, 8, 6
# MAV_COMP_ID_AUTOPILOT1: cameras and companion computers have heartbeats of their own, in the same system.
COMPONENT = 1
ARMED, FAILSAFE = 128, (5, 6)  # MAV_MODE_FLAG_SAFETY_ARMED; MAV_STATE_CRITICAL and MAV_STATE_EMERGENCY
SET_MODE, SET_ACTUATOR, ARM = 176, 187, 400
COMMANDS = {SET_MODE: "DO_SET_MODE", SET_ACTUATOR: "DO_SET_ACTUATOR", ARM: "COMPONENT_ARM_DISARM"}
ACCEPTED, IN_PROGRESS = 0, 5
RESULTS = ("ACCEPTED", "TEMPORARILY_REJECTED", "DENIED", "UNSUPPORTED", "FAILED", "IN_PROGRESS", "CANCELLED")
FLIGHT_MODES = {"MANUAL": 19, "STABILIZE": 0, "ALT_HOLD": 2}
# Modes of ArduSub in which the stick goes straight to the motors; in the others it asks for a rate or a depth.
STRAIGHT_THROUGH = {
    "x": ("MANUAL", "STABILIZE", "ALT_HOLD"),
    "y": ("MANUAL", "STABILIZE", "ALT_HOLD"),
    "z": ("MANUAL", "STABILIZE"),
    "r": ("MANUAL",),
}
# Parameters by which ArduSub says whose sticks it takes, old and new; those of others it drops without a word.
STICK_OWNERS = ("SYSID_MYGCS", "MAV_GCS_SYSID", "MAV_GCS_SYSID_HI")
SWITCHES = {"RollPitch": "roll and pitch instead of surge and sway", "InputHold": "a constant input added to the trial"}


# What ends the trial from outside: Ctrl-C, a kill, a terminal that closes.
INTERRUPTS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class StoppedError(Exception):
    """The trial cannot begin or go on; the text says why."""


def stopped(why: str) -> NoReturn:
    """End the trial."""
    raise StoppedError(why)


def wanted(t: float) -> float:
    """Return the control at a time, clipped."""
    for i in range(len(ROWS) - 1):
        (t0, x0), (t1, x1) = ROWS[i : i + 2]
        if t < t1:
            return clipped(x0 + (x1 - x0) * (t - t0) / (t1 - t0) if t > t0 else x0)
    return clipped(ROWS[-1][1])


def clipped(value: float) -> float:
    """Return the value within the limits."""
    value = value if LOWER is None else max(LOWER, value)
    return value if UPPER is None else min(UPPER, value)


def slowed(value: float, last: float | None) -> float:
    """Return the value no farther from the last one than the rate allows."""
    if RATE is None or last is None:
        return value
    return min(max(value, last - RATE * PERIOD), last + RATE * PERIOD)


def sticks(share: float) -> tuple[int, int, int, int]:
    """Return x, y, z and r of MANUAL_CONTROL for a share of full control, -1 to 1; ArduSub's z is 500 at rest and more upwards."""
    axes = {"x": 0, "y": 0, "z": 500, "r": 0}
    axes[AXIS] += round(SIGN * share * (500 if AXIS == "z" else 1000))
    return axes["x"], axes["y"], axes["z"], axes["r"]


class Vehicle:
    """One autopilot at the other end of a link: what it says of itself, and what it is told."""

    def __init__(self, link: Any, system: int | None, manual: bool) -> None:
        """Keep the link; `system` is the autopilot's, None for the only one that is heard."""
        self.link, self.system, self.manual = link, system, manual
        self.others: set[int] = set()
        self.heard: float | None = None
        self.autopilot = self.kind = self.flight_mode = self.state = None
        self.armed = self.armed_by_us = False
        self.answers: dict[int, int] = {}
        self.asked: float | None = None
        self.parameters: dict[str, float] = {}
        self.switches: dict[str, float] = {}
        self.said = ""
        self.beat = self.due = 0.0

    def listen(self) -> None:
        """Take in all that has arrived, and send our heartbeat where it is due."""
        now = time.monotonic()
        if now >= self.beat + BEAT:
            self.beat = now
            self.link.mav.heartbeat_send(GROUND_STATION, NO_AUTOPILOT, 0, 0, 4)
        while (message := self.link.recv_match(blocking=False)) is not None:
            if message.get_srcComponent() == COMPONENT:
                self._take(message, now)

    def _take(self, message: Any, now: float) -> None:
        kind, source = message.get_type(), message.get_srcSystem()
        if kind == "HEARTBEAT" and message.autopilot != NO_AUTOPILOT and message.type != GROUND_STATION:
            self.others.add(source)
            self.system = source if self.system is None else self.system
        if source != self.system:
            return
        if kind == "HEARTBEAT" and message.autopilot != NO_AUTOPILOT:
            self.heard, self.armed = now, bool(message.base_mode & ARMED)
            self.autopilot, self.kind = message.autopilot, message.type
            self.flight_mode, self.state = message.custom_mode, message.system_status
        elif kind == "COMMAND_ACK":
            self.answers[message.command] = message.result
            self.asked = None if message.command == SET_ACTUATOR else self.asked
        elif kind == "PARAM_VALUE":
            self.parameters[message.param_id] = message.param_value
        elif kind == "NAMED_VALUE_FLOAT":
            self.switches[message.name] = message.value
        elif kind == "STATUSTEXT":
            self.said = message.text
            print(f"the vehicle says: {message.text}")

    def send(self, share: float) -> None:
        """Send a share of full control, -1 to 1."""
        share = max(-1.0, min(1.0, share))
        if self.manual:
            self.link.mav.manual_control_send(self.system, *sticks(share), 0)
            return
        self.asked = time.monotonic() if self.asked is None else self.asked
        self.link.mav.command_long_send(self.system, COMPONENT, SET_ACTUATOR, 0, share, *[float("nan")] * 5, 0)

    def step(self, share: float = 0.0) -> None:
        """Send once, wait for the next turn, listen and check the link.

        Raises:
            StoppedError: the autopilot is silent, it refuses the actuator, or this computer has stalled.
        """
        self.send(share)
        now = time.monotonic()
        if self.due and now - self.due > STALL:
            stopped(f"this computer paused for {now - self.due:.1f} s")
        self.due = max(self.due + PERIOD, now)
        time.sleep(self.due - now)
        self.listen()
        now = time.monotonic()
        if self.heard is None or now - self.heard > SILENCE:
            stopped(f"heartbeat lost: the autopilot has been silent for {SILENCE:g} s")
        result = self.answers.get(SET_ACTUATOR, ACCEPTED)
        if result not in (ACCEPTED, IN_PROGRESS):
            stopped(f"DO_SET_ACTUATOR was answered with {_result(result)}")
        if self.asked is not None and now - self.asked > ANSWER:
            stopped(f"DO_SET_ACTUATOR was not answered in {ANSWER:g} s")

    def rest(self, seconds: float) -> None:
        """Send neutral for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.step()

    def command(self, number: int, *numbers: float) -> None:
        """Send a command until it is answered, neutral meanwhile.

        Raises:
            StoppedError: no answer, or another one than ACCEPTED.
        """
        self.answers.pop(number, None)
        for attempt in range(TRIES):
            self.link.mav.command_long_send(
                self.system, COMPONENT, number, attempt, *numbers, *[0.0] * (7 - len(numbers))
            )
            end = time.monotonic() + ANSWER
            while time.monotonic() < end:
                self.step()
                result = self.answers.get(number, IN_PROGRESS)
                if result == ACCEPTED:
                    return
                if result != IN_PROGRESS:
                    quoted = f'; the vehicle said "{self.said}"' if self.said else ""
                    stopped(f"{COMMANDS[number]} was answered with {_result(result)}{quoted}")
        stopped(f"{COMMANDS[number]} was not answered in {TRIES} tries of {ANSWER:g} s")


def find(vehicle: Vehicle) -> None:
    """Wait for the autopilot, and make sure that it is the only one or the named one."""
    print("waiting for a heartbeat of the autopilot")
    end = time.monotonic() + PATIENCE
    while vehicle.heard is None:
        if time.monotonic() > end:
            others = f"; heard: {sorted(vehicle.others)}" if vehicle.others else ""
            stopped(f"no heartbeat of the autopilot in {PATIENCE:g} s{others}")
        vehicle.listen()
        time.sleep(PERIOD)
    print(f"system {vehicle.system} is heard")
    if vehicle.manual and (vehicle.autopilot, vehicle.kind) != (ARDUPILOT, SUBMARINE):
        stopped(
            f"the autopilot is no ArduSub (autopilot {vehicle.autopilot}, vehicle type {vehicle.kind}). Others read MANUAL_CONTROL in "
            f"other ways; if the control is a separate actuator, try --mode actuator"
        )


def check_alone(vehicle: Vehicle, named: bool) -> None:
    """Stop where another autopilot is on the link, and none was named."""
    if len(vehicle.others) > 1 and not named:
        stopped(f"several autopilots are heard, systems {sorted(vehicle.others)}: name yours by --vehicle")


def check_ownership(vehicle: Vehicle, own: int) -> None:
    """Stop where ArduSub would drop our sticks."""
    for _ in range(TRIES):
        for name in STICK_OWNERS:
            if name not in vehicle.parameters:
                vehicle.link.mav.param_request_read_send(vehicle.system, COMPONENT, name.encode(), -1)
        end = time.monotonic() + ANSWER
        while time.monotonic() < end and not {"SYSID_MYGCS", "MAV_GCS_SYSID"} & set(vehicle.parameters):
            vehicle.step()
    vehicle.rest(4 * PERIOD)
    known = [int(vehicle.parameters[name]) for name in STICK_OWNERS if name in vehicle.parameters]
    if not known:
        stopped("the vehicle does not report whose sticks it accepts (parameter SYSID_MYGCS or MAV_GCS_SYSID)")
    if not known[0] <= own <= max(known):
        stopped(
            f"the vehicle takes sticks of system {known[0]} alone, and we are system {own}: give --system-id {known[0]}"
        )


def check_switches(vehicle: Vehicle, gain: float | None) -> None:
    """Stop where sticks mean something else than they should, or than they did at the start."""
    for name, what in SWITCHES.items():
        if vehicle.switches.get(name):
            stopped(f"{name} is on: sticks would mean {what}")
    now = vehicle.switches.get("PilotGain")
    if gain is not None and now != gain:
        stopped(f"the pilot's gain was changed from {gain:g} to {now:g}: full stick has another value now")


def prepare(vehicle: Vehicle, flight_mode: str, arm: bool) -> None:
    """Bring the vehicle to neutral, its mode and armed; or wait until its operator has."""
    number = FLIGHT_MODES[flight_mode]
    if vehicle.manual and vehicle.flight_mode != number:
        if not arm:
            stopped(f"the vehicle is in mode {_mode(vehicle.flight_mode)}, not {flight_mode}: set it, or give --arm")
        vehicle.command(SET_MODE, 1, number)
        _await(vehicle, lambda: vehicle.flight_mode == number, SILENCE, f"its mode did not become {flight_mode}")
    if not vehicle.armed and arm:
        vehicle.armed_by_us = True
        vehicle.command(ARM, 1)
        _await(vehicle, lambda: vehicle.armed, SILENCE, "arming was accepted, but its heartbeat does not show it")
    elif not vehicle.armed:
        print("waiting for the vehicle to be armed by its operator (--arm arms it)")
        _await(vehicle, lambda: vehicle.armed, PATIENCE, "the vehicle was not armed")
    vehicle.rest(SETTLE)


def perform(vehicle: Vehicle, flight_mode: str, full: float) -> None:
    """Send the trial, watching the vehicle's state."""
    start, last = time.monotonic(), None
    gain = vehicle.switches.get("PilotGain")
    print("the trial begins" + (f"; the pilot's gain is {gain:g}" if gain is not None else ""))
    while (t := time.monotonic() - start) <= ROWS[-1][0]:
        if not vehicle.armed:
            stopped(f"the vehicle was disarmed, {t:.1f} s into the trial")
        if vehicle.state in FAILSAFE:
            stopped(f"the vehicle reports a failsafe, {t:.1f} s into the trial")
        if vehicle.manual and vehicle.flight_mode != FLIGHT_MODES[flight_mode]:
            stopped(f"the vehicle went into mode {_mode(vehicle.flight_mode)}, {t:.1f} s into the trial")
        check_switches(vehicle, gain)
        last = slowed(wanted(t), last)
        vehicle.step(last / full)


def finish(vehicle: Vehicle) -> str:
    """Send neutral for a while whatever the vehicle says, and disarm what we armed; returns what went wrong, empty for nothing."""
    try:
        for _ in range(round(REST / PERIOD)):
            _neutral(vehicle)
        if not vehicle.armed_by_us or _disarmed(vehicle):
            return ""
    except OSError as error:
        return f"neutral could not be sent ({error})"
    return "neutral was sent, but the vehicle did not confirm that it is disarmed"


def run(link: Any, options: argparse.Namespace) -> int:
    """Send the trial; returns the exit status."""
    vehicle = Vehicle(link, options.vehicle, options.mode == "manual")
    reason = "finished"
    try:
        find(vehicle)
        vehicle.rest(SETTLE)
        check_alone(vehicle, options.vehicle is not None)
        if vehicle.manual:
            check_ownership(vehicle, options.system_id)
            check_switches(vehicle, None)
        prepare(vehicle, options.flight_mode, options.arm)
        perform(vehicle, options.flight_mode, options.full)
    except KeyboardInterrupt:
        reason = "aborted"
    except (StoppedError, OSError) as error:
        reason = f"stopped: {error}"
    except BaseException as error:
        reason = f"stopped by an error in this script, {type(error).__name__}: {error}"
        raise
    finally:
        for number in INTERRUPTS:
            signal.signal(number, signal.SIG_IGN)
        wrong = finish(vehicle) if vehicle.heard is not None else "nothing was sent"
        done = "neutral was sent" + (", and the vehicle disarmed" if vehicle.armed_by_us else "")
        print(f"{reason}; {wrong or done}")
    return 0 if reason == "finished" and not wrong else 1


def dry_run(full: float, mode: str) -> None:
    """Print what would be sent, a line for each change."""
    what = f"stick {AXIS}" if mode == "manual" else "actuator 1"
    print(f"dry run of {CONTROL} by {what}, limits {LOWER} to {UPPER} {UNIT}, rate {RATE}; nothing is sent")
    last = shown = None
    for i in range(int(ROWS[-1][0] / PERIOD) + 1):
        last = slowed(wanted(i * PERIOD), last)
        share = max(-1.0, min(1.0, last / full))
        if shown is None or abs(share - shown) > 1e-9:
            sent = f"stick {AXIS} {sticks(share)['xyzr'.index(AXIS)]}" if mode == "manual" else f"{share:+.4f}"
            print(f"{i * PERIOD:9.2f} s  {CONTROL} = {last:.6g} {UNIT}  {share:+.4f} of full  {sent}")
            shown = share
    print(f"{ROWS[-1][0]:9.2f} s  neutral")


def main(arguments: list[str] | None = None) -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=f"Send a trial of {CONTROL} over MAVLink; without --send it prints it."
    )
    parser.add_argument("--send", metavar="CONNECTION", help="send over this connection, such as udpin:0.0.0.0:14550")
    parser.add_argument("--arm", action="store_true", help="set the mode and arm before the trial, disarm after it")
    parser.add_argument(
        "--mode", choices=("manual", "actuator"), default="manual", help="MANUAL_CONTROL, or DO_SET_ACTUATOR 1"
    )
    parser.add_argument(
        "--full", type=float, default=FULL, help=f"{CONTROL} in {UNIT} at full stick; {FULL:g} if not given"
    )
    parser.add_argument(
        "--flight-mode", choices=STRAIGHT_THROUGH[AXIS], default="MANUAL", help="ArduSub's mode during the trial"
    )
    parser.add_argument(
        "--vehicle", type=int, metavar="SYSTEM", help="system of the vehicle; the only one if not given"
    )
    parser.add_argument(
        "--system-id",
        type=int,
        metavar="SYSTEM",
        default=255,
        help="number of this system, whose sticks the vehicle accepts",
    )
    options = parser.parse_args(arguments)
    if not 0 < options.full < float("inf"):
        parser.error("--full must be a number above 0")
    most = max(abs(clipped(value)) for _, value in ROWS)
    if most > options.full * (1 + 1e-9):
        parser.error(f"the trial goes to {most:g} {UNIT}, beyond --full {options.full:g}: the stick cannot ask for it")
    if options.send is None:
        dry_run(options.full, options.mode)
        return 0
    from pymavlink import mavutil

    try:
        link = mavutil.mavlink_connection(options.send, source_system=options.system_id)
    except (OSError, ImportError, ValueError) as error:
        parser.error(f"--send {options.send}: {error}; a serial port needs pyserial, others read udpin:0.0.0.0:14550")
    return run(link, options)


def interrupt(*_: object) -> None:
    """End the trial as Ctrl-C does."""
    raise KeyboardInterrupt


def _neutral(vehicle: Vehicle) -> None:
    vehicle.send(0.0)
    time.sleep(PERIOD)
    vehicle.listen()


def _disarmed(vehicle: Vehicle) -> bool:
    """Disarm, whatever else the vehicle refuses; whether a heartbeat confirms it."""
    for attempt in range(TRIES):
        sent = time.monotonic()
        vehicle.link.mav.command_long_send(vehicle.system, COMPONENT, ARM, attempt, 0, *[0.0] * 6)
        while time.monotonic() < sent + ANSWER:
            _neutral(vehicle)
            if not vehicle.armed and vehicle.heard is not None and vehicle.heard > sent:
                return True
    return False


def _await(vehicle: Vehicle, happened: Any, seconds: float, otherwise: str) -> None:
    end = time.monotonic() + seconds
    while not happened():
        if time.monotonic() > end:
            quoted = f'; the vehicle said "{vehicle.said}"' if vehicle.said else ""
            stopped(f"{otherwise} in {seconds:g} s{quoted}")
        vehicle.step()


def _result(number: int) -> str:
    return RESULTS[number] if number < len(RESULTS) else f"result {number}"


def _mode(number: int | None) -> str:
    return next((name for name, known in FLIGHT_MODES.items() if known == number), f"number {number}")


if __name__ == "__main__":
    for each in INTERRUPTS:
        signal.signal(each, interrupt)
    sys.exit(main())
