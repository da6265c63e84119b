"""Does a free-running ship give the coefficients of a towing tank? `SEATRIAL_DATA=... python docs/towing_tank.py`, one minute.

Sway and yaw of the KVLCC2 model are fitted to free-running zigzags by the campaign examples/ship_yaw, and its coefficients, with the one ±
of the campaign, are converted to the nondimensional form of the MMG standard method. They are compared with static captive tests of the
same hull, fitted here by least squares, and with the derivatives that Yasukawa and Yoshimura print (Journal of Marine Science and
Technology 20, 2015). Other structures and another reference of the sway speed show how much the answer depends on them. Writes the table in
docs/dev/towing_tank.md and the numbers in docs/dev/towing_tank.json.
"""

import csv
import gzip
import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import study_numbers

import seatrial as st
from seatrial.campaign.compute.shared_work import Study
from seatrial.campaign.inference.modes import structure_modes
from seatrial.campaign.inference.quick_estimates import stated_errors
from seatrial.core.files import write_text
from seatrial.estimation.diagnostics.error_budget import MIN_WEIGHT, follow_sources, half_width
from seatrial.vehicles.axis_equation import axis_equation

HERE = Path(__file__).parent
EXAMPLE = HERE.parent / "examples" / "ship_yaw" / "campaign.toml"
FOLDER = HERE.parent / "outputs" / "towing_tank"
WIDE_90 = 1.6449
"""Half width of an interval of 90 %, standard deviations."""
LENGTH, DRAUGHT, DENSITY, SPEED = 7.0, 0.455, 1000.0, 1.18
"""Of the model, m; of the water, kg/m^3; of approach, m/s."""
MASS, ARM, GYRADIUS = 3272.0, 0.2436, 0.25
"""Mass, kg; centre of gravity ahead of midship, m; radius of gyration about it, a share of the length."""
ADDED = {"x": 0.022, "y": 0.223, "z": 0.011}
"""Added masses and moment that Yasukawa and Yoshimura print, over 1/2 rho L^2 d and 1/2 rho L^4 d."""
HULL = {"Y_v": -0.315, "Y_r": 0.083, "N_v": -0.137, "N_r": -0.049}
"""Derivatives of the hull alone that they print, moments about midship; Y_r without the (m + m_x) u r of the equation of motion."""
AREA, RUDDER_LIFT, HULL_SHARE, HULL_ARM, RUDDER_ARM = 0.0539, 2.747, 0.312, -0.464, -0.5
"""Of the rudder: area, m^2; slope of its lift; a_H; x_H and x_R over the length."""
STRAIGHTENING, RATE_ARM = (0.395, 0.640), -0.710
"""gamma_R to either side, and l_R over the length."""
WAKE, DIAMETER, HEIGHT, EPSILON, KAPPA = 0.40, 0.216, 0.345, 1.09, 0.50
"""1 - u_P / u, of the propeller and the rudder; their diameter and height, m; and what the slipstream does."""
THRUST = (0.2931, -0.2753, -0.1385)
"""K_T as a polynomial of J."""
RATE = 10.23
"""Of the propeller in the runs, 1/s."""
DRIFTS = (3.0, 6.0, 9.0, 12.0)
"""Drift angles at which forces are compared, deg."""
NAMES = ("Y_v", "N_v", "Y_delta", "N_delta", "Y_r", "N_r")
RUNS = ("10_05", "20_05", "20_10_P", "35_05")
"""Zigzags that the example fits."""
LIMITS = (6.0, 10.0)
"""Drift and rudder angles of the captive runs that are fitted by straight lines, deg."""
WIDTH = {"v": 2.0, "r": 12.0}
"""Standard deviations of the priors of Y terms that the example has not, for each factor v and r of theirs; of N terms a fifth."""


class Variant(NamedTuple):
    """One way to get the coefficients.

    Attributes:
        words: in the table.
        terms: of the structure; those of the example if empty.
        ahead: how far ahead of midship the sway speed is taken to have been measured, m.
        runs: that are fitted; those of the example if empty.
    """

    words: str
    terms: str = ""
    ahead: float = 0.0
    runs: tuple[str, ...] = ()


