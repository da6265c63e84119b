"""Reads the package's own JSON of a vehicle back, and refuses what is not one."""

import json
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, located
from seatrial.core.signals import RATES
from seatrial.export.targets.own_json import FORMAT, described
from seatrial.export.vehicle import (
    AveragedCoefficient,
    CoefficientEstimates,
    EstimatedNumber,
    ExportedVehicle,
    ExportProvenance,
)
from seatrial.vehicles.actuators import Actuator
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.thrusters import Thruster

# Keys that files of earlier versions of the same format lack.
LATER_KEYS = ("uncertainty", "quoted", "averaged", "numbers")
_ROUNDING = 1e-9  # Relative difference that is rounding


def read_exported(path: Path | str) -> tuple[ExportedVehicle, ExportProvenance]:
    """Read a vehicle and where it comes from.

    Raises:
        InputError: no such file, no JSON, another format, something missing, or numbers that no vehicle has.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_each_once)
    except FileNotFoundError as cause:
        raise _refusal(path, "no such file") from cause
    except OSError as cause:
        raise _refusal(path, f"a place that cannot be read ({cause.strerror})") from cause
    except (ValueError, RecursionError) as cause:
        raise _refusal(path, f"no JSON ({cause})") from cause
    result = content.get("format") if isinstance(content, dict) else None
    if result != FORMAT or isinstance(result, bool):
        raise _refusal(path, "no format number" if result is None else f"format {result}")
    try:
        with located(str(path)):
            vehicle = _vehicle(content)
            vehicle.model()
            _check_numbers(vehicle)
            _check_agreement(content, json.loads(json.dumps(described(vehicle))), "")
        return vehicle, _provenance(content["provenance"])
    except (KeyError, TypeError, ValueError, AttributeError) as cause:
        raise _refusal(path, f"{type(cause).__name__} at {cause}") from cause


def _vehicle(content: dict[str, Any]) -> ExportedVehicle:
    rows = content["coefficients"]
    for row in rows:
        name = CoefficientName.parse(row["name"])
        if row["unit"] != name.unit:
            raise InputError(
                f"coefficient {name}",
                found=f'unit "{row["unit"]}"',
                expected=f'"{name.unit}"',
                remedy="the unit follows from the name: give the value in SI",
            )
    body = {key: _body_value(one["value"]) for key, one in content["body"].items()}
    places = ("products_of_inertia", "centre_of_gravity", "centre_of_buoyancy")
    products, gravity, buoyancy = (_three(body[key] or [0.0] * 3) for key in places)
    hull = Hull(
        content["name"],
        body["mass"],
        _three(body["inertia_about_origin"]),
        products,
        gravity,
        buoyancy,
        body["weight"] or 0.0,
        body["buoyancy"] or 0.0,
        body["thrust_deduction"],
        body["wake"],
        {},
        {name: _number(one["value"]) for name, one in content["trim"].items()},
    )
    moves = tuple(content["moves"])
    if not set(moves) <= set(RATES):
        raise ValueError(f"moves {moves}")
    return ExportedVehicle(
        content["name"],
        hull,
        {row["name"]: _number(row["value"]) for row in rows},
        moves,
        content["added_coriolis"],
        tuple(Thruster(_three(one["place"]), _three(one["direction"])) for one in content["thrusters"]),
        {name: _actuator(one) for name, one in content["actuators"].items()},
        _estimated(content["estimated"]),
        {
            str(one["name"]): EstimatedNumber(_number(one["value"]), _number(one["sd"]), str(one["unit"]))
            for one in content.get("numbers", ())
        },
    )


def _check_numbers(vehicle: ExportedVehicle) -> None:
    """Refuse numbers that no vehicle has, beside those that its parts refuse themselves."""
    for name in vehicle.actuators:
        if name not in vehicle.controls:
            raise _contradiction(f"actuators.{name}", name, "a control of the vehicle")
    spread, sd = vehicle.estimated.covariance, vehicle.estimated.sd
    if sd.size and np.linalg.eigvalsh(spread / np.outer(sd, sd))[0] < -_ROUNDING:
        raise _contradiction("estimated.covariance", "impossible correlations", "a covariance")
    for name, mean in zip(vehicle.estimated.names, vehicle.estimated.mean, strict=True):
        if not np.isclose(vehicle.coefficients[name], mean, rtol=_ROUNDING, atol=0):
            raise _contradiction(
                f"estimated.mean, {name}", mean, f"the coefficient's value, {vehicle.coefficients[name]!r}"
            )


def _check_agreement(result: Any, expected: Any, key: str) -> None:
    """Refuse a file whose parts say different things: every part is compared with what the vehicle that was read would have there."""
    if isinstance(expected, dict) and isinstance(result, dict):
        for name, value in expected.items():
            if name not in result:
                if name in LATER_KEYS:
                    continue
                raise _contradiction(f"{key}{name}", "nothing", repr(value))
            _check_agreement(result[name], value, f"{key}{name}.")
    elif isinstance(expected, list) and isinstance(result, list) and len(result) == len(expected):
        for number, (one, other) in enumerate(zip(result, expected, strict=True)):
            _check_agreement(one, other, f"{key}{number}.")
    elif isinstance(expected, float) and isinstance(result, int | float):
        if not np.isclose(result, expected, rtol=_ROUNDING, atol=_ROUNDING):
            raise _contradiction(key.rstrip("."), result, repr(expected))
    elif result != expected:
        raise _contradiction(key.rstrip("."), result, repr(expected))


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len({key for key, _ in pairs}) < len(pairs):
        raise ValueError("a key stands twice")
    return dict(pairs)


def _contradiction(key: str, result: Any, expected: str) -> InputError:
    return InputError(
        f"key {key}",
        found=str(result),
        expected=expected,
        remedy="export the vehicle again, or make the parts of the file agree",
    )


def _estimated(table: dict[str, Any]) -> CoefficientEstimates:
    names = tuple(table["names"])
    mean, sd = np.array(table["mean"], float), np.array(table["sd"], float)
    covariance = np.array(table["covariance"], float).reshape(len(names), len(names))
    spread = np.sqrt(np.diag(covariance))
    if mean.shape != sd.shape or not np.allclose(spread, sd, rtol=1e-6) or not np.allclose(covariance, covariance.T):
        raise ValueError("a covariance that is not symmetric, or a diagonal other than sd^2")
    averaged = tuple(
        AveragedCoefficient(
            CoefficientName.parse(one["name"]).text, *(_number(one[key]) for key in ("mean", "sd", "inclusion"))
        )
        for one in table.get("averaged", ())
    )
    return CoefficientEstimates(names, mean, sd, covariance, averaged, str(table.get("quoted", "")))


def _provenance(table: dict[str, Any]) -> ExportProvenance:
    lists = {key: tuple(table[key]) for key in ("dropped", "absent", "sources", "cautions")}
    current, speeds = _number(table.get("current", 0.0)), table.get("speeds")
    speeds = speeds and (_number(speeds[0]), _number(speeds[1]))
    texts = (table[key] for key in ("run", "title", "structure", "seatrial"))
    return ExportProvenance(*texts, **lists, current=current, speeds=speeds)


def _actuator(one: dict[str, Any]) -> Actuator:
    lower, upper, rate = (
        unbounded if one[key] is None else _number(one[key])
        for key, unbounded in (("lower", -inf), ("upper", inf), ("rate", inf))
    )
    return Actuator(_number(one["time_constant"]), lower, upper, rate)


def _body_value(value: Any) -> Any:
    return value if value is None or isinstance(value, list) else _number(value)


def _three(values: list) -> tuple:
    first, second, third = (None if value is None else _number(value) for value in values)
    return first, second, third


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise ValueError(f"{value!r} instead of a number")
    return float(value)


def _refusal(path: Path, found: str) -> InputError:
    return InputError(
        str(path),
        found=found,
        expected=f"a vehicle exported with `--to json`, format {FORMAT}",
        remedy="export it again with this version of seatrial",
    )
