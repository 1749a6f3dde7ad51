"""Gas that tests make up: filaments as they are, their source, and a plume that releases them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from built_rooms import build_air

from gslcosim.environment.model import Environment
from gslcosim_services.fields.filament.plume import FilamentPlume, Filaments, GasSource, filament_amount_mol
from gslcosim_services.fields.filament.release import ConstantRelease


def build_filaments(
    positions_m, sigmas_m, *, source_index=None, ppm: Sequence[float] = (10.0,), gas_index: Sequence[int] = (0,)
) -> Filaments:
    """Return filaments whose sources release them with 0.1 m and the given mixing ratios at the centre."""
    return Filaments(
        position_world_m=np.array(positions_m, float),
        sigma_m=np.array(sigmas_m, float),
        source_index=np.array([0] * len(positions_m) if source_index is None else source_index, np.int32),
        amount_mol=np.array([filament_amount_mol(value, 0.1) for value in ppm]),
        gas_index=np.array(gas_index, np.int32),
    )


def build_source(position_m=(2.0, 2.0, 1.0), *, rate=10.0, ppm=10.0, sigma_m=0.1, **more: Any) -> GasSource:
    """Return a source, by default of 10 filaments a second of 10 ppm and 0.1 m."""
    released = {"release": ConstantRelease(filaments_per_s=rate), "amount_mol": filament_amount_mol(ppm, sigma_m)}
    return GasSource(position_world_m=position_m, sigma_m=sigma_m, **{**released, **more})


def build_plume(
    room: Environment | None = None, sources: Sequence[GasSource] | None = None, *, step_s: float = 0.1, **more: Any
) -> FilamentPlume:
    """Return a plume, by default of one source in still air."""
    rates = {"growth_m2_s": 0.001, "diffusivity_m2_s": 0.002, "seed": 1}
    return FilamentPlume(room or build_air(), sources or (build_source(),), step_s=step_s, **{**rates, **more})
