from collections.abc import Callable

import numpy as np
import pytest

from gslcosim.environment.model import Environment, Grid, WindFrames
from gslcosim_services.fields.filament.plume import FilamentPlume, GasSource, filament_amount_mol
from gslcosim_services.fields.filament.release import ConstantRelease


@pytest.fixture
def air() -> Callable[..., Environment]:
    """Build a room from an occupancy grid (default: 5 x 4 x 3 m of free air) and one wind velocity for each frame."""

    def build(*, occupancy=None, winds_m_s=((0.0, 0.0, 0.0),), cell_m=0.25, origin_m=(0.0, 0.0, 0.0), period_s=1.0):
        cells = np.zeros((20, 16, 12), np.uint8) if occupancy is None else occupancy
        velocity_m_s = np.empty((len(winds_m_s), *cells.shape, 3), np.float32)
        velocity_m_s[:] = np.array(winds_m_s, np.float32)[:, None, None, None, :]
        return Environment(
            name="air",
            grid=Grid(origin_m=origin_m, cell_m=cell_m, shape=cells.shape),
            occupancy=cells,
            wind=WindFrames(velocity_m_s=velocity_m_s, period_s=period_s),
            boxes=(),
            openings=(),
            content_hash="air",
        )

    return build


@pytest.fixture
def make_source() -> Callable[..., GasSource]:
    """Build a source; by default 10 filaments a second of 10 ppm and 0.1 m."""

    def build(position_m=(2.0, 2.0, 1.0), *, rate=10.0, ppm=10.0, sigma_m=0.1, gas_index=0, **more):
        return GasSource(
            **{
                "position_world_m": position_m,
                "release": ConstantRelease(filaments_per_s=rate),
                "sigma_m": sigma_m,
                "amount_mol": filament_amount_mol(ppm, sigma_m),
                "gas_index": gas_index,
                **more,
            }
        )

    return build


@pytest.fixture
def make_plume(air, make_source) -> Callable[..., FilamentPlume]:
    """Build a plume; by default one source in still air."""

    def build(environment=None, sources=None, *, step_s=0.1, growth_m2_s=0.001, diffusivity_m2_s=0.002, seed=1, **more):
        return FilamentPlume(
            environment or air(),
            sources or (make_source(),),
            step_s=step_s,
            growth_m2_s=growth_m2_s,
            diffusivity_m2_s=diffusivity_m2_s,
            seed=seed,
            **more,
        )

    return build