VARIANTS = (
    Variant("the example as it stands"),
    Variant("sway speed taken as that of the centre of gravity", ahead=ARM),
    Variant("sway speed taken as measured 0.4 m aft of midship", ahead=-0.4),
    Variant("every linear force with the speed", "Y_uv Y_ur Y_vabsv Y_udelta_r N_uv N_ur N_vabsv N_udelta_r"),
    Variant(
        "the cubic terms of the MMG method",
        "Y_uv Y_ur Y_v3 Y_vvr Y_vrr Y_r3 Y_udelta_r N_uv N_ur N_v3 N_vvr N_vrr N_r3 N_udelta_r",
    ),
    Variant(
        "linear forces only, with the speed, the zigzags of 10 deg only",
        "Y_uv Y_ur Y_udelta_r N_uv N_ur N_udelta_r",
        runs=("10_05", "10_10_P"),
    ),
    Variant(
        "every linear force with the speed, the zigzags of 10 deg only",
        "Y_uv Y_ur Y_vabsv Y_udelta_r N_uv N_ur N_vabsv N_udelta_r",
        runs=("10_05", "10_10_P"),
    ),
)


class State(NamedTuple):
    """Speeds ahead and to the side at midship, m/s; yaw rate, rad/s; rudder angle, rad."""

    u: float = SPEED
    v: float = 0.0
    r: float = 0.0
    delta: float = 0.0


class Fit(NamedTuple):
    """Coefficients at the mode, and sets of sources of error with their probabilities, values and covariances.

    Attributes:
        names: of the terms.
        values: at the mode, SI.
        weight: probability of each set.
        means: of the terms in each set, SI.
        covs: their covariances.
        slope: sway speed over yaw rate times length in the fitted runs, by least squares.
        correlation: of both.
        drift: root mean square and largest drift angle, deg.
    """

    names: tuple[str, ...]
    values: np.ndarray
    weight: np.ndarray
    means: np.ndarray
    covs: np.ndarray
    slope: float
    correlation: float
    drift: tuple[float, float]


def main() -> None:
    """Fit, convert, compare, and write."""
    st.configure()
    tank, printed = captive(), {"hull": HULL, "hull and rudder": with_rudder()}
    found = {}
    for number, one in enumerate(VARIANTS):
        found[one.words] = compared(fitted(one, FOLDER / str(number)), one.ahead)
        print(one.words, json.dumps(found[one.words], indent=1), flush=True)
    late = max(abs(shift) for run in RUNS for shift in clock_shifts(run))
    results = {"free running": found, "captive": tank, "printed": printed, "largest shift of a clock, s": late}
    results |= {"less tank, in ±": less_tank(results)}
    study_numbers.keep("towing_tank", results)
    study_numbers.show("towing_tank", tables(results))


