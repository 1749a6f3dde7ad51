"""Panels of a film's picture: plan, chase view and time strip, and their text."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from gslcosim.base.frames import yaw_from_quaternion
from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Quaternion
from gslcosim.data.film.keyframes import FilmSegment
from gslcosim.data.run import RunData
from gslcosim.data.streams import RecordedSeries
from gslcosim.environment.model import Cell
from gslcosim_services.recorder import colors
from gslcosim_services.recorder.colors import GasScale, Rgb, agent_color


def draw_text(draw: ImageDraw.ImageDraw, place: tuple[float, float], text: str, color: Rgb, size_px: int) -> None:
    """Write a text whose upper left corner is at a place, in a size [pixels]."""
    draw.text(place, text, fill=color, font=_font(size_px))


@cache
def _font(size_px: int) -> Any:
    return ImageFont.load_default(size_px)


_MARGIN_PX = 12
_N_ARROWS = 14
_ARROW_S = 0.8
_DOT_PX = 5


class PlanPanel:
    """Draws the plan of a run at one time after another; times must not go back.

    The gas is that of the last snapshot before the time, in the layer of the map; doors are as they are at the time;
    wind is that of the room at its start, at the same height.

    Args:
        run: The run.
        size_px: Width and height.
    """

    def __init__(self, run: RunData, size_px: tuple[int, int]) -> None:
        self._run = run
        self._size_px = size_px
        grid = run.environment.grid
        length_m, width_m = grid.shape[0] * grid.cell_m, grid.shape[1] * grid.cell_m
        self._scale = min((size_px[0] - 2 * _MARGIN_PX) / length_m, (size_px[1] - 2 * _MARGIN_PX) / width_m)
        self._left = (size_px[0] - length_m * self._scale) / 2
        self._bottom = size_px[1] - (size_px[1] - width_m * self._scale) / 2
        self._origin_m = grid.origin_m
        self._room_px = (round(length_m * self._scale), round(width_m * self._scale))
        height_m = run.scenario.slice_height_m
        self._level = int(np.clip((height_m - grid.origin_m[2]) / grid.cell_m, 0, grid.shape[2] - 1))
        self._colors = {name: agent_color(i) for i, name in enumerate(run.agents)}
        self._shown_snapshot, self._room = -1, run.environment
        self._ground = self._with_gas(-1)
        # Tracks stay: they are drawn on as time passes.
        self._tracks = Image.new("RGBA", size_px, (0, 0, 0, 0))
        self._last_px: dict[str, tuple[float, float]] = {}

    def picture(self, time_s: float, poses: Mapping[str, tuple[Vec3, Quaternion]]) -> Image.Image:
        """Return the plan at a time [s], with the vehicles at their poses."""
        snapshot, room = self._snapshot(time_s), self._run.room_at(time_s)
        if snapshot != self._shown_snapshot or room is not self._room:
            self._shown_snapshot, self._room = snapshot, room
            self._ground = self._with_gas(snapshot)
        draw = ImageDraw.Draw(self._tracks)
        if not self._last_px:
            self._draw_past(draw, time_s)
        for agent, (place_m, _) in poses.items():
            here = self._pixel(place_m)
            if agent in self._last_px:
                draw.line((self._last_px[agent], here), fill=(*self._colors[agent], 255), width=2)
            self._last_px[agent] = here
        picture = self._ground.copy()
        picture.paste(self._tracks, (0, 0), self._tracks)
        over = ImageDraw.Draw(picture)
        self._draw_marks(over, time_s)
        for agent, (place_m, turn) in poses.items():
            _draw_vehicle(over, self._pixel(place_m), yaw_from_quaternion(turn), self._colors[agent])
        return picture

    def place_of(self, place_m: Vec3) -> tuple[int, int]:
        """Return where in the picture, right and down, a place in the room is drawn [m]."""
        x, y = self._pixel(place_m)
        return round(x), round(y)

    # What was run before the film begins.
    def _draw_past(self, draw: ImageDraw.ImageDraw, time_s: float) -> None:
        for agent, track in self._run.tracks.items():
            past = [self._pixel(place_m) for place_m in track.position_world_m[track.time_s <= time_s]]
            if len(past) > 1:
                draw.line(past, fill=(*self._colors[agent], 255), width=2)

    def _snapshot(self, time_s: float) -> int:
        slices = next(iter(self._run.gas_slices.values()), None)
        return -1 if slices is None else int(np.searchsorted(slices.time_s, time_s + 1e-9, side="right")) - 1

    def _with_gas(self, snapshot: int) -> Image.Image:
        picture = Image.new("RGB", self._size_px, colors.BACKGROUND)
        corner = (round(self._left), round(self._bottom - self._room_px[1]))
        slices = next(iter(self._run.gas_slices.values()), None)
        if slices is None or snapshot < 0:
            picture.paste(colors.MAP_FLOOR, (*corner, corner[0] + self._room_px[0], corner[1] + self._room_px[1]))
        else:
            levels = GasScale.of(self._run.scenario).levels(slices.mixing_ratio_ppm(snapshot))
            rgb = np.ascontiguousarray(colors.slice_colors()[levels.T[::-1]][..., :3])
            picture.paste(Image.fromarray(rgb).resize(self._room_px, Image.Resampling.BILINEAR), corner)
        is_solid = self._room.occupancy[:, :, self._level] == Cell.SOLID
        if is_solid.any():
            mask = Image.fromarray((is_solid.T[::-1] * 255).astype(np.uint8))
            picture.paste(colors.MAP_OBSTACLES, corner, mask.resize(self._room_px, Image.Resampling.NEAREST))
        draw = ImageDraw.Draw(picture)
        draw.rectangle(
            (corner[0] - 1, corner[1] - 1, corner[0] + self._room_px[0], corner[1] + self._room_px[1]),
            outline=colors.EDGES,
        )
        self._draw_wind(draw)
        for source in self._run.scenario.gas.sources:
            x, y = self._pixel(source.position_m)
            draw.ellipse((x - _DOT_PX, y - _DOT_PX, x + _DOT_PX, y + _DOT_PX), outline=colors.SOURCE, width=3)
        return picture

    # As far as the air goes in `_ARROW_S`.
    def _draw_wind(self, draw: ImageDraw.ImageDraw) -> None:
        grid = self._run.environment.grid
        wind_m_s = self._run.wind_m_s(0.0)[:, :, self._level, :2]
        step = max(1, max(grid.shape[:2]) // _N_ARROWS)
        for i in range(step // 2, grid.shape[0], step):
            for j in range(step // 2, grid.shape[1], step):
                u, v = (float(part) for part in wind_m_s[i, j])
                if math.hypot(u, v) < 1e-3:
                    continue
                tail_m = (self._origin_m[0] + (i + 0.5) * grid.cell_m, self._origin_m[1] + (j + 0.5) * grid.cell_m)
                tip = self._pixel((tail_m[0] + u * _ARROW_S, tail_m[1] + v * _ARROW_S, 0.0))
                draw.line((self._pixel((*tail_m, 0.0)), tip), fill=_dim(colors.WIND), width=1)
                draw.ellipse((tip[0] - 1, tip[1] - 1, tip[0] + 1, tip[1] + 1), fill=_dim(colors.WIND))

    def _draw_marks(self, draw: ImageDraw.ImageDraw, time_s: float) -> None:
        for agent, points in self._run.waypoints.items():
            i = int(np.searchsorted(points.time_s, time_s + 1e-9, side="right")) - 1
            if i >= 0:
                x, y = self._pixel(points.position_world_m[i])
                draw.line((x - 4, y, x + 4, y), fill=self._colors[agent])
                draw.line((x, y - 4, x, y + 4), fill=self._colors[agent])
        for agent, points in self._run.marks.items():
            for i in range(int(np.searchsorted(points.time_s, time_s + 1e-9, side="right"))):
                if points.label[i] in ("start", ""):
                    continue
                x, y = self._pixel(points.position_world_m[i])
                draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=self._colors[agent])
                draw_text(draw, (x + 6, y - 8), points.label[i], colors.READING, 13)

    def _pixel(self, place_m: "Vec3 | np.ndarray") -> tuple[float, float]:
        x_m, y_m = float(place_m[0]) - self._origin_m[0], float(place_m[1]) - self._origin_m[1]
        return self._left + x_m * self._scale, self._bottom - y_m * self._scale


def _dim(color: Rgb) -> Rgb:
    red, green, blue = ((channel + floor) // 2 for channel, floor in zip(color, colors.MAP_FLOOR, strict=True))
    return red, green, blue


def _draw_vehicle(draw: ImageDraw.ImageDraw, place: tuple[float, float], yaw_rad: float, color: Rgb) -> None:
    x, y = place
    draw.ellipse((x - _DOT_PX, y - _DOT_PX, x + _DOT_PX, y + _DOT_PX), fill=color, outline=(255, 255, 255))
    nose = (x + 2 * _DOT_PX * math.cos(yaw_rad), y - 2 * _DOT_PX * math.sin(yaw_rad))
    draw.line((place, nose), fill=(255, 255, 255), width=2)


_LABEL_PX = 150
_STRIP_MARGIN_PX = 10
# Of the words beside the curves, where there is room for it.
_TEXT_PX = 13


class StripPanel:
    """Draws two curves over the time of the film, with a cursor; the curves of one agent.

    Args:
        run: The run.
        agent: Whose curves they are.
        cut: What the film shows.
        size_px: Width and height.
    """

    def __init__(self, run: RunData, agent: str, cut: FilmSegment, size_px: tuple[int, int]) -> None:
        self._cut, self._size_px = cut, size_px
        color = agent_color(run.agents.index(agent))
        gas = next((one for one in run.samples if (one.agent, one.quantity) == (agent, "mixing_ratio")), None)
        reading = next((one for one in run.readings if (one.agent, one.quantity) == (agent, "response")), None)
        rows = [
            ("true gas [ppm]", gas, colors.READING),
            (f"{reading.sensor} [{reading.unit}]" if reading is not None else "", reading, color),
            ("distance [m]", run.figure(agent, "distance"), colors.SOURCE),
        ]
        self._rows = [(label, series, shade) for label, series, shade in rows if series is not None]
        self._top = min(28.0, 0.25 * size_px[1])
        self._row_height = (size_px[1] - self._top - 2) / max(len(self._rows), 1)
        self._text_px = max(8, round(min(_TEXT_PX, 0.75 * self._row_height)))
        self._ground = self._curves()

    def picture(self, time_s: float) -> Image.Image:
        """Return the strip at a time [s]."""
        picture = self._ground.copy()
        draw = ImageDraw.Draw(picture)
        x = self._x(time_s)
        draw.line((x, 0, x, self._size_px[1]), fill=(255, 255, 255))
        draw_text(draw, (_STRIP_MARGIN_PX, 2), f"{time_s:7.1f} s", (255, 255, 255), round(0.8 * self._top))
        draw_text(draw, (_STRIP_MARGIN_PX + 95, 4), f"x {self._cut.speed:g}", colors.EDGES, _TEXT_PX)
        for k, (_, series, shade) in enumerate(self._rows):
            i = max(int(np.searchsorted(series.time_s, time_s + 1e-9, side="right")) - 1, 0)
            top, height = self._row(k)
            value = _short(float(series.value[i]))
            draw_text(draw, (_STRIP_MARGIN_PX + 95, top + height / 2 - self._text_px / 2), value, shade, self._text_px)
        return picture

    def _row(self, k: int) -> tuple[float, float]:
        return self._top + k * self._row_height, self._row_height

    def _x(self, time_s: float) -> float:
        share = (time_s - self._cut.from_s) / max(self._cut.to_s - self._cut.from_s, 1e-9)
        return _LABEL_PX + share * (self._size_px[0] - _LABEL_PX - _STRIP_MARGIN_PX)

    def _curves(self) -> Image.Image:
        picture = Image.new("RGB", self._size_px, colors.BACKGROUND)
        draw = ImageDraw.Draw(picture)
        for k, (label, series, shade) in enumerate(self._rows):
            top, height = self._row(k)
            draw_text(draw, (_STRIP_MARGIN_PX, top + height / 2 - self._text_px / 2), label, shade, self._text_px)
            self._draw_curve(draw, series, shade, top + 3, height - 6)
        return picture

    def _draw_curve(
        self, draw: ImageDraw.ImageDraw, series: RecordedSeries, color: Rgb, top: float, height: float
    ) -> None:
        is_shown = (series.time_s >= self._cut.from_s) & (series.time_s <= self._cut.to_s)
        times_s, values = series.time_s[is_shown], series.value[is_shown]
        if len(values) < 2:
            return
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        share = (values - low) / (high - low) if high > low else np.full(len(values), 0.5)
        points = [(self._x(t), top + height * (1 - s)) for t, s in zip(times_s.tolist(), share.tolist(), strict=True)]
        draw.line(points, fill=color, width=1)


def _short(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
