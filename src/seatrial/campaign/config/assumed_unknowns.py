"""What a campaign estimates beside the coefficients: the unknowns that [estimation] and stated priors ask for."""

from collections.abc import Callable, Collection, Sequence

from seatrial.campaign.config.schema import EstimationTable
from seatrial.core.errors import InputError
from seatrial.core.usual_priors import SIZE_PRIOR, TIME_PRIOR
from seatrial.estimation.posterior.filter_error import process_name
from seatrial.estimation.posterior.output_error import spread_name
from seatrial.estimation.posterior.unknowns import Unknown, may_vary
from seatrial.estimation.simulation.delayed_control import DELAY
from seatrial.estimation.simulation.disturbance import AXES, disturbance_name, disturbance_time_name
from seatrial.estimation.simulation.simulator import CURRENT
from seatrial.vehicles.model import VehicleModel


def assumed_unknowns(estimation: EstimationTable, model: VehicleModel, stated: Collection[str]) -> set[str]:
    """Return the names of the unknowns that [estimation] and stated priors ask for beside those of the vehicle and the sensors.

    Args:
        estimation: assumptions of the fit.
        model: vehicle.
        stated: names that have a prior in the file, among which a delay, disturbances and process noise beside them may be.
    """
    names = {spread_name(one.name) for one in varying(estimation, model)}
    names |= {DELAY} & set(stated)
    if estimation.current != "none":
        names.add(CURRENT)
    if estimation.likelihood == "filter-error":
        process = {process_name(state) for state in model.states}
        disturbed = {name for name in stated if name.startswith(disturbance_name(""))}
        names |= disturbed | (process & set(stated) if disturbed else process)
    return names


def check_disturbances(
    stated: Collection[str], likelihood: str, model: VehicleModel, where: Callable[[str], str]
) -> None:
    """Check that disturbances that have a prior lie on axes that move, and that the likelihood knows them.

    Args:
        stated: names that have a prior in the file.
        likelihood: of the campaign.
        model: vehicle of all terms.
        where: names a key of the file.

    Raises:
        InputError: the first disturbance that cannot be.
    """
    for name in stated:
        if not name.startswith(disturbance_name("")):
            continue
        axis = name.removeprefix(disturbance_time_name("")).removeprefix(disturbance_name(""))
        if axis not in model.disturbance_axes:
            raise InputError(
                where(f"prior.{name}"),
                found=f"a disturbance on the axis {axis}, which does not move" if axis in tuple(AXES) else f'"{axis}"',
                expected="an axis that moves: " + (", ".join(model.disturbance_axes) or "none of this vehicle"),
                remedy="leave it out, or let the vehicle move along it",
            )
        if likelihood != "filter-error":
            raise InputError(
                where(f"prior.{name}"),
                found=f'a disturbance with estimation.likelihood = "{likelihood}"',
                expected="a likelihood that integrates it out",
                remedy='set estimation.likelihood = "filter-error" and residuals = "white"',
            )


def varying(estimation: EstimationTable, model: VehicleModel) -> tuple[Unknown, ...]:
    """Return the coefficients and other unknowns of a model that vary between trials."""
    return tuple(one for one in may_vary(model) if one.name in estimation.varying)


def no_unknown_prior(where: Callable[[str], str], missing: Sequence[Unknown]) -> InputError:
    """Return the error of unknowns for which no prior is stated.

    Args:
        where: names a key of the file.
        missing: all of them.
    """
    reasons = dict.fromkeys(f"{one.why} ({_asking_key(one)})" for one in missing if one.why)
    return InputError(
        where(f"prior.{missing[0].name}"),
        found=f"nothing, though {', and '.join(reasons)}" if reasons else "nothing",
        expected="a prior of " + ", and of ".join(f"{one.name}, SI unit {one.unit}" for one in missing),
        remedy="add "
        + "; and ".join(f"a section [prior.{one.name}], for example with {_example(one)}" for one in missing),
    )


def _asking_key(one: Unknown) -> str:
    """Return the key of the file by which an unknown is asked for."""
    kind, _, signal = one.name.partition("_")
    if kind in ("bias", "lag"):
        return f"sensors.{signal}.{kind}"
    keys = {"spread": "varying", "current": "current", "process": "likelihood"}
    return f"prior.{one.name}" if kind == "disturbance" else f"estimation.{keys.get(kind, 'residuals')}"


def _example(one: Unknown) -> str:
    """Return the keys of a prior that suits many vehicles."""
    kind = one.name.partition("_")[0]
    if one.signed:
        return 'distribution = "normal", mean = 0.0 and sd = 0.2'
    if kind == "spread":
        return 'distribution = "half-normal", lower = 0.0 and scale = the difference between trials that you expect'
    if kind == "lag":
        return 'distribution = "half-normal", scale = 1.0 and lower = 0.0'
    if one.unit == "s":
        return TIME_PRIOR
    return SIZE_PRIOR
