"""The vehicle of a study: one of two readings of the paper's unprinted units, or a user's own from a TOML file.

The paper prints T = 6.28 and says neither of which unit nor at which propeller speed the vehicle is trimmed. Under reading A
it is 6.28e-2 N/(rev/s)^2 at 12.5 rev/s, under reading B 6.28e-4 N/(rad/s)^2 at 125 rad/s (Hall and Anstee 2011): the same
trim thrust, and amplitudes in rpm that differ in effect by 2 pi / 10.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files
from math import inf, pi
from pathlib import Path

from pydantic import Field

from seatrial.campaign.config.quantities import Quantity, Table
from seatrial.campaign.config.toml import key_place, parse_toml, read_text
from seatrial.core.coefficients import CoefficientName
from seatrial.core.errors import InputError, located
from seatrial.core.signals import signal_unit
from seatrial.core.units import quantity
from seatrial.vehicles.hull import Hull
from seatrial.vehicles.linearise import trim_speed
from seatrial.vehicles.model import VehicleModel
from seatrial.vehicles.whole import whole_vehicle

RPM = 2 * pi / 60
NAMES = ("X_u", "X_uabsu", "T_nabsn")  # Coefficients of eq. (3).
PRINTED_THRUST = 6.28
# Where a file does not say otherwise: noise over trim speed, and amplitudes over trim propeller speed, as in reading A.
NOISE_SHARE, STEPS_SHARE, HIGHEST_SHARE = 0.05, 8 / 15, 4 / 15

ANSWERS = (0.1, 600.0)  # Shortest and longest time constant of the surge speed, s
EXAMPLE = "examples/vehicle.toml of seatrial's repository"


class CoefficientsTable(Table, allow_inf_nan=False):
    """`[coefficients]`: true values of eq. (3), SI numbers or quantities with a unit."""

    X_u: float | Quantity
    X_uabsu: float | Quantity
    T_nabsn: float | Quantity


class VehicleTrim(Table):
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
    trim: VehicleTrim
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
        text: of the file, which says on what line a key stands.
    """

    name: str
    path: Path
    source: VehicleFile
    is_paper: bool
    text: str = ""

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

    @property
    def turns(self) -> float:
        """Propeller speed at trim, rad/s."""
        return self._si(self.source.trim.n, "rad/s", "trim.n")

    @cached_property
    def hull(self) -> Hull:
        """What is known beforehand, trimmed."""
        source, turns = self.source, self.turns
        mass, truth = self._si(source.mass, "kg", "mass"), self.truth
        with located(str(self.path)):
            hull = Hull(
                source.name, mass, thrust_deduction=source.thrust_deduction, fixed=source.fixed, trim={"n": turns}
            )
            speed = trim_speed(whole_vehicle(hull, NAMES, moves=("u",)), truth, (turns,))
        # Rounded where rounding errors begin: vehicles of one trim speed then have the same equations, and share compiled code.
        return replace(hull, trim={"u": round(speed, 12), "n": turns})

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
            return whole_vehicle(hull, (*NAMES, *extra), moves=("u",))

    def printed(self, value: float | None) -> float | None:
        """Return a number the paper prints, where this is the paper's vehicle."""
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
        return quantity(text, unit, key_place(self.path, self.text, key))


def read_vehicle(path: Path) -> Reading:
    """Return a user's vehicle, checked.

    Raises:
        InputError: no such file, or something in it that cannot be used.
    """
    if not path.is_file():
        raise InputError(
            str(path),
            found="a folder" if path.is_dir() else "no such file",
            expected="a TOML file of a surge vehicle",
            remedy=f"begin with {EXAMPLE}, or leave --vehicle out for the paper's REMUS 100",
        )
    text = read_text(path)
    source = parse_toml(path, text, VehicleFile, _example)
    return _checked(Reading(path.stem, path, source, False, text))


def paper_reading(name: str) -> Reading:
    """Return the paper's vehicle as read one way, `A` or `B`."""
    place = Path(str(files(__package__).joinpath(f"reading_{name.lower()}.toml")))
    text = read_text(place)
    return Reading(name, place, parse_toml(place, text, VehicleFile, _example), True, text)


