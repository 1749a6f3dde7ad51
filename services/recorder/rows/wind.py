"""Rows of wind: arrows in the layer of the concentration slice, thinned so that each can be seen."""

from collections.abc import Mapping

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gslcosim.environment.model import Cell, Environment, EnvironmentVariant
from gslcosim_services.recorder import colors
from gslcosim_services.recorder.recording_file import RecordingFile

ARROWS_PER_SIDE = 15
# The wind a grid spacing stands for, as a percentile of the speeds of all arrows and frames: jets at inlets are few
# and would make all other arrows dots.
REFERENCE_PERCENTILE = 80
REFERENCE_LENGTH_SPACINGS = 0.9
MAX_LENGTH_SPACINGS = 1.3
ARROW_RADIUS_SPACINGS = 0.04


class WindLayer:
    """The arrows of one layer of an environment's wind.

    Lengths are in proportion to the speed, `REFERENCE_LENGTH_SPACINGS` at the reference speed, and at most
    `MAX_LENGTH_SPACINGS`.
    """

    def __init__(self, environment: Environment, height_m: float, *, like: "WindLayer | None" = None) -> None:
        """Look at a layer.

        Args:
            environment: Room and wind.
            height_m: At which height [m].
            like: Whose scale the arrows have; absent: one of their own.
        """
        grid = environment.grid
        layer = min(max(int((height_m - grid.origin_m[2]) / grid.cell_m), 0), grid.shape[2] - 1)
        stride = max(1, round(max(grid.shape[:2]) / ARROWS_PER_SIDE))
        axes = [np.arange(stride // 2, n, stride) for n in grid.shape[:2]]
        i, j = (index.ravel() for index in np.meshgrid(*axes, indexing="ij"))
        is_air = environment.occupancy[i, j, layer] != Cell.SOLID
        cells = np.column_stack([i[is_air], j[is_air], np.full(int(is_air.sum()), layer)])
        self.wind = environment.wind
        self.spacing_m = stride * grid.cell_m
        # In the middle of the square that the arrow stands for, so that those at the walls do not point through them.
        middles = np.array([stride / 2, stride / 2, 0.5]) - np.array([stride // 2, stride // 2, 0])
        self._centres_m = np.array(grid.origin_m) + (cells + middles) * grid.cell_m
        # (t, n, 3), copied: it is small, and the frames may be a mapped file.
        winds_m_s = np.asarray(self.wind.velocity_m_s[:, cells[:, 0], cells[:, 1], layer], dtype=np.float64)
        speeds_m_s = np.linalg.norm(winds_m_s, axis=-1)
        reference_m_s = float(np.percentile(speeds_m_s, REFERENCE_PERCENTILE)) if speeds_m_s.size else 0.0
        own_m_per_m_s = REFERENCE_LENGTH_SPACINGS * self.spacing_m / reference_m_s if reference_m_s > 0 else 0.0
        self.m_per_m_s = m_per_m_s = own_m_per_m_s if like is None or not like.m_per_m_s else like.m_per_m_s
        lengths_m = speeds_m_s * m_per_m_s
        shorten = np.minimum(1.0, MAX_LENGTH_SPACINGS * self.spacing_m / np.maximum(lengths_m, 1e-9))
        self._vectors_m = winds_m_s * (m_per_m_s * shorten)[..., None]

    @property
    def is_steady(self) -> bool:
        """True where the wind has one frame."""
        return self.wind.velocity_m_s.shape[0] == 1

    @property
    def n_arrows(self) -> int:
        """Number of arrows."""
        return len(self._centres_m)

    def arrows_m(self, frame: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the (n, 3) origins and vectors of a frame's arrows, centred on their cells, world frame [m]."""
        vectors_m = self._vectors_m[frame]
        return (self._centres_m - vectors_m / 2).astype(np.float32), vectors_m.astype(np.float32)

    def draw(self, file: RecordingFile, entity: str, *, is_one_of_many: bool = False) -> None:
        """Draw what all frames share; steady wind as a whole, where it is the only one."""
        is_steady = self.is_steady and not is_one_of_many
        origins_m, vectors_m = self.arrows_m(0) if is_steady else (None, None)
        radius_m = ARROW_RADIUS_SPACINGS * self.spacing_m
        arrows = rr.Arrows3D.from_fields(origins=origins_m, vectors=vectors_m, colors=[colors.WIND], radii=[radius_m])
        file.draw(entity, arrows)


class WindRows:
    """The arrows over time: a row wherever the frame of the wind or the room changes; none where all is steady.

    Args:
        entity: Where they are drawn.
        layer: Those at the start.
        later: Those of later rooms, by situation.
    """

    def __init__(
        self, entity: str, layer: WindLayer, later: Mapping[EnvironmentVariant, WindLayer] | None = None
    ) -> None:
        self._entity = entity
        self._layer = layer
        self._later = later or {}
        self._ticks: list[int] = []
        self._shown: list[tuple[WindLayer, int]] = []
        self._last: tuple[WindLayer, int] | None = None

    def draw(self, file: RecordingFile) -> None:
        """Draw what all rows share; the whole wind where it is always the same."""
        self._layer.draw(file, self._entity, is_one_of_many=bool(self._later))

    def add(self, tick: int, time_s: float, variant: EnvironmentVariant | None = None) -> None:
        """Take note of the wind's time [s] at the end of a tick, and of the situation then."""
        if self._layer.is_steady and not self._later:
            return
        layer = self._later.get(variant, self._layer) if variant is not None else self._layer
        shown = (layer, layer.wind.frame_at(time_s))
        if shown != self._last:
            self._last = shown
            self._ticks.append(tick)
            self._shown.append(shown)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if not self._ticks:
            return
        arrows_m = [layer.arrows_m(frame) for layer, frame in self._shown]
        columns = rr.Arrows3D.columns(
            origins=np.concatenate([origins_m for origins_m, _ in arrows_m]),
            vectors=np.concatenate([vectors_m for _, vectors_m in arrows_m]),
        )
        file.send(self._entity, self._ticks, columns.partition([layer.n_arrows for layer, _ in self._shown]))
        self._ticks, self._shown = [], []
