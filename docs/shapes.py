"""Do published coefficients lie where the shape of the vehicle places them? `python docs/shapes.py`.

Compares tables of ten vehicles with the priors of `seatrial.priors_from_shape`. The factors of error follow from these tables, so that
each vehicle is also judged by the factors that the others give. Writes docs/dev/shapes.json and the tables in docs/dev/shapes.md.
"""

from collections.abc import Sequence
from math import exp, log, sqrt
from typing import Any, NamedTuple

import numpy as np
import study_numbers

from seatrial.vehicles.catalogue import load_vehicle
from seatrial.vehicles.shape import QUALITIES, shape_terms, vehicle_shape

NORMAL_95 = 1.96  # Standard deviations about the median with 95 % of a normal
MARGIN = 1.15  # Of the logarithm of a factor, because vehicles are few


class Table(NamedTuple):
    """A published table.

    Attributes:
        vehicle: tables of one vehicle have one name.
        source: of the coefficients.
        shape: as given to `vehicle_shape`.
        lengths: source of the lengths.
        density: of the water, kg/m^3.
        inertia: I_xx, I_yy, I_zz, kg m^2; 0 if not published.
        values: coefficients, SI.
        set_aside: those that do not set a factor of error, but are counted.
    """

    vehicle: str
    source: str
    shape: dict[str, Any]
    lengths: str
    density: float
    inertia: tuple[float, float, float]
    values: dict[str, float]
    set_aside: tuple[str, ...] = ()


def _rows(added: str = "", linear: str = "", quadratic: str = "") -> dict[str, float]:
    """Return coefficients of sizes in the order of the axes; a dash where none is published."""
    values = {}
    for text, suffix in ((added, "{0}dot"), (linear, "{0}"), (quadratic, "{0}abs{0}")):
        for axis, rate, size in zip("XYZKMN", "uvwpqr", text.split() or "------", strict=True):
            if size != "-":
                values[f"{axis}_{suffix.format(rate)}"] = -float(size)
    return values


def _primes(values: dict[str, float], length: float, density: float) -> dict[str, float]:
    """Return added masses that are published without dimension, in rho/2 L^3, and moments in rho/2 L^5."""
    return {name: one * density / 2 * length ** (3 if name[0] in "XYZ" else 5) for name, one in values.items()}


def _catalogue(name: str) -> dict[str, float]:
    body = load_vehicle(name)
    return {**body.hull.fixed, **body.coefficients}


