"""The unit that the name of a column ends with: `depth_m`, `imu_gz_dps`, `time [ms]`, `speed(m/s)`."""

import re
from typing import NamedTuple

# Units by the ending, in small letters; the first is the likelier one
ENDINGS = {
    **dict.fromkeys(("deg_s", "degps", "degs", "deg_per_s", "dps"), ("deg/s",)),
    **dict.fromkeys(("rad_s", "radps", "rads", "rad_per_s"), ("rad/s",)),
    "mrad_s": ("mrad/s",),
    "deg": ("deg",),
    "cdeg": ("cdeg",),
    "rad": ("rad",),
    "mrad": ("mrad",),
    "rpm": ("rpm",),
    "rps": ("rev/s",),
    **dict.fromkeys(("mps", "m_s", "m_per_s"), ("m/s",)),
    "ms": ("m/s", "ms"),
    **dict.fromkeys(("cmps", "cm_s", "cms", "cm_per_s"), ("cm/s",)),
    **dict.fromkeys(("mmps", "mm_s", "mms", "mm_per_s"), ("mm/s",)),
    **dict.fromkeys(("kmph", "km_h", "kmh", "kph"), ("km/h",)),
    **dict.fromkeys(("kn", "kt", "kts", "knot", "knots"), ("kn",)),
    **dict.fromkeys(("newton", "newtons", "n"), ("N",)),
    **dict.fromkeys(("nm", "n_m"), ("N*m",)),
    "kgf": ("kgf",),
    "lbf": ("lbf",),
    "m": ("m",),
    "cm": ("cm",),
    "mm": ("mm",),
    **dict.fromkeys(("ns", "nsec"), ("ns",)),
    **dict.fromkeys(("us", "usec"), ("us",)),
    "msec": ("ms",),
    **dict.fromkeys(("s", "sec", "secs", "seconds"), ("s",)),
    "min": ("min",),
    "h": ("h",),
}


class NameAndUnits(NamedTuple):
    """The name of a column without the unit at its end, and what that unit may be; none if there is no unit."""

    bare: str
    units: tuple[str, ...]


def name_and_units(name: str) -> NameAndUnits:
    """Part the unit from the name of a column.

    Args:
        name: in small letters, without spaces.
    """
    match = re.fullmatch(r"(.+?)_?[\[(]([^\[\]()]+)[\])]", name)
    if match:
        return NameAndUnits(match[1], ENDINGS.get(match[2].replace("/", "_"), (match[2],)))
    ending = next((one for one in _LONGEST_FIRST if name.endswith(f"_{one}") and len(name) > len(one) + 1), None)
    return NameAndUnits(name, ()) if ending is None else NameAndUnits(name[: -len(ending) - 1], ENDINGS[ending])


_LONGEST_FIRST = sorted(ENDINGS, key=len, reverse=True)
