"""Rows of the gas: filaments in the room, and slices on the map."""

import numpy as np
import rerun as rr

from gslcosim.contract.messages import ConcentrationSlice, FilamentCloud
from gslcosim.scenario import Scenario
from gslcosim_services.recorder.colors import GasScale, gas_colors
from gslcosim_services.recorder.rows.archetypes import Splats
from gslcosim_services.recorder.rows.columns import RecordingRows
from gslcosim_services.recorder.scene import GAS_COLORMAP, image_format, slice_height_m
from gslcosim_services.recorder.stream_table import FILAMENTS, SLICES

# A snapshot draws at most this many filaments, evenly chosen and the more opaque, so that files stay small.
MAX_FILAMENTS = 3000
# Peak opacity of a newborn filament; chosen so that a plume of some hundred is visible and transparent.
BIRTH_OPACITY = 0.2


class GasRows:
    """Filaments as Gaussian puffs with their own standard deviation, and horizontal slices as levels of `GasScale`.

    A filament's colour is the mixing ratio at its centre, ppm0 (sigma0 / sigma)^3; its peak opacity goes with the
    amount of gas along a line of sight through the centre, (sigma0 / sigma)^2 (our derivation: the integral of a
    Gaussian puff of constant mass along a line falls with sigma^-2). `ppm0` and `sigma0` are those of the scenario's
    first source.
    """

    def __init__(self, rows: RecordingRows, scenario: Scenario) -> None:
        self._rows = rows
        self._source = scenario.gas.sources[0]
        self._scale = GasScale.of(scenario)
        self._placed: set[str] = set()
        # Packed as 0xRRGGBB00, which Rerun takes with the opacity and without a check of every colour.
        self._colors = gas_colors().astype(np.uint32) @ np.array([1 << 24, 1 << 16, 1 << 8], dtype=np.uint32)

    def add(self, tick: int, cloud: FilamentCloud) -> None:
        """Append the filaments and slices of a tick."""
        stride = max(1, -(-cloud.sigma_m.shape[0] // MAX_FILAMENTS))
        centres_m = np.ascontiguousarray(cloud.position_world_m.to_array()[::stride], dtype=np.float32)
        sigmas_m = cloud.sigma_m.to_array()[::stride]
        shrink = np.float32(self._source.sigma_m) / np.maximum(sigmas_m, np.float32(self._source.sigma_m))
        levels = self._scale.levels(self._source.ppm * shrink**3)
        alpha = np.clip(np.float64(BIRTH_OPACITY * 255 * stride) * shrink**2, 2, 255)
        rgba = self._colors[levels] | alpha.astype(np.uint32)
        self._rows.of(FILAMENTS).add(tick, Splats(centres_m, sigmas_m.astype(np.float32), rgba))
        for each in cloud.slices:
            self._add_slice(tick, each)

    def _add_slice(self, tick: int, item: ConcentrationSlice) -> None:
        rows = self._rows.of(SLICES, gas=item.gas)
        if item.gas not in self._placed:
            self._placed.add(item.gas)
            place = rr.GridMap.from_fields(
                format=image_format(*item.mixing_ratio_ppm.shape),
                colormap=GAS_COLORMAP,
                cell_size=item.cell_m,
                translation=(*item.origin_m, slice_height_m(item.height_m)),
            )
            self._rows.file.draw(rows.entity, place)
        # Rows of a picture run from the far side (largest y) to the near one.
        rows.add(tick, self._scale.levels(item.mixing_ratio_ppm.to_array()).T[::-1].ravel())