def fitted(about: Variant, folder: Path) -> Fit:
    """Return the fit of a campaign, with all errors as it states them."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "campaign.toml", campaign_text(about))
    campaign = st.load_campaign(folder)
    study = Study(campaign, (trials := st.get_trials(campaign)).fit)
    structure = campaign.structures[0]
    mode = structure_modes(study, trials).highest(structure)
    assert isinstance(mode, st.Mode), mode
    stated = stated_errors(campaign.estimation)
    model, members = follow_sources(study.posterior(structure), mode, stated)
    weight = np.exp([one.log_density - members[0].log_density for one in members])
    members, weight = members[: (kept := int((weight > MIN_WEIGHT).sum()))], weight[:kept] / weight[:kept].sum()
    members = model.with_force(stated.force, members)
    priors = {one.name: one.prior for one in study.posterior(structure).parameters}
    names = tuple(study.posterior(structure).names[i] for i in model.moving)
    sd, k = (
        np.array([priors[name].sd for name in names]),
        len(names),
    )  # their priors are normal about 0: x is value over sd
    v, r, u = (np.concatenate([one.channel(name) for one in trials.fit]) for name in "vru")
    drift = np.degrees(np.arctan2(v, u))
    return Fit(
        names,
        np.array([dict(zip(mode.names, mode.values, strict=True))[name] for name in names]),
        weight,
        np.stack([one.values[:k] * sd for one in members]),
        np.stack([one.cov[:k, :k] * np.outer(sd, sd) for one in members]),
        float(v @ r / (r @ r) / LENGTH),
        float(np.corrcoef(v, r)[0, 1]),
        (float(np.sqrt(np.mean(drift**2))), float(np.abs(drift).max())),
    )


def campaign_text(about: Variant) -> str:
    """Return the campaign of the example with the terms and the runs of a variant."""
    text = EXAMPLE.read_text()
    if about.runs:
        text = re.sub(r"(?m)^fit = .*$", "fit = " + json.dumps(about.runs), text)
        text = re.sub(r"(?m)^predict = .*$", 'predict = ["20_05"]', text)
    if not about.terms:
        return text
    terms = about.terms.split()
    known = re.findall(r"(?m)^(\w+) = \{ distribution.*$", text)
    lines = re.findall(r"(?m)^\w+ = \{ distribution.*$", text)
    prior = [line for name, line in zip(known, lines, strict=True) if name in terms or name[:2] in ("si", "ta")]
    for name in terms:
        if name not in known:
            motion = name[2:].replace("3", name[2] * 2).replace("abs", "")
            sd = np.prod([WIDTH.get(letter, 1.0) for letter in motion]) / (1.0 if name[0] == "Y" else 5.0)
            prior.append(f'{name} = {{ distribution = "normal", mean = 0.0, sd = {sd:g} }}')
    text = re.sub(r"(?m)^always = .*$", "always = " + json.dumps(terms), text)
    return re.sub(r"(?s)\[prior\].*?\[sensors\]", "[prior]\n" + "\n".join(prior) + "\n\n[sensors]", text)


def force_rows(fit: Fit, at: State, ahead: float, added: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return sway force and moment about midship, N and N m, as lines in the coefficients: shape (2, terms), and what they add to.

    A fitted term is an acceleration, of sway at the point at which its speed was measured. By the equations of motion of the MMG method,
    about midship,
    Y = (m + m_y) v' + x_G m r' + (m + m_x) u r, N = (I_zG + x_G^2 m + J_z) r' + x_G m (v' + u r).
    """
    v = at.v + ahead * at.r
    signals = {"u": at.u, "v": v, "r": at.r, "delta_r": at.delta}
    signals = {name: np.array([value]) for name, value in signals.items()}
    rates = np.zeros((2, len(fit.names)))
    for row, axis in enumerate("YN"):
        equation = axis_equation(axis, [name for name in fit.names if name[0] == axis])
        for term in equation.terms:
            rates[row, fit.names.index(term.text)] = equation.regressor(term, signals)[0]
    rates[0] -= ahead * rates[1]
    unit = 0.5 * DENSITY * LENGTH**2 * DRAUGHT
    sway, coupling = MASS + added * ADDED["y"] * unit, ARM * MASS
    yaw = MASS * ((GYRADIUS * LENGTH) ** 2 + ARM**2) + added * ADDED["z"] * unit * LENGTH**2
    turn = np.array([MASS + ADDED["x"] * unit, coupling]) * at.u * at.r
    return np.array([[sway, coupling], [coupling, yaw]]) @ rates, turn


def lines(fit: Fit, ahead: float, added: float = 1.0) -> dict[str, tuple[np.ndarray, float]]:
    """Return each nondimensional number as a line in the coefficients and a constant: derivatives, and forces at drift angles."""
    small, result = 1e-6, {}
    for name, other, scale in (
        ("v", State(v=small), SPEED),
        ("r", State(r=small), SPEED / LENGTH),
        ("delta", State(delta=small), 1.0),
    ):
        row, constant = force_rows(fit, other, ahead, added)
        for axis, place in (("Y", 0), ("N", 1)):
            size = scale / small / unit_of(axis)
            result[f"{axis}_{name}"] = row[place] * size, float(constant[place]) * size
    for drift in DRIFTS:
        angle = np.radians(drift)
        at = State(u=SPEED * np.cos(angle), v=SPEED * np.sin(angle))
        row, _ = force_rows(fit, at, ahead, added)
        for axis, place in (("Y", 0), ("N", 1)):
            result[f"{axis} at {drift:g} deg"] = row[place] / unit_of(axis), 0.0
    for axis in "YN":  # along the line on which the ship moved
        (v_row, _), (r_row, constant) = result[f"{axis}_v"], result[f"{axis}_r"]
        result[f"{axis} along"] = fit.slope * v_row + r_row, constant
    return result


def unit_of(axis: str) -> float:
    """Return 1/2 rho L d U^2, or that times L."""
    return 0.5 * DENSITY * LENGTH * DRAUGHT * SPEED**2 * (LENGTH if axis == "N" else 1.0)


