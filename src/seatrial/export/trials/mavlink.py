"""A trial as a Python script that sends it over MAVLink: by MANUAL_CONTROL to ArduSub, or by MAV_CMD_DO_SET_ACTUATOR.

It prints what it would send until it is told `--send`. Limits are in it and clip every value; the end, Ctrl-C and three seconds without
a heartbeat all lead to neutral. Sources: MAVLink common message set, MANUAL_CONTROL (69), MAV_CMD_DO_SET_ACTUATOR (187).
"""

from seatrial.export.trials.trial import Trial

AXES = {"n": "x", "tau_X": "x", "tau_Y": "y", "tau_Z": "z", "delta_s": "z", "tau_N": "r", "delta_r": "r"}
"""Axis of MANUAL_CONTROL that stands for each control: x ahead, y to starboard, z up or throttle, r yaw."""


def trial_script(trial: Trial) -> str:
    """The script."""
    factor, unit = trial.shown
    bounds = [None if bound is None else _shown(bound * factor) for bound in (trial.lower, trial.upper)]
    full = max(abs(float(trial.value.max())), abs(float(trial.value.min()))) * factor
    full = max([full] + [abs(bound) for bound in bounds if bound is not None])
    parts = {
        "DOC": "\n".join(_safe(line) for line in trial.lines),
        "CONTROL": repr(trial.control),
        "UNIT": repr(unit),
        "AXIS": repr(AXES.get(trial.control, "x")),
        "LOWER": repr(bounds[0]),
        "UPPER": repr(bounds[1]),
        "RATE": repr(None if trial.rate is None else _shown(trial.rate * factor)),
        "FULL": repr(_shown(full)),
        "ROWS": "".join(
            f"    ({float(t)!r}, {_shown(x * factor)!r}),\n" for t, x in zip(trial.time, trial.value, strict=True)
        ),
    }
    text = _TEMPLATE
    for key, value in parts.items():
        text = text.replace(f"@{key}@", value)
    return text


def _shown(value: float) -> float:
    """A number without the rounding of its unit."""
    return float(f"{value:.12g}")


def _safe(line: str) -> str:
    """Text that can stand in a docstring."""
    return "".join(c if c.isprintable() else " " for c in line).replace("\\", "/").replace('"', "'")


_TEMPLATE = '''#!/usr/bin/env python3
"""
@DOC@

Dry run, which is the default:   python trial.py
Send:                            python trial.py --send udpin:0.0.0.0:14550

Needs pymavlink to send. The vehicle must be armed and in a manual mode; this script does not arm it. MANUAL_CONTROL has no unit:
its 1000 stands for --full, here @FULL@ in the unit of the table. Measure what full stick makes of the control, and give that.
"""

import argparse
import signal
import sys
import time

CONTROL, UNIT, AXIS = @CONTROL@, @UNIT@, @AXIS@
LOWER, UPPER, RATE = @LOWER@, @UPPER@, @RATE@
"""Limits in UNIT, and UNIT a second; None for none."""
FULL = @FULL@
PERIOD = 0.05
HEARTBEAT = 3.0
"""Seconds without a heartbeat after which the trial is given up."""
ROWS = [
@ROWS@]
"""Time, s, and control, in UNIT; straight lines between."""


def wanted(t):
    """The control at a time, clipped."""
    for (t0, x0), (t1, x1) in zip(ROWS, ROWS[1:]):
        if t < t1:
            return clipped(x0 + (x1 - x0) * (t - t0) / (t1 - t0) if t > t0 else x0)
    return clipped(ROWS[-1][1])


def clipped(value):
    """The value within the limits."""
    value = value if LOWER is None else max(LOWER, value)
    return value if UPPER is None else min(UPPER, value)


def slowed(value, last):
    """The value no farther from the last one than the rate allows."""
    if RATE is None or last is None:
        return value
    return min(max(value, last - RATE * PERIOD), last + RATE * PERIOD)


def send(link, mode, share):
    """Send a share of full control, -1 to 1; None is neutral."""
    share = 0.0 if share is None else max(-1.0, min(1.0, share))
    target = link.target_system or 1
    if mode == "actuator":
        values = [share] + [float("nan")] * 5 + [0]
        link.mav.command_long_send(target, link.target_component or 1, 187, 0, *values)
        return
    axes = {"x": 0, "y": 0, "z": 500, "r": 0}
    axes[AXIS] = round(500 + 500 * share) if AXIS == "z" else round(1000 * share)
    link.mav.manual_control_send(target, axes["x"], axes["y"], axes["z"], axes["r"], 0)


def neutral(link, mode):
    """Send neutral for a second."""
    for _ in range(20):
        send(link, mode, None)
        time.sleep(PERIOD)


def stop(*_):
    """Make SIGTERM end the trial as Ctrl-C does."""
    raise KeyboardInterrupt


def run(link, mode, full):
    """Send the trial; returns the reason for which it ended."""
    signal.signal(signal.SIGTERM, stop)
    reason, last = "finished", None
    try:
        print("waiting for a heartbeat")
        if link.wait_heartbeat(timeout=30) is None:
            return "no heartbeat"
        start = heard = time.monotonic()
        while True:
            now = time.monotonic()
            beat = link.recv_match(type="HEARTBEAT", blocking=False)
            if beat is not None and beat.get_srcSystem() == link.target_system:
                heard = now
            if now - heard > HEARTBEAT:
                reason = "heartbeat lost"
                break
            if now - start > ROWS[-1][0]:
                break
            last = slowed(wanted(now - start), last)
            send(link, mode, last / full)
            time.sleep(PERIOD)
    except KeyboardInterrupt:
        reason = "aborted"
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        neutral(link, mode)
    return reason


def dry_run(full, mode):
    """Print what would be sent, a line for each change."""
    print(f"dry run of {CONTROL} by {mode}, limits {LOWER} to {UPPER} {UNIT}, rate {RATE}; nothing is sent")
    last = shown = None
    for i in range(int(ROWS[-1][0] / PERIOD) + 1):
        last = slowed(wanted(i * PERIOD), last)
        share = max(-1.0, min(1.0, last / full))
        if shown is None or abs(share - shown) > 1e-9:
            print(f"{i * PERIOD:9.2f} s  {CONTROL} = {last:.6g} {UNIT}  {share:+.4f} of full")
            shown = share
    print(f"{ROWS[-1][0]:9.2f} s  neutral")


def main():
    """Read the command line."""
    parser = argparse.ArgumentParser(description=f"Send a trial of {CONTROL} over MAVLink; without --send it prints it.")
    parser.add_argument("--send", metavar="CONNECTION", help="send over this connection, such as udpin:0.0.0.0:14550")
    parser.add_argument("--mode", choices=("manual", "actuator"), default="manual", help="MANUAL_CONTROL or DO_SET_ACTUATOR")
    parser.add_argument("--full", type=float, default=FULL, help=f"{CONTROL} in {UNIT} at full stick")
    options = parser.parse_args()
    if not options.full > 0:
        parser.error("--full must be above 0")
    most = max(abs(clipped(value)) for _, value in ROWS)
    if most > options.full * (1 + 1e-9):
        parser.error(f"the trial goes to {most:g} {UNIT}, beyond --full {options.full:g}: the stick cannot ask for it")
    if options.send is None:
        dry_run(options.full, options.mode)
        return 0
    from pymavlink import mavutil

    reason = run(mavutil.mavlink_connection(options.send), options.mode, options.full)
    print(f"{reason}; neutral was sent")
    return 0 if reason == "finished" else 1


if __name__ == "__main__":
    sys.exit(main())
'''
