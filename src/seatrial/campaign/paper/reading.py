"""The vehicle of a study: one of two readings of the paper's unprinted units, or a user's own from a TOML file.

The paper prints T = 6.28 and says neither of which unit nor at which propeller speed the vehicle is trimmed. Under reading A
it is 6.28e-2 N/(rev/s)^2 at 12.5 rev/s, under reading B 6.28e-4 N/(rad/s)^2 at 125 rad/s (Hall and Anstee 2011): the same
trim thrust, and amplitudes in rpm that differ in effect by 2 pi / 10.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files
from math import pi
from pathlib import Path

from pydantic import Field

from seatrial.campaign.schema import Quantity, Table
from seatrial.campaign.toml_file import read_toml
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, located
from seatrial.core.signals import signal_unit
from seatrial.core.units import quantity
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.surge import SurgeHull, surge_vehicle, trim_speed

RPM = 2 * pi / 60
NAMES = ("X_u", "X_uabsu", "T_nabsn")
"""Coefficients of eq. (3)."""
PRINTED_THRUST = 6.28
NOISE_SHARE, STEPS_SHARE, HIGHEST_SHARE = 0.05, 8 / 15, 4 / 15
"""Where a file does not say otherwise: noise over trim speed, and amplitudes over trim propeller speed, as in reading A."""


class CoefficientsTable(Table, allow_inf_nan=False):
    """`[coefficients]`: true values of eq. (3), SI numbers or quantities with a unit."""

    X_u: float | Quantity
    X_uabsu: float | Quantity
    T_nabsn: float | Quantity


class TrimTable(Table):
    """`[trim]`: propeller speed about which the vehicle works; the surge speed follows."""

    n: Quantity


class DoubtedTable(Table, allow_inf_nan=False):
    """`[doubted]`: the term of model M-0 that M-1 lacks, its two true values, and the half width of its wide prior, SI."""

    term: str = "X_du3"
    values: list[float] = Field(default=[0.1, 1.0], min_length=2, max_length=2)
    wide: float = Field(default=50.0, gt=0)


class UnitsTable(Table):
    """`[units]`: of T_nabsn in tables and as a state of the filters; where absent, that in which its true value is 6.28."""

    printed_thrust: Quantity | None = None
    filter_thrust: Quantity | None = None


class NoiseTable(Table):
    """`[noise]`: standard deviation of the surge speed's in the filters' trials and in those of Section IV; udot has the same number."""

    filters: Quantity | None = None
    trial: Quantity | None = None


class InputsTable(Table):
    """`[inputs]`: largest change of n in the random steps, and the range of the doublets."""

    steps: Quantity | None = None
    lowest: Quantity | None = None
    highest: Quantity | None = None


class VehicleFile(Table, allow_inf_nan=False):
    """The whole file."""

    name: str
    mass: Quantity
    thrust_deduction: float = 0.0
    fixed: dict[str, float] = Field(default={})
    coefficients: CoefficientsTable
    trim: TrimTable
    doubted: DoubtedTable = DoubtedTable()
    units: UnitsTable = UnitsTable()
    noise: NoiseTable = NoiseTable()
    inputs: InputsTable = InputsTable()


@dataclass(frozen=True, eq=False)
class Reading:
    """A vehicle with its true coefficients, noise and limits; properties give SI.

    Attributes:
        name: `A` or `B`, or the stem of the user's file.
        path: file, for messages.
        source: its content, in its own units.
        is_paper: whether this is the paper's vehicle, so that its printed numbers apply.
    """

    name: str
    path: Path
    source: VehicleFile
    is_paper: bool

    @cached_property
    def truth(self) -> dict[str, float]:
        """True coefficients of eq. (3), SI."""
        table = self.source.coefficients.model_dump()
        return {
            name: self._si(value, CoefficientName.parse(name).unit, f"coefficients.{name}")
            if isinstance(value, str)
            else float(value)
            for name, value in table.items()
        }

    @cached_property
    def hull(self) -> SurgeHull:
        """What is known beforehand, trimmed."""
        source = self.source
        turns = self._si(source.trim.n, "rad/s", "trim.n")
        mass, truth = self._si(source.mass, "kg", "mass"), self.truth
        with located(str(self.path)):
            hull = SurgeHull(source.name, mass, source.thrust_deduction, source.fixed, {"n": turns})
            speed = trim_speed(surge_vehicle(hull, NAMES), truth, (turns,))
        return replace(hull, trim={"u": speed, "n": turns})

    @property
    def inertia(self) -> float:
        """Effective mass m - X_udot, kg."""
        return self._si(self.source.mass, "kg", "mass") - self.source.fixed.get("X_udot", 0.0)

    @property
    def trim(self) -> float:
        """Propeller speed at trim, rad/s."""
        return self.hull.trim["n"]

    @property
    def doubted(self) -> str:
        """Name of the term M-1 lacks."""
        return self.source.doubted.term

    @cached_property
    def thrust_print(self) -> float:
        """SI value of the unit in which T_nabsn is printed."""
        return self._thrust_unit("printed_thrust")

    @cached_property
    def thrust_filter(self) -> float:
        """SI value of the unit in which T_nabsn is a state of the filters."""
        return self._thrust_unit("filter_thrust")

    @property
    def print_scales(self) -> dict[str, float]:
        """SI value of one printed unit of each coefficient."""
        return {"X_u": 1.0, "X_uabsu": 1.0, "T_nabsn": self.thrust_print, self.doubted: 1.0}

    @property
    def printed_truth(self) -> dict[str, float]:
        """True coefficients as the tables print them."""
        return {name: value / self.print_scales[name] for name, value in self.truth.items()}

    @cached_property
    def filter_noise(self) -> float:
        """Standard deviation of the noise of u, m/s, in the filters' trials; udot has the same number in m/s^2."""
        return self._noise("filters")

    @cached_property
    def sigma(self) -> float:
        """Standard deviation of the noise of u in the trials of Section IV, m/s."""
        return self._noise("trial")

    @property
    def steps(self) -> float:
        """Largest change of n in the random steps, rad/s."""
        return self._amplitude("steps", STEPS_SHARE)

    @property
    def lowest(self) -> float:
        """Smallest amplitude of the doublets, rad/s."""
        return self._amplitude("lowest", HIGHEST_SHARE / 2)

    @property
    def highest(self) -> float:
        """Largest amplitude of the doublets, rad/s."""
        return self._amplitude("highest", HIGHEST_SHARE)

    def model(self, *extra: str) -> VehicleModel:
        """Surge model of eq. (3), with extra terms."""
        hull = self.hull
        with located(str(self.path)):
            return surge_vehicle(hull, (*NAMES, *extra))

    def printed(self, value: float | None) -> float | None:
        """A number the paper prints, where this is the paper's vehicle."""
        return value if self.is_paper else None

    def _thrust_unit(self, key: str) -> float:
        text = getattr(self.source.units, key)
        if text is None:
            return abs(self.truth["T_nabsn"]) / PRINTED_THRUST
        return self._si(text, CoefficientName.parse("T_nabsn").unit, f"units.{key}")

    def _noise(self, key: str) -> float:
        text = getattr(self.source.noise, key)
        return NOISE_SHARE * abs(self.hull.trim["u"]) if text is None else self._si(text, "m/s", f"noise.{key}")

    def _amplitude(self, key: str, share: float) -> float:
        text = getattr(self.source.inputs, key)
        return share * abs(self.trim) if text is None else self._si(text, signal_unit("n"), f"inputs.{key}")

    def _si(self, text: str, unit: str, key: str) -> float:
        return quantity(text, unit, f"{self.path}, key {key}")


