"""Rooms that the built-in solver was not tuned in, against pimpleFoam (k-epsilon, the same cells) after 5 s.

`pimplefoam/README.md` says how the fields were made; `tests/benchmarks/bench_solvers.py` makes them again.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from gslcosim.flow import Inlet, Outlet, Patch, solve_wind
from gslcosim_formats.solver_comparison import compare_winds

DATA = Path(__file__).parent / "pimplefoam"
END_TIME_S = 5.0
NU_M2_S = 1e-5  # AutoGDM+'s


@dataclass(frozen=True, kw_only=True)
class Room:
    """A room, and how alike both solvers must find its wind."""

    size_m: tuple[float, float, float]
    patches: tuple[Patch, ...]
    min_correlation: float
    max_rms_relative: float
    blocks: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...] = ()
    cell_m: float = 0.2

    def free(self):
        free = np.ones([round(length / self.cell_m) for length in self.size_m], bool)
        for low_m, high_m in self.blocks:
            free[tuple(slice(round(a / self.cell_m), round(b / self.cell_m)) for a, b in zip(low_m, high_m))] = False
        return free


ROOMS = {
    "channel_with_block": Room(
        size_m=(12, 4, 3),
        blocks=(((4, 1.2, 0), (5, 2.8, 1.6)),),
        patches=(
            Inlet(min_m=(0, 0, 0), max_m=(0, 4, 3), velocity_m_s=(1, 0, 0)),
            Outlet(min_m=(12, 0, 0), max_m=(12, 4, 3)),
        ),
        min_correlation=0.998,
        max_rms_relative=0.05,
    ),
    "two_inlets_two_outlets": Room(
        size_m=(10, 8, 3),
        blocks=(((4, 3, 0), (6, 5, 1)),),
        patches=(
            Inlet(min_m=(0, 1, 1), max_m=(0, 2, 2), velocity_m_s=(1, 0, 0)),
            Inlet(min_m=(7, 0, 0.4), max_m=(8, 0, 2), velocity_m_s=(0, 1, 0)),
            Outlet(min_m=(10, 6, 1), max_m=(10, 7.4, 2.4)),
            Outlet(min_m=(1, 8, 0), max_m=(2.4, 8, 2)),
        ),
        min_correlation=0.99,
        max_rms_relative=0.14,
    ),
    "outlet_in_the_ceiling": Room(
        size_m=(10, 8, 4),
        patches=(
            Inlet(min_m=(0, 3.2, 1.2), max_m=(0, 4.8, 2.4), velocity_m_s=(1.5, 0, 0)),
            Outlet(min_m=(7, 5, 4), max_m=(8.4, 6.4, 4)),
        ),
        min_correlation=0.99,
        max_rms_relative=0.12,
    ),
    # Doors five cells wide. Of a home with such doors both solvers' winds are 0.13 and 0.15 from those on cells of
    # 0.1 m, where they agree to 0.05: the difference is the grid's.
    "three_rooms_with_doors": Room(
        size_m=(10, 6, 2.6),
        blocks=(
            ((3.2, 0, 0), (3.4, 2.4, 2.6)),
            ((3.2, 3.4, 0), (3.4, 6, 2.6)),
            ((3.2, 2.4, 2), (3.4, 3.4, 2.6)),
            ((6.6, 0, 0), (6.8, 4.4, 2.6)),
            ((6.6, 5.4, 0), (6.8, 6, 2.6)),
            ((6.6, 4.4, 2), (6.8, 5.4, 2.6)),
            ((4.6, 0, 0), (5.4, 1.6, 1)),
        ),
        patches=(
            Inlet(min_m=(0, 0, 0), max_m=(0, 1.6, 1.6), velocity_m_s=(1, 0, 0)),
            Outlet(min_m=(10, 0.4, 0), max_m=(10, 2, 1.6)),
        ),
        min_correlation=0.985,
        max_rms_relative=0.17,
    ),
}


def pimplefoam_m_s(name):
    with np.load(DATA / f"{name}.npz") as data:
        return data["velocity_mm_s"] * 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ROOMS)
def test_the_wind_after_5_s_agrees(name):
    room = ROOMS[name]
    ours_m_s = solve_wind(room.free(), room.cell_m, room.patches, end_time_s=END_TIME_S, nu_m2_s=NU_M2_S)
    agreement = compare_winds(ours_m_s, pimplefoam_m_s(name), room.free())
    assert agreement.correlation >= room.min_correlation
    assert agreement.rms_relative <= room.max_rms_relative
