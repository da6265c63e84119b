"""A trial as a Python script that sends it over MAVLink: by MANUAL_CONTROL to ArduSub, or by MAV_CMD_DO_SET_ACTUATOR.

It prints what it would send until it is told `--send`. Limits are in it and clip every value; it moves only an armed vehicle in the
right mode, and the end, Ctrl-C, a refusal and a silent autopilot lead to neutral. Its code is `mavlink_script`; the head is the trial's.
"""

from importlib.resources import files

from seatrial.export.trials.trial import Trial

_BEGIN, _END = "# The trial\n", "# Every trial\n"
_DOC = '''#!/usr/bin/env python3
"""
@DOC@

Dry run, which is the default:   python trial.py
Send:                            python trial.py --send udpin:0.0.0.0:14550
Set the mode, arm, send, disarm: python trial.py --send udpin:0.0.0.0:14550 --arm

Needs pymavlink to send. Without --arm the operator arms the vehicle, in MANUAL. MANUAL_CONTROL has no unit: its 1000 stands for --full,
here @FULL@ in the unit of the table. Measure what full stick makes of the control at the pilot's gain of the trial, and give that. Let no
joystick of a ground station send at the same time.
"""

'''


def trial_script(trial: Trial) -> str:
    """Return the script.

    Raises:
        InputError: no stick stands for the control, or the campaign does not say which way it moves the vehicle.
    """
    stick = trial.find_stick()
    factor, unit = trial.shown
    bounds = [None if bound is None else _shown(bound * factor) for bound in (trial.lower, trial.upper)]
    full = max(abs(float(trial.value.max())), abs(float(trial.value.min()))) * factor
    full = _shown(max([full] + [abs(bound) for bound in bounds if bound is not None]))
    rate = None if trial.rate is None else _shown(trial.rate * factor)
    rows = "".join(
        f"    ({float(t)!r}, {_shown(x * factor)!r}),\n" for t, x in zip(trial.time, trial.value, strict=True)
    )
    code = files("seatrial.export.trials").joinpath("mavlink_script.py").read_text(encoding="utf-8")
    imports, _, rest = code[code.index("from __future__") :].partition(_BEGIN)
    # The text stands in a docstring of the script.
    head = _DOC.replace("@FULL@", repr(full)).replace(
        "@DOC@",
        "\n".join(
            "".join(c if c.isprintable() else " " for c in line).replace("\\", "/").replace('"', "'")
            for line in trial.lines
        ),
    )
    own = f"""CONTROL, UNIT = {trial.control!r}, {unit!r}
AXIS, SIGN = {stick.axis!r}, {stick.sign}
LOWER, UPPER, RATE = {bounds[0]!r}, {bounds[1]!r}, {rate!r}
FULL = {full!r}
ROWS = [
{rows}]
"""
    return head + imports + _BEGIN + own + _END + rest.partition(_END)[2]


def _shown(value: float) -> float:
    """Return a number without the rounding of its unit."""
    return float(f"{value:.12g}")