_REMUS = {"form": "torpedo", "length": 1.33, "diameter": 0.191, "nose": 0.191, "tail": 0.541, "mass": 30.48}
_REMUS_LENGTHS = (
    "length and diameter in a public program after Hall and Anstee; nose and tail by Prestero (2001), as remembered"
)
_NPS_CROSS = 0.5 * 1025 * 0.53 * 5.3
BLUEROV2 = {"form": "box", "length": 0.457, "beam": 0.338, "height": 0.254}
TABLES = (
    Table(
        "REMUS 100",
        "Prestero (2001), catalogue `remus100_prestero`",
        _REMUS,
        _REMUS_LENGTHS,
        1030.0,
        (0.177, 3.45, 3.45),
        _catalogue("remus100_prestero"),
        ("Y_vabsv", "Z_wabsw", "M_qabsq", "N_rabsr"),
    ),
    Table(
        "REMUS 100",
        "Hall and Anstee (2011), catalogue `remus100_hall_anstee`: surge drag differs",
        _REMUS,
        _REMUS_LENGTHS,
        1030.0,
        (0.0, 0.0, 0.0),
        {"X_uabsu": _catalogue("remus100_hall_anstee")["X_uabsu"]},
    ),
    Table(
        "Delphin2",
        "program of the vehicle, `delphin2_AUV` (Southampton), deeply submerged",
        {"form": "torpedo", "length": 1.96, "diameter": 0.254, "mass": 79.4},
        "length and mass in the program; the diameter was not found in a readable source, and gives the published volume of 0.08 m³",
        1000.0,
        (0.0, 0.0, 35.0),
        _rows("2.4102 65.4693 - - - 14.1749", "", "6.4907 183.2206 - - - 82"),
    ),
    Table(
        "LAUV",
        "da Silva and others (2007), by public programs that agree",
        {"form": "torpedo", "length": 1.08, "diameter": 0.15, "mass": 18.0},
        "the same",
        1000.0,
        (0.04, 2.1, 2.1),
        _rows("1 16 16 - - -", "2.4 23 23 - 9.7 9.7", "2.4 80 80 - 9.1 9.1"),
    ),
    Table(
        "ECA A9",
        "`uuvsimulator/eca_a9`, drag in proportion to the speed ahead",
        {"form": "torpedo", "length": 1.98, "diameter": 0.23, "mass": 69.7},
        "the same",
        1027.0,
        (0.6, 30.0, 35.0),
        _rows("4 95 75 - 27 32", "", "8 - - - - -"),
    ),
    Table(
        "NPS AUV II",
        "Healey and Lienard (1993), by `npsauv.m` of MSS",
        {"form": "torpedo", "length": 5.3, "beam": 1.93, "height": 0.8, "nose": 0.8, "tail": 1.4, "mass": 5443.0},
        "length and mass in MSS. Beam, height, nose and tail were not found in a readable source: they are chosen so that the hull holds "
        "the published 5.3 m³. The 0.53 m by 0.53 m of MSS hold 1.5 m³ at most, which is refused",
        1025.0,
        (2038.0, 13587.0, 13587.0),
        _primes(
            {
                "X_udot": -7.6e-3,
                "Y_vdot": -5.5e-2,
                "Z_wdot": -2.4e-1,
                "K_pdot": -1.0e-3,
                "M_qdot": -1.7e-2,
                "N_rdot": -3.4e-3,
            },
            5.3,
            1025.0,
        )
        | {"X_uabsu": -0.00385 * 1025 / 2 * 5.3**2, "Y_vabsv": -0.5 * _NPS_CROSS, "Z_wabsw": -0.6 * _NPS_CROSS},
    ),
    Table(
        "BlueROV2",
        "Wu (Flinders University, 2018), by public programs that agree",
        BLUEROV2 | {"mass": 11.5},
        "datasheet of the maker, quoted by a public model",
        1000.0,
        (0.16, 0.16, 0.16),
        _rows("5.5 12.7 14.57 0.12 0.12 0.12", "4.03 6.22 5.18 0.07 0.07 0.07", "18.18 21.66 36.99 1.55 1.55 1.55"),
    ),
    Table(
        "BlueROV2",
        "`fossen/parameters.py`, in public programs of controllers (ten found)",
        BLUEROV2 | {"mass": 11.4},
        "the same",
        1026.0,
        (0.21, 0.245, 0.245),
        _rows(
            "2.6 18.5 13.3 0.054 0.0173 0.28", "0.09 0.26 0.19 0.895 0.287 4.64", "34.96 103.25 74.23 0.084 0.028 0.43"
        ),
    ),
    Table(
        "BlueROV2 Heavy",
        "von Benzon and others (2022), catalogue `bluerov2_heavy`",
        BLUEROV2 | {"beam": 0.575, "mass": 13.5},
        "length and height as above; beam by a public model",
        1000.0,
        (0.26, 0.23, 0.37),
        _catalogue("bluerov2_heavy"),
    ),
    Table(
        "VideoRay Pro III",
        "Wang (2007), by `videoray_pro_3_params.m`",
        {"form": "box", "length": 0.356, "beam": 0.229, "height": 0.216, "mass": 3.6},
        "not found in a readable source: 14 by 9 by 8.5 inches as remembered; the maker's 8 pounds",
        1000.0,
        (0.0, 0.0, 0.0),
        _rows("1.94 6.05 3.95 - - 0.0118", "0.95 5.87 3.70 - - 0.023", "6.04 30.73 26.36 - - 0.45"),
    ),
    Table(
        "SF 30k",
        "Berg (2012), by `rexrov_base.xacro` of UUV Simulator",
        {"form": "box", "length": 2.6, "beam": 1.5, "height": 1.6, "mass": 1862.87},
        "the same",
        1028.0,
        (525.39, 794.2, 691.23),
        _rows(
            "779.79 1222 3659.9 534.9 842.69 224.32",
            "74.82 69.48 728.4 268.8 309.77 105",
            "748.22 992.53 1821.01 672 774.44 523.27",
        ),
    ),
    Table(
        "SAGA",
        "`uuvsimulator/desistek_saga`: no quadratic drag",
        {"form": "box", "length": 0.448, "beam": 0.2384, "height": 0.28066, "mass": 10.0},
        "the same",
        1028.0,
        (0.0, 0.0, 0.0),
        _rows("1.7182 - 5.468 - 1.2481 0.4006", "11.7391 20 31.8678 25 44.9085 5"),
        ("X_u", "Y_v", "Z_w", "K_p", "M_q", "N_r"),
    ),
)
"""Facts of the sources; their texts, programs and files are not copied."""