def compared(fit: Fit, ahead: float) -> dict:
    """Return the nondimensional numbers with their one ±, and how they depend on each other and on the added masses."""
    of, more = lines(fit, ahead), lines(fit, ahead, 1.1)
    row = np.stack([line for line, _ in of.values()])
    values = row @ fit.values + [constant for _, constant in of.values()]
    shift, cov = (fit.means - fit.values) @ row.T, row @ fit.covs @ row.T
    sd = half_width(fit.weight, shift, np.sqrt(np.diagonal(cov, axis1=1, axis2=2))) / WIDE_90
    heavier = np.stack([line for line, _ in more.values()]) @ fit.values + [constant for _, constant in more.values()]
    names, whole = list(of), cov[0]
    pairs = {axis: [names.index(f"{axis}_v"), names.index(f"{axis}_r")] for axis in "YN"}
    return {
        "values": {name: [float(a), float(b)] for name, a, b in zip(names, values, sd, strict=True)},
        "with added masses 10 % larger": {name: float(x) for name, x in zip(names, heavier, strict=True)},
        "correlation of v and r derivatives": {
            axis: float(whole[a, b] / np.sqrt(whole[a, a] * whole[b, b])) for axis, (a, b) in pairs.items()
        },
        "sway speed over L r": fit.slope,
        "correlation of sway and yaw": fit.correlation,
        "drift angle": {"root mean square": fit.drift[0], "largest": fit.drift[1]},
    }


def captive() -> dict:
    """Return what the captive runs give, by least squares: straight lines through small angles, and v + v|v| as the example has it.

    The drift angle of the file is -v / U, its rudder has the sign of the free runs, and its forces are over 1/2 rho L^2 U^2.
    """
    path = Path(os.environ.get("SEATRIAL_DATA", "")) / "kvlcc2_captive" / "captive.csv"
    with path.open() as stream:
        every = {int(row[0]): [float(cell) for cell in row[1:11]] for row in [*csv.reader(stream)][1:]}
    rows = np.array([row for row in every.values() if abs(row[3] - 1.1702) < 1e-3])
    drift, rudder, per_draught = rows[:, 0], rows[:, 1], LENGTH / DRAUGHT
    v, delta = -np.radians(drift), np.radians(rudder)
    forces = {"Y": rows[:, 6] * per_draught, "N": rows[:, 7] * per_draught}
    by_rudder = (1 + HULL_SHARE) * rows[:, 9] * per_draught
    small = (np.abs(drift) <= LIMITS[0]) & (np.abs(rudder) <= LIMITS[1])
    middle = np.abs(drift) <= max(DRIFTS)
    result: dict = {"runs": len(every), "straight": {}, "bent": {}, "at drift": {}}
    for axis, force in forces.items():
        values, sds = least_squares([np.ones_like(v), v, delta], force, small)
        result["straight"] |= {f"{axis}_v": [values[1], sds[1]], f"{axis}_delta": [values[2], sds[2]]}
        values, sds = least_squares([np.ones_like(v), v, v * np.abs(v), delta], force, middle)
        result["bent"] |= {
            f"{axis}_v": [values[1], sds[1]],
            f"{axis}_vabsv": [values[2], sds[2]],
            f"{axis}_delta": [values[3], sds[3]],
        }
        for angle in DRIFTS:
            x = np.sin(np.radians(angle))
            result["at drift"][f"{axis} at {angle:g} deg"] = values[1] * x + values[2] * x**2
    values, sds = least_squares([np.ones_like(v), v, delta], forces["Y"] - by_rudder, small)
    result["straight"]["Y_v without the rudder"] = [values[1], sds[1]]
    result["runs in straight lines"] = int(small.sum())
    return result


def clock_shifts(run: str) -> list[float]:
    """Return by how much both velocities of a free run lag behind the differences of positions, and the yaw rate behind the heading, s."""
    path = Path(os.environ.get("SEATRIAL_DATA", "")) / "kvlcc2_hsva" / f"HSVA_CPMC_KVLCC2_Z_{run}.dat.gz"
    with gzip.open(path, "rt", encoding="cp1252") as stream:
        time, x, y, heading, north, east, rate = np.loadtxt(stream, skiprows=4, usecols=range(7)).T
    result = []
    for place, speed in ((x, north), (y, east), (heading, rate)):
        other = np.gradient(place, time)
        slope = np.gradient(other, time)
        result.append(float(slope @ (other - speed) / (slope @ slope)))
    return result


