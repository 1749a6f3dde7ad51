"""The knowledge that an agent is granted with its briefing, and the belief that it publishes. Since contract 1.2."""

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, StringConstraints

from gslcosim.contract.arrays import NumericArray
from gslcosim.contract.record import Record
from gslcosim.quantities import Vec3

MAX_BELIEF_CELLS = 65_536
# How far the sum of a belief's probabilities may be from 1: single precision over many cells.
BELIEF_SUM_TOLERANCE = 1e-3

ParameterScalar = bool | int | float | Annotated[str, StringConstraints(max_length=1000)]
# A parameter of a method: any scalar of YAML, or a list of them.
ParameterValue = ParameterScalar | Annotated[tuple[ParameterScalar, ...], Field(max_length=1000)]
CellSize = Annotated[float, Field(gt=0, le=1000)]


class KnownMap(Record):
    """The map of the room, for an agent that is granted it; part of `Briefing`. Since contract 1.2.

    `occupied` is uint8, 1 where a cell is solid and 0 where it is air, in equal cells of `cell_m` whose first one
    touches the corner `origin_m`; index order (x, y) or (x, y, z). A map with two axes is a horizontal slice: it has
    `height_m`, the height at which the room was cut.
    """

    origin_m: Vec3
    cell_m: CellSize
    occupied: NumericArray
    height_m: float | None = None


class NominalPlume(Record):
    """The nominal figures of the plume, for an agent that is granted them; part of `Briefing`. Since contract 1.2.

    A source releases `puffs_per_s`, together `release_ppm_m3_s` of gas: the integral of the mixing ratio [ppm] over
    all space grows by that much a second. A puff is born with the standard deviation `initial_sigma_m`, its variance
    grows by `growth_m2_s`, and its centre wanders with the eddy diffusivity `diffusivity_m2_s` on each axis.
    `wind_speed_m_s` is the nominal speed of the wind, at the inlet of a room. Where the source is, and how high, is
    not told.
    """

    release_ppm_m3_s: float
    puffs_per_s: float
    initial_sigma_m: float
    growth_m2_s: float
    diffusivity_m2_s: float
    wind_speed_m_s: float


def _check_probability(probability: NumericArray) -> NumericArray:
    if probability.dtype != "float32" or len(probability.shape) not in (2, 3):
        raise ValueError(f"expected float32 with 2 or 3 axes, was {probability.dtype} with {len(probability.shape)}")
    values = probability.to_array()
    if not 1 <= values.size <= MAX_BELIEF_CELLS:
        raise ValueError(f"expected 1 to {MAX_BELIEF_CELLS} cells, was {values.size}")
    if values.min() < 0:
        raise ValueError(f"expected probabilities that are not negative, was {values.min():g}")
    total = float(values.sum(dtype=np.float64))
    if abs(total - 1) > BELIEF_SUM_TOLERANCE:
        raise ValueError(f"expected probabilities whose sum is 1, was {total:.6g}")
    return probability


class Belief(Record):
    """Where an agent believes the source to be: a probability for each cell; part of `Command`. Since contract 1.2.

    `probability` is float32 of shape (nx, ny) or (nx, ny, nz), none negative, together 1 (within 0.001), at most
    65,536 cells of `cell_m`; the first cell touches the corner `origin_m`. A belief with two axes is about the place
    in the plane, whatever the height; its `origin_m` has the height at which the agent searches.
    At most one belief a second of simulated time is taken. It is judged and recorded; no other agent sees it.
    """

    origin_m: Vec3
    cell_m: CellSize
    probability: Annotated[NumericArray, AfterValidator(_check_probability)]
