"""Where filaments are born: anywhere in a source's shape, with equal chance for equal volume."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.quantities import Vec3

ShapeKind = Literal["point", "box", "line", "sphere", "cylinder"]


@dataclass(frozen=True, kw_only=True)
class SourceShape:
    """The extent of a source about its position.

    `size_m` is the edges of the box, the vector from one end of the line to the other, or the edges of the box
    around the sphere or the upright cylinder, which may be an ellipsoid or have an elliptic base. A point has none.
    """

    kind: ShapeKind = "point"
    size_m: Vec3 = (0.0, 0.0, 0.0)

    def offsets_m(self, uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n, 3) offsets from the source's position [m], world axes.

        Args:
            uniforms: (n, 3) numbers from 0 to 1, three for each filament.
        """
        return _UNIT_OFFSETS[self.kind](uniforms) * np.array(self.size_m)


POINT = SourceShape()


def _in_point(uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.zeros_like(uniforms)


def _in_box(uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
    return uniforms - 0.5


def _on_line(uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.repeat(uniforms[:, :1] - 0.5, 3, axis=1)


# Of diameter 1: the radius grows as the cube root of the enclosed volume.
def _in_sphere(uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
    radius = 0.5 * np.cbrt(uniforms[:, 0])
    height = 2.0 * uniforms[:, 1] - 1.0
    across = np.sqrt(np.maximum(0.0, 1.0 - height**2))
    angle = 2.0 * np.pi * uniforms[:, 2]
    return radius[:, None] * np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)


# Of diameter and height 1: the radius grows as the square root of the enclosed area.
def _in_cylinder(uniforms: NDArray[np.float64]) -> NDArray[np.float64]:
    radius = 0.5 * np.sqrt(uniforms[:, 0])
    angle = 2.0 * np.pi * uniforms[:, 1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), uniforms[:, 2] - 0.5], axis=1)


_UNIT_OFFSETS = {
    "point": _in_point,
    "box": _in_box,
    "line": _on_line,
    "sphere": _in_sphere,
    "cylinder": _in_cylinder,
}