class Row(NamedTuple):
    """A published number and that of the shape."""

    table: int
    name: str
    published: float
    expected: float
    kind: str

    @property
    def vehicle(self) -> str:
        """Name of the vehicle."""
        return TABLES[self.table].vehicle

    @property
    def family(self) -> str:
        """Name of the vehicle in any configuration."""
        return self.vehicle.removesuffix(" Heavy")

    @property
    def log_ratio(self) -> float:
        """Logarithm of the published number divided by that of the shape."""
        return log(self.published / self.expected)

    def is_inside(self, factor: float) -> bool:
        """Return whether the published number is inside 95 % of the prior of a factor."""
        return abs(self.log_ratio) <= NORMAL_95 * log(factor)

    def ends(self, factor: float) -> tuple[float, float]:
        """Return the ends of 95 % of the prior."""
        spread = factor**NORMAL_95
        low, high = sorted((self.expected / spread, self.expected * spread))
        return low, high


def all_rows() -> list[Row]:
    """Return every published number for which the shape gives one."""
    found = []
    for index, table in enumerate(TABLES):
        lengths = {name: one for name, one in table.shape.items() if name not in ("form", "mass")}
        shape = vehicle_shape(table.shape["form"], table.shape["mass"], lengths)
        moments = zip(("I_xx", "I_yy", "I_zz"), table.inertia, shape.inertia, strict=True)
        found += [Row(index, name, one, of, f"{shape.body} inertia") for name, one, of in moments if one]
        terms = {one.name: one for one in shape_terms(shape, table.density)}
        shared = [name for name in table.values if name in terms]
        found += [Row(index, name, table.values[name], terms[name].value, terms[name].kind) for name in shared]
    return found


def factor_of(rows: Sequence[Row]) -> float:
    """Return the factor that numbers of a kind give, widened: the root mean square of their log ratios."""
    setting = [row for row in rows if row.name not in TABLES[row.table].set_aside]
    return exp(MARGIN * sqrt(sum(row.log_ratio**2 for row in setting) / len(setting)))


def without_vehicle(row: Row, rows: Sequence[Row]) -> float:
    """Return the factor that the other vehicles give for a number; the two configurations of one vehicle are one."""
    return factor_of([one for one in rows if one.kind == row.kind and one.family != row.family])


def numbers_of(rows: Sequence[Row]) -> dict[str, Any]:
    """Return rows, and how many of them lie inside 95 %, by the stated factors and by those of the other vehicles."""
    inside = [row.is_inside(QUALITIES[row.kind].factor) for row in rows]
    held = [row.is_inside(without_vehicle(row, rows)) for row in rows]
    share = {"of": len(rows), "inside": sum(inside), "inside by the other vehicles": sum(held)}
    vehicles = {row.vehicle for row in rows}
    return {
        "vehicles": len(vehicles),
        **share,
        "percent": round(100 * sum(inside) / len(rows), 1),
        "percent by the other vehicles": round(100 * sum(held) / len(rows), 1),
        "factors": {kind: one.factor for kind, one in QUALITIES.items()},
        "rows": [
            [*row[:2], *(float(f"{one:.4g}") for one in row[2:4]), row.kind, int(stated), int(others)]
            for row, stated, others in zip(rows, inside, held, strict=True)
        ],
    }


