"""Drag of a tether on the point of the vehicle where it is made fast.

    F = -(k_1 + k_2 |v_p|) v_p,    moment r x F,    v_p = v + omega x r, through the water

One drag for all directions. Length and weight of the tether, and water that moves otherwise along it, are not modelled.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from seatrial.numerics.array_module import array_module
from seatrial.numerics.rotations import cross, dot, times, total
from seatrial.vehicles.model import VehicleUnknown

TETHER = LINEAR, QUADRATIC = "tether_linear", "tether_quadratic"  # Names of what may be sought of one


@dataclass(frozen=True)
class Tether:
    """A tether; `whole_vehicle` checks it.

    Attributes:
        point: of attachment, from the body's origin, body axes, m.
        linear: k_1, kg/s, which is N s/m.
        quadratic: k_2, kg/m.
    """

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    linear: float = 0.0
    quadratic: float = 0.0

    @property
    def unknowns(self) -> tuple[VehicleUnknown, VehicleUnknown]:
        """What of it may be sought: both drags."""
        return (
            VehicleUnknown(LINEAR, "kg/s", r"k_{\mathrm{tether},1}", self.linear, signed=False),
            VehicleUnknown(QUADRATIC, "kg/m", r"k_{\mathrm{tether},2}", self.quadratic, signed=False),
        )

    def at(self, values: Mapping[str, float]) -> "Tether":
        """Return it with those drags that are among the values, SI."""
        return replace(self, linear=values.get(LINEAR, self.linear), quadratic=values.get(QUADRATIC, self.quadratic))

    @property
    def words(self) -> str:
        """All of it, for a reader."""
        at = ", ".join(f"{x:g}" for x in self.point)
        return f"tether drag of {self.linear:.4g} kg/s and {self.quadratic:.4g} kg/m at ({at}) m"

    @property
    def damping(self) -> Float[np.ndarray, "6 6"]:
        """Force and moment against a unit of each velocity where k_1 is 1 kg/s and k_2 is 0."""
        x, y, z = self.point
        moved = np.array([[1, 0, 0, 0, z, -y], [0, 1, 0, -z, 0, x], [0, 0, 1, y, -x, 0]], float)
        return moved.T @ moved

    def force(self, velocity: Sequence[Any], values: Mapping[str, Any] = MappingProxyType({})) -> tuple[Any, ...]:
        """Return force and moment on the body, N and N m.

        Args:
            velocity: u, v, w, p, q, r through the water, SI.
            values: those of `unknowns` to estimate, SI; the others are as stated.
        """
        turned = cross((velocity[3], velocity[4], velocity[5]), self.point)
        local = [total(parts) for parts in zip(velocity[:3], turned, strict=True)]
        # The root's derivative at 0 is taken for 0: the speed is multiplied by the velocity there.
        square = dot(local, local)
        xp = array_module(square)
        drag = total(
            (
                values.get(LINEAR, self.linear),
                times(
                    values.get(QUADRATIC, self.quadratic),
                    xp.where(square > 0, xp.sqrt(xp.where(square > 0, square, 1.0)), 0.0),
                ),
            )
        )
        x, y, z = (-times(drag, part) for part in local)
        return (x, y, z, *cross(self.point, (x, y, z)))