def _example(_: Sequence[str | int]) -> str:
    """Return what to say after a missing key."""
    return f"{EXAMPLE} shows every table"


def _checked(reading: Reading) -> Reading:
    """Resolve everything once, so that mistakes are found before any work is done."""
    source, doubted = reading.source, reading.source.doubted
    for name in (*NAMES, reading.doubted):
        if name in source.fixed:
            key = "doubted.term" if name == reading.doubted else f"fixed.{name}"
            raise _mistake(
                reading, key, f"{name}, both fixed and estimated", "one of the two", f"take {name} out of [fixed]"
            )
    for place, result, expected, remedy in (
        ("name", "" if source.name.strip() else "no name", "a name", "it heads the report"),
        *(
            (f"coefficients.{name}", "" if value < 0 else f"{value:g}", "a negative number", "drag opposes motion")
            for name, value in reading.truth.items()
            if name != "T_nabsn"
        ),
        *(
            (place, "" if value > 0 else f"{value:g} (SI)", "a positive number", "the vehicle is trimmed going ahead")
            for place, value in (("coefficients.T_nabsn", reading.truth["T_nabsn"]), ("trim.n", reading.turns))
        ),
        (
            "fixed.X_udot",
            f"{source.fixed['X_udot']:g}" if source.fixed.get("X_udot", 0.0) > 0 else "",
            "no positive number",
            "added mass X_udot is negative in SNAME notation",
        ),
        (
            "doubted.values",
            "" if len({*doubted.values, 0.0}) == 3 else f"{doubted.values}",
            "two different numbers other than 0",
            "they are the true values of Tables IV and V; the widths of priors are set by them",
        ),
        (
            "doubted.wide",
            "" if doubted.wide >= max(map(abs, doubted.values)) else f"{doubted.wide:g}",
            "at least the larger of doubted.values",
            "the wide prior has to hold the truth",
        ),
    ):
        if result:
            raise _mistake(reading, place, result, expected, remedy)
    reading.model(reading.doubted)
    _check_sizes(reading)
    return reading


def _check_sizes(reading: Reading) -> None:
    """Noise, amplitudes and the time that the vehicle takes to answer, beside the study's own trials."""
    truth, trim = reading.truth, reading.trim
    drag = -truth["X_u"] - 2 * truth["X_uabsu"] * reading.hull.trim["u"]
    answer = reading.inertia / drag
    for key, value, high in (
        ("units.printed_thrust", reading.thrust_print, inf),
        ("units.filter_thrust", reading.thrust_filter, inf),
        ("noise.filters", reading.filter_noise, inf),
        ("noise.trial", reading.sigma, inf),
        ("inputs.steps", reading.steps, trim),
        ("inputs.highest", reading.highest, trim),
        ("inputs.lowest", reading.lowest, reading.highest * (1 - 1e-9)),
    ):
        if not (value > 0 if high == inf else 0 < value <= high):
            beyond = (
                "inputs.highest" if key == "inputs.lowest" else f"trim.n, {trim:.4g}, where the propeller would stop"
            )
            raise _mistake(
                reading,
                key,
                f"{value:.4g} (SI)",
                "a positive number" + ("" if high == inf else f", and less than {beyond}"),
                "correct the value; leave optional tables out for the paper's proportions",
            )
    if not ANSWERS[0] <= answer <= ANSWERS[1]:
        raise _mistake(
            reading,
            "mass",
            f"a vehicle whose speed answers in {answer:.3g} s",
            f"{ANSWERS[0]:g} to {ANSWERS[1]:g} s, which trials of a minute sampled every 0.01 s can show",
            "check the mass, X_udot, the coefficients and their units",
        )


def _mistake(reading: Reading, key: str, found: str, expected: str, remedy: str) -> InputError:
    return InputError(key_place(reading.path, reading.text, key), found=found, expected=expected, remedy=remedy)


READINGS = {name: paper_reading(name) for name in ("A", "B")}
