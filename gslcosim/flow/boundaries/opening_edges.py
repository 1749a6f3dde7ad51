"""Edges of obstacles past which air sweeps into a gap, and the momentum that is carried past them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.flow.pressure import F32

Int = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class OpeningEdges:
    """Edges where the velocity `component` along a face is carried by the velocity `carrier` past the obstacle's lip.

    All indices are flat and padded, one for each of n edges.

    `near`: open face of `component` before the lip. `behind`: the one before that. `through`: face of `carrier`
    beside the lip. `target`: open face of `component` past the lip, one cell away from the obstacle.
    `away`: sign of `component` away from the obstacle. `inward`: sign of `carrier` past the lip.
    """

    component: int
    carrier: int
    near: Int
    behind: Int
    through: Int
    target: Int
    away: F32
    inward: F32


def find_opening_edges(air: NDArray[np.bool_], coefficients: tuple[F32, F32, F32]) -> tuple[OpeningEdges, ...]:
    """Return the lips of all obstacles, one list for each component and carrier that has any.

    Args:
        air: Padded cells, True is air.
        coefficients: Padded coefficients of the low-x, low-y and low-z faces: 0 closed, 1 open, 2 outlet.
    """
    pairs = ((component, carrier) for component in range(3) for carrier in range(3) if carrier != component)
    lists = (_lips_of(component, carrier, air, coefficients[component]) for component, carrier in pairs)
    return tuple(edges for edges in lists if edges.near.size)


def _lips_of(component: int, carrier: int, air: NDArray[np.bool_], coefficient: F32) -> OpeningEdges:
    strides = (air.shape[1] * air.shape[2], air.shape[2], 1)
    along, across = strides[component], strides[carrier]
    below = np.roll(air, 1, axis=component)
    parts = []
    for away in (1, -1):
        is_wall = (air & ~below if away > 0 else below & ~air) & (coefficient == 0)
        for side in (1, -1):
            is_lip = is_wall & (np.roll(coefficient, -side, axis=carrier) == 1)
            is_lip &= np.roll(coefficient, -away, axis=component) == 1
            wall = np.flatnonzero(is_lip)
            cell = wall if away > 0 else wall - along
            through = cell + across if side > 0 else cell
            signs = (np.full(wall.size, away), np.full(wall.size, -side))
            parts.append((wall + side * across, wall + 2 * side * across, through, wall + away * along, *signs))
    near, behind, through, target, away, inward = (np.concatenate(columns) for columns in zip(*parts))
    return OpeningEdges(
        component=component,
        carrier=carrier,
        near=near,
        behind=behind,
        through=through,
        target=target,
        away=away.astype(np.float32),
        inward=inward.astype(np.float32),
    )
