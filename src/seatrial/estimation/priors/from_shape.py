"""Priors of coefficients from the outer shape of a vehicle: log-normal with a factor of error."""

from dataclasses import dataclass
from pathlib import Path

from seatrial.core.coefficients import CoefficientName
from seatrial.core.result_table import aligned, text_html
from seatrial.estimation.priors.normal import LogNormal
from seatrial.vehicles.shape import COMPARED, QUALITIES, SEAWATER, Shape, shape_terms, vehicle_shape

FARTHEST = 1.5  # Times by which a vehicle may be slenderer or stouter than those compared, without a doubt


@dataclass(frozen=True)
class ShapePriors:
    """Estimates of a vehicle from its shape.

    Attributes:
        shape: with the volume, m^3, and the moments of inertia, kg m^2.
        priors: of the coefficients by name, SI; 95 % of a log-normal lie within the square of its factor.
        sources: formula of each coefficient.
    """

    shape: Shape
    priors: dict[str, LogNormal]
    sources: dict[str, str]

    @property
    def doubt(self) -> str:
        """Say so if the shape is not like those from which the factors of error follow; else empty."""
        (least, most), body, ratio = COMPARED[self.shape.body], self.shape.body, self.shape.slenderness
        if least / FARTHEST <= ratio <= FARTHEST * most:
            return ""
        return (
            f"the length is {ratio:.3g} times the root of beam times height. The factors of error follow from vehicles in a {body} of "
            f"{least:g} to {most:g} (docs/dev/shapes.md), so raise them here"
        )

    def __repr__(self) -> str:
        """Print inertia and priors with their sources, and whether they are in doubt."""
        quality = QUALITIES[f"{self.shape.body} inertia"]
        rows = [("", "median", "unit", "factor", "source")]
        for axis, moment in zip("xyz", self.shape.inertia, strict=True):
            rows.append((f"I_{2 * axis}", f"{moment:.3g}", "kg m^2", f"{quality.factor:g}", quality.source))
        for name, prior in self.priors.items():
            rows.append(
                (name, f"{prior.median:.3g}", CoefficientName.parse(name).unit, f"{prior.factor:g}", self.sources[name])
            )
        return "\n".join([*aligned(rows, left=(0, 2, 4)), *filter(None, [self.doubt])])

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

    Fins, thrusters and lift are not modelled: a round hull has no term of roll, and no shape has terms such as `Y_uv`.

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
    lengths = {"length": length, "diameter": diameter, "beam": beam, "height": height, "nose": nose, "tail": tail}
    shape = vehicle_shape(form, mass, {name: one for name, one in lengths.items() if one is not None}, mesh)
    priors, sources = {}, {}
    for name, value, kind in shape_terms(shape, density):
        factor, sources[name] = QUALITIES[kind]
        priors[name] = LogNormal(value, factor)
    return ShapePriors(shape, priors, sources)