def tables(found: dict[str, Any]) -> str:
    """Return the tables of the page."""
    rows = [(Row(*one[:5]), bool(one[5]), bool(one[6])) for one in found["rows"]]
    lines = [
        f"{found['inside']} of {found['of']} published numbers of {found['vehicles']} vehicles lie inside the 95 % prior: "
        f"{found['percent']} %. By factors from the other vehicles only it is {found['inside by the other vehicles']}: "
        f"{found['percent by the other vehicles']} %.",
        "",
        "## By kind",
        "",
        "| number | factor | by the rule | published divided by expected, mean | inside 95 % | by the other vehicles |",
        "|---|---|---|---|---|---|",
    ]
    for kind, factor in found["factors"].items():
        of = [one for one in rows if one[0].kind == kind]
        mean = exp(float(np.mean([row.log_ratio for row, *_ in of])))
        counts = [f"{sum(bool(one[place]) for one in of)} of {len(of)}" for place in (1, 2)]
        lines.append(
            f"| {kind} | {factor:g} | {factor_of([row for row, *_ in of]):.2f} | {mean:.2f} | {counts[0]} | {counts[1]} |"
        )
    lines += [
        "",
        "## By table",
        "",
        "| vehicle | coefficients | lengths | inside 95 % | by the other vehicles | no prior |",
        "|---|---|---|---|---|---|",
    ]
    for index, table in enumerate(TABLES):
        of = [one for one in rows if one[0].table == index]
        counts = [f"{sum(bool(one[place]) for one in of)} of {len(of)}" for place in (1, 2)]
        damping = [name for name in table.values if _is_of_motion(name) and name not in {row.name for row, *_ in of}]
        absent = ", ".join(f"`{name}`" for name in damping) or "–"
        lines.append(f"| {table.vehicle} | {table.source} | {table.lengths} | {counts[0]} | {counts[1]} | {absent} |")
    lines += ["", "## Tables that disagree", "", *_disagreements([row for row, *_ in rows])]
    lines += [
        "",
        "## Every number",
        "",
        "| vehicle | number | published | from the shape | 95 % of the prior | inside |",
        "|---|---|---|---|---|---|",
    ]
    for row, inside, _ in rows:
        ends = row.ends(found["factors"][row.kind])
        lines.append(
            f"| {row.vehicle} | `{row.name}` | {row.published:.3g} | {row.expected:.3g} | {ends[0]:.3g} to {ends[1]:.3g} | "
            f"{'yes' if inside else '**no**'} |"
        )
    return "\n".join(lines) + "\n"


def _is_of_motion(name: str) -> bool:
    """Return whether a coefficient is an added mass or a drag of its axis, of which the shape may give a prior."""
    axis, _, rest = name.partition("_")
    rate = dict(zip("XYZKMN", "uvwpqr", strict=True)).get(axis)
    return rest in (f"{rate}dot", rate, f"{rate}abs{rate}")


def _disagreements(rows: Sequence[Row]) -> list[str]:
    """Return the coefficients that two tables of a vehicle have, in any configuration."""
    lines = ["| vehicle | coefficient | first table | second table | ratio |"]
    lines += ["|---|---|---|---|---|"]
    for one in rows:
        for other in rows:
            if one.family == other.family and one.name == other.name and one.table < other.table:
                larger = exp(abs(log(one.published / other.published)))
                values = f"{one.published:.3g} | {other.published:.3g}"
                lines.append(f"| {one.vehicle}, {other.vehicle} | `{one.name}` | {values} | {larger:.1f} |")
    return lines


if __name__ == "__main__":
    study_numbers.keep("shapes", numbers_of(all_rows()))
    study_numbers.show("shapes", tables(study_numbers.kept("shapes")))
