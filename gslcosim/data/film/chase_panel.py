"""Chase view panel of a film: the vehicle in its environment from behind and above, with the gas around it."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Quaternion
from gslcosim.data.run import RunData
from gslcosim_services.cameras.free_camera import FreeCamera, project_points
from gslcosim_services.recorder import colors
from gslcosim_services.recorder.colors import GasScale

# Where the eye is: so far behind and so far above the vehicle, and so far from walls [m].
BEHIND_M, ABOVE_M, WALL_M = 2.2, 0.9, 0.25
# How fast it turns with the vehicle's way: the share of the turn that is left after a second of film.
_LAG_PER_S = 0.35
_LEAST_MOVE_M = 0.004
# Gas is drawn on a picture of this share of the size, and no nearer than this.
_COARSE = 6
_NEAR_M = 0.3
_OPACITY = 0.35


class ChasePanel:
    """Draws what somebody sees who follows one agent's vehicle; times must not go back.

    Gas is drawn over the picture, also where something solid is in front of it.

    Args:
        run: The run.
        agent: Who is followed.
        size_px: Width and height.
        frame_s: How long a frame is shown [s].

    Raises:
        ModelError: neither EGL nor OSMesa works here.
    """

    def __init__(self, run: RunData, agent: str, size_px: tuple[int, int], frame_s: float) -> None:
        self._run, self._agent, self._size_px = run, agent, size_px
        shades = [colors.agent_color(i) for i in range(len(run.agents))]
        self._onlooker = FreeCamera(run.scenario, run.environment, shades, *size_px)
        self._keep = _LAG_PER_S**frame_s
        self._heading: tuple[float, float] | None = None
        self._last_m: Vec3 | None = None
        self._scale = GasScale.of(run.scenario)
        self._gas_colors = colors.gas_colors()

    def picture(self, time_s: float, poses: Mapping[str, tuple[Vec3, Quaternion]]) -> Image.Image:
        """Return what is seen at a time [s] with the vehicles at their poses."""
        place_m, _ = poses[self._agent]
        eye_m = self._eye_m(place_m)
        pixels = self._onlooker.picture(poses, eye_m, place_m, self._run.closed_at(time_s))
        picture = Image.fromarray(np.ascontiguousarray(pixels))
        return self._with_gas(picture, time_s, eye_m, place_m)

    def close(self) -> None:
        """Give the driver's memory back."""
        self._onlooker.close()

    # Behind where it goes; at first towards the nearest source.
    def _eye_m(self, place_m: Vec3) -> Vec3:
        if self._heading is None:
            source_m = min((s.position_m for s in self._run.scenario.gas.sources), key=lambda s: math.dist(s, place_m))
            self._heading = _direction(source_m[0] - place_m[0], source_m[1] - place_m[1])
        elif self._last_m is not None:
            x_m, y_m = place_m[0] - self._last_m[0], place_m[1] - self._last_m[1]
            if math.hypot(x_m, y_m) > _LEAST_MOVE_M:
                to_x, to_y = _direction(x_m, y_m)
                x, y = self._heading
                self._heading = _direction(
                    self._keep * x + (1 - self._keep) * to_x, self._keep * y + (1 - self._keep) * to_y
                )
        self._last_m = place_m
        x, y = self._heading
        grid = self._run.environment.grid
        wanted_m = (place_m[0] - BEHIND_M * x, place_m[1] - BEHIND_M * y, place_m[2] + ABOVE_M)
        eye = [
            min(max(c, low + WALL_M), high - WALL_M)
            for c, low, high in zip(wanted_m, grid.origin_m, grid.max_m, strict=True)
        ]
        # From straight above there is no upright.
        if math.hypot(eye[0] - place_m[0], eye[1] - place_m[1]) < WALL_M:
            eye[0] += 2 * WALL_M
        return eye[0], eye[1], eye[2]

    def _with_gas(self, picture: Image.Image, time_s: float, eye_m: Vec3, looks_at_m: Vec3) -> Image.Image:
        cloud = self._run.filaments
        i = int(np.searchsorted(cloud.time_s, time_s + 1e-9, side="right")) - 1
        if i < 0:
            return picture
        centres_m, sigmas_m = cloud.snapshot(i)
        width_px, height_px = (side // _COARSE for side in self._size_px)
        places, ahead_m = project_points(centres_m, eye_m, looks_at_m, width_px, height_px)
        is_seen = (ahead_m > _NEAR_M) & (places >= 0).all(axis=1) & (places < (width_px, height_px)).all(axis=1)
        if not is_seen.any():
            return picture
        cells = places[is_seen].astype(np.int64)
        # Each filament as a spot of its share of the picture; a box of three cells three times is nearly a Gaussian.
        weight = np.minimum(sigmas_m[is_seen] * height_px / ahead_m[is_seen], 4.0) ** 2
        density = np.zeros((height_px, width_px))
        np.add.at(density, (cells[:, 1], cells[:, 0]), weight)
        density = _blurred(density)
        share = 1 - np.exp(-density * _OPACITY)
        levels = np.clip(share * (colors.N_LEVELS - 1), 0, colors.N_LEVELS - 1).astype(np.uint8)
        rgba = np.dstack([self._gas_colors[levels], (share * 200).astype(np.uint8)])
        veil = Image.fromarray(rgba).resize(self._size_px, Image.Resampling.BILINEAR)
        picture.paste(veil, (0, 0), veil)
        return picture


def _direction(x: float, y: float) -> tuple[float, float]:
    length = math.hypot(x, y)
    return (x / length, y / length) if length > 1e-9 else (1.0, 0.0)


def _blurred(density: NDArray[np.float64]) -> NDArray[np.float64]:
    for _ in range(4):
        for axis in (0, 1):
            density = (np.roll(density, 1, axis) + density + np.roll(density, -1, axis)) / 3
    return density