def read_vehicle(path: Path) -> Reading:
    """A user's vehicle, checked.

    Raises:
        InputError: no such file, or something in it that cannot be used.
    """
    if not path.is_file():
        raise InputError(
            str(path),
            found="no such file",
            expected="a TOML file of a surge vehicle",
            remedy="see the README for one, or leave --vehicle out for the paper's REMUS 100",
        )
    return _checked(Reading(path.stem, path, read_toml(path, VehicleFile), False))


def paper_reading(name: str) -> Reading:
    """The paper's vehicle as read one way, `A` or `B`."""
    place = Path(str(files(__package__).joinpath(f"reading_{name.lower()}.toml")))
    return Reading(name, place, read_toml(place, VehicleFile), True)


def _checked(reading: Reading) -> Reading:
    """Resolve everything once, so that mistakes are found before any work is done."""
    where = f"{reading.path}, key "
    for name in (*NAMES, reading.doubted):
        if name in reading.source.fixed:
            raise InputError(
                where + ("doubted.term" if name == reading.doubted else f"fixed.{name}"),
                found=f"{name}, which is both fixed and estimated",
                expected="a term that is not fixed" if name == reading.doubted else "terms that are not estimated",
                remedy=f"leave {name} out of [fixed]",
            )
    reading.model(reading.doubted)
    positive = {
        "coefficients.T_nabsn": reading.truth["T_nabsn"] * reading.trim,
        "units.printed_thrust": reading.thrust_print,
        "units.filter_thrust": reading.thrust_filter,
        "noise.filters": reading.filter_noise,
        "noise.trial": reading.sigma,
        "inputs.steps": reading.steps,
        "inputs.lowest": reading.lowest,
        "inputs.highest": reading.highest - reading.lowest,
    }
    for key, value in positive.items():
        if not value > 0:
            raise InputError(
                where + key,
                found=f"{value:g} (SI)" if key != "inputs.highest" else "no more than inputs.lowest",
                expected="thrust ahead" if key == "coefficients.T_nabsn" else "a positive number",
                remedy="correct the value; leave optional tables out for the paper's proportions",
            )
    for key, values in (("coefficients", reading.truth.values()), ("doubted.values", reading.source.doubted.values)):
        if 0.0 in values:
            raise InputError(
                where + key,
                found="a true value of 0",
                expected="terms that act",
                remedy="give another value: the width of a prior is set by it",
            )
    return reading


READINGS = {name: paper_reading(name) for name in ("A", "B")}