def least_squares(columns: Sequence[np.ndarray], y: np.ndarray, rows: np.ndarray) -> tuple[list[float], list[float]]:
    """Return coefficients and their standard deviations."""
    design = np.stack([column[rows] for column in columns], 1)
    values = np.linalg.lstsq(design, y[rows], rcond=None)[0]
    variance = np.sum((y[rows] - design @ values) ** 2) / (len(design) - design.shape[1])
    return values.tolist(), np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design))).tolist()


def with_rudder() -> dict[str, float]:
    """Return the printed derivatives of hull, rudder and propeller together on a straight course, the rudder's sign as in the runs."""
    inflow = 1 - WAKE
    advance = inflow * SPEED / (RATE * DIAMETER)
    thrust = np.polyval(THRUST[::-1], advance)
    share = DIAMETER / HEIGHT
    slipstream = 1 + KAPPA * (np.sqrt(1 + 8 * thrust / (np.pi * advance**2)) - 1)
    speed = EPSILON * inflow * np.sqrt(share * slipstream**2 + 1 - share)
    lift = AREA / (LENGTH * DRAUGHT) * speed**2 * RUDDER_LIFT
    force, moment = (1 + HULL_SHARE) * lift, (RUDDER_ARM + HULL_SHARE * HULL_ARM) * lift
    straightening = np.mean(STRAIGHTENING) / speed
    result = {
        "Y_v": HULL["Y_v"] - force * straightening,
        "Y_r": HULL["Y_r"] - force * straightening * RATE_ARM,
        "N_v": HULL["N_v"] - moment * straightening,
        "N_r": HULL["N_r"] - moment * straightening * RATE_ARM,
        "Y_delta": force,
        "N_delta": moment,
    }
    return {name: float(value) for name, value in result.items()}


def less_tank(results: Mapping[str, dict]) -> dict[str, float]:
    """Return by how many ± the example differs from the tank; a derivative without a captive one, from the printed one."""
    tank, values = results["captive"], next(iter(results["free running"].values()))["values"]
    true = {name: tank["straight"].get(name, [results["printed"]["hull and rudder"][name]])[0] for name in NAMES}
    true |= tank["at drift"]
    return {name: (values[name][0] - one) / values[name][1] for name, one in true.items()}


def tables(results: Mapping[str, dict]) -> str:
    """Return the tables of the page: derivatives, forces at drift angles, and the variants."""
    found, tank, printed = results["free running"], results["captive"], results["printed"]
    first = next(iter(found.values()))
    result = [
        "| | free running | captive, by least squares | MMG, hull and rudder | MMG, hull alone | free running less tank, in ± |",
        "|---|---|---|---|---|---|",
    ]
    both = printed["hull and rudder"]
    for name in NAMES:
        value, sd = first["values"][name]
        own = tank["straight"].get(name)
        cells = [f"{value:.3f} ± {sd:.3f}", f"{own[0]:.3f} ± {own[1]:.3f}" if own else "–", f"{both[name]:.3f}"]
        cells += [f"{HULL[name]:.3f}" if name in HULL else "–", f"{results['less tank, in ±'][name]:+.1f}"]
        result.append(f"| {name.replace('_', chr(39) + '_')} | " + " | ".join(cells) + " |")
    result += [
        "",
        "| force at a drift of | Y', free running | Y', captive | N', free running | N', captive |",
        "|---|---|---|---|---|",
    ]
    for drift in DRIFTS:
        cells = []
        for axis in "YN":
            value, sd = first["values"][f"{axis} at {drift:g} deg"]
            cells += [f"{value:.4f} ± {sd:.4f}", f"{tank['at drift'][f'{axis} at {drift:g} deg']:.4f}"]
        result.append(f"| {drift:g} deg | " + " | ".join(cells) + " |")
    heads = " | ".join(name.replace("_", "'_") for name in NAMES)
    result += ["", f"| fitted | {heads} |", "|" + "---|" * (1 + len(NAMES))]
    for words, one in found.items():
        result.append(
            f"| {words} | " + " | ".join("{:.3f} ± {:.3f}".format(*one["values"][name]) for name in NAMES) + " |"
        )
    return "\n".join(result) + "\n"


if __name__ == "__main__":
    main()
