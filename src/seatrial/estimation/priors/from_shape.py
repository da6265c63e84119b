"""Priors of coefficients from the outer shape of a vehicle: log-normal about the value of the shape, with its factor of error."""

from dataclasses import dataclass
from pathlib import Path

from seatrial.core.coefficients import CoefficientName
from seatrial.core.result_table import aligned, text_html
from seatrial.estimation.priors.normal import LogNormal
from seatrial.vehicles.shape import QUALITIES, SEAWATER, Shape, shape_terms, vehicle_shape


@dataclass(frozen=True)
class ShapePriors:
    """Estimates of a vehicle from its shape.

    Attributes:
        shape: with the volume, m^3, and the moments of inertia, kg m^2.
        priors: of the coefficients by name, SI; 95 % of each lie within the square of its factor.
        sources: formula of each coefficient.
    """

    shape: Shape
    priors: dict[str, LogNormal]
    sources: dict[str, str]

    def __repr__(self) -> str:
        """Print inertia and priors with their sources."""
        inertia, quality = self.shape.inertia, QUALITIES[f"{self.shape.body} inertia"]
        rows = [("", "value", "unit", "factor", "source")]
        rows += [
            (f"I_{2 * axis}", f"{one:.3g}", "kg m^2", f"{quality.factor:g}", quality.source)
            for axis, one in zip("xyz", inertia, strict=True)
        ]
        rows += [
            (name, f"{one.median:.3g}", CoefficientName.parse(name).unit, f"{one.factor:g}", self.sources[name])
            for name, one in self.priors.items()
        ]
        return "\n".join(aligned(rows, left=(0, 2, 4)))

    _repr_html_ = text_html


def priors_from_shape(
    form: str,
    *,
    mass: float,
    length: float | None = None,
    diameter: float | None = None,
    beam: float | None = None,
    height: float | None = None,
    nose: float | None = None,
    tail: float | None = None,
    mesh: Path | str | None = None,
    density: float = SEAWATER,
) -> ShapePriors:
    """Estimate inertia, added mass, linear and quadratic drag of a vehicle from its shape, each with a factor of error.

    Fins, thrusters and lift are not modelled: a round hull has no term of roll, and no hull has terms such as `Y_uv`.

    Args:
        form: `torpedo` (elliptical nose, cylinder, parabolic tail), `ellipsoid`, or `box` (open-frame ROV).
        mass: of a hull with the water that it encloses, of a frame in air, kg.
        length: m.
        diameter: m; instead of `beam` and `height`.
        beam: m.
        height: m.
        nose: length of the nose of a torpedo, m; its beam if not given.
        tail: length of its tail, m; twice its beam if not given.
        mesh: STL file in m, x forward, y to starboard, z down, instead of the lengths; needs the extra `mesh`.
        density: of the water, kg/m^3.

    Raises:
        InputError: lengths that are missing or contradict each other, a mesh that is not closed, or a mass that gives a density which no
            vehicle has.
    """
    shape = vehicle_shape(
        form,
        mass=mass,
        length=length,
        diameter=diameter,
        beam=beam,
        height=height,
        nose=nose,
        tail=tail,
        mesh=mesh,
    )
    terms = shape_terms(shape, density)
    return ShapePriors(
        shape,
        {one.name: LogNormal(one.value, QUALITIES[one.kind].factor) for one in terms},
        {one.name: QUALITIES[one.kind].source for one in terms},
    )
