"""Films of runs: the plan with gas and track, the vehicle in its environment, time and readings."""

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from gslcosim.base.errors import UsageError
from gslcosim.base.frames import yaw_from_quaternion
from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Quaternion
from gslcosim.environment.plan_view import PlanView
from gslcosim_data.free_camera import FreeCamera, project_points
from gslcosim_data.run import RunData
from gslcosim_data.streams import RecordedSeries, RecordedTrack
from gslcosim_formats.plan_pictures import PixelScale, PlanPainter
from gslcosim_services.recorder import colors
from gslcosim_services.recorder.colors import GasScale, Rgb, agent_color
from gslcosim_services.recorder.stream_table import DISTANCE, MIXING_RATIO, RESPONSE

FRAMES_PER_S = 25
# Where the eye is: so far behind and so far above the vehicle, and so far from walls [m].
BEHIND_M, ABOVE_M, WALL_M = 2.2, 0.9, 0.25
# How fast it turns with the vehicle's way: the share of the turn that is left after a second of film.
_LAG_PER_S = 0.35
_LEAST_MOVE_M = 0.004
# Gas is drawn on a picture of this share of the size, and no nearer than this.
_COARSE = 6
_NEAR_M = 0.3
_OPACITY = 0.35
_MARGIN_PX = 12
_N_ARROWS = 14
_DOT_PX = 5
_OPENING_PX = 4
_LABEL_PX = 150
_STRIP_MARGIN_PX = 10
# Of the words beside the curves, where there is room for it.
_TEXT_PX = 13
_STRIP_SHARE = 0.2
_TITLE_PX = 22
REMEDY = "pip install 'gslcosim-data[film]'"
FORMATS = (".mp4", ".gif", ".webp")
# Quality and effort of H.264; yuv420p is what every player shows.
_H264 = {"crf": "22", "preset": "veryfast"}
_COLOURS = 96
Frames = Iterable[NDArray[np.uint8]]


@dataclass(frozen=True, kw_only=True)
class FilmSegment:
    """A part of a run [s of simulated time], shown `speed` times as fast as it was."""

    from_s: float
    to_s: float
    speed: float

    @classmethod
    def of(cls, run: RunData, *, from_s: float | None, to_s: float | None, speed: float) -> "FilmSegment":
        """Return the cut of a run; what is absent is its beginning or its end."""
        end_s = max((float(track.time_s[-1]) for track in run.tracks.values() if len(track.time_s)), default=0.0)
        begin_s, stop_s = from_s or 0.0, end_s if to_s is None else min(to_s, end_s)
        if begin_s >= stop_s:
            raise UsageError(
                f"--from, --to: expected a part of the run, which ends at {end_s:g} s, was {begin_s:g} to "
                f"{stop_s if to_s is None else to_s:g} s."
            )
        return cls(from_s=begin_s, to_s=stop_s, speed=speed)

    @property
    def times_s(self) -> NDArray[np.float64]:
        """The simulated times of the frames [s]."""
        n_frames = max(1, math.floor((self.to_s - self.from_s) / self.speed * FRAMES_PER_S) + 1)
        return np.minimum(self.from_s + np.arange(n_frames) * self.speed / FRAMES_PER_S, self.to_s)


def interpolate_pose(track: RecordedTrack, time_s: float) -> tuple[Vec3, Quaternion]:
    """Return the pose of a vehicle at a time between ticks: on the straight line, and on the shortest turn."""
    i = int(np.clip(np.searchsorted(track.time_s, time_s, side="right") - 1, 0, len(track.time_s) - 1))
    k = min(i + 1, len(track.time_s) - 1)
    span_s = float(track.time_s[k] - track.time_s[i])
    share = min(max((time_s - float(track.time_s[i])) / span_s, 0.0), 1.0) if span_s > 0 else 0.0
    place_m = (1 - share) * track.position_world_m[i] + share * track.position_world_m[k]
    before, after = track.quaternion_wxyz[i], track.quaternion_wxyz[k]
    turn = (1 - share) * before + share * (after if before @ after >= 0 else -after)
    turn = turn / np.linalg.norm(turn)
    x_m, y_m, z_m = place_m.tolist()
    w, x, y, z = turn.tolist()
    return (x_m, y_m, z_m), (w, x, y, z)


class ChasePanel:
    """Draws what somebody sees who follows one agent's vehicle; times must not go back.

    Gas is drawn over the picture, also where something solid is in front of it.

    Args:
        run: The run.
        agent: Who is followed.
        size_px: Width and height.
        frame_s: How long a frame is shown [s].
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
        """Return the picture at a time [s] with the vehicles at their poses."""
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
        for _ in range(4):
            for axis in (0, 1):
                density = (np.roll(density, 1, axis) + density + np.roll(density, -1, axis)) / 3
        share = 1 - np.exp(-density * _OPACITY)
        levels = np.clip(share * (colors.N_LEVELS - 1), 0, colors.N_LEVELS - 1).astype(np.uint8)
        rgba = np.dstack([self._gas_colors[levels], (share * 200).astype(np.uint8)])
        veil = Image.fromarray(rgba).resize(self._size_px, Image.Resampling.BILINEAR)
        picture.paste(veil, (0, 0), veil)
        return picture


def _direction(x: float, y: float) -> tuple[float, float]:
    length = math.hypot(x, y)
    return (x / length, y / length) if length > 1e-9 else (1.0, 0.0)


def draw_text(draw: ImageDraw.ImageDraw, place: tuple[float, float], text: str, color: Rgb, size_px: int) -> None:
    """Write a text whose upper left corner is at a place, in a size [pixels]."""
    draw.text(place, text, fill=color, font=_font(size_px))


@cache
def _font(size_px: int) -> Any:
    return ImageFont.load_default(size_px)


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
        self._room = run.environment
        self._scale = PixelScale.fit(self._plan(), size_px, _MARGIN_PX)
        self._colors = {name: agent_color(i) for i, name in enumerate(run.agents)}
        self._shown_snapshot = -1
        self._ground = self._draw_room(-1)
        # Tracks stay: they are drawn on as time passes.
        self._tracks = Image.new("RGBA", size_px, (0, 0, 0, 0))
        self._last_px: dict[str, tuple[float, float]] = {}

    def picture(self, time_s: float, poses: Mapping[str, tuple[Vec3, Quaternion]]) -> Image.Image:
        """Return the plan at a time [s], with the vehicles at their poses."""
        snapshot, room = self._snapshot(time_s), self._run.room_at(time_s)
        if snapshot != self._shown_snapshot or room is not self._room:
            self._shown_snapshot, self._room = snapshot, room
            self._ground = self._draw_room(snapshot)
        draw = ImageDraw.Draw(self._tracks)
        if not self._last_px:
            self._draw_past(draw, time_s)
        for agent, (place_m, _) in poses.items():
            here = self._scale.pixel(place_m)
            if agent in self._last_px:
                draw.line((self._last_px[agent], here), fill=(*self._colors[agent], 255), width=2)
            self._last_px[agent] = here
        picture = self._ground.copy()
        picture.paste(self._tracks, (0, 0), self._tracks)
        over = ImageDraw.Draw(picture)
        self._draw_marks(over, time_s)
        for agent, (place_m, turn) in poses.items():
            _draw_vehicle(over, self._scale.pixel(place_m), yaw_from_quaternion(turn), self._colors[agent])
        return picture

    def place_of(self, place_m: Vec3) -> tuple[int, int]:
        """Return the position in the picture, right and down, of a place in the room [m]."""
        x, y = self._scale.pixel(place_m)
        return round(x), round(y)

    # What was run before the film begins.
    def _draw_past(self, draw: ImageDraw.ImageDraw, time_s: float) -> None:
        for agent, track in self._run.tracks.items():
            past = [self._scale.pixel(place_m) for place_m in track.position_world_m[track.time_s <= time_s]]
            if len(past) > 1:
                draw.line(past, fill=(*self._colors[agent], 255), width=2)

    def _snapshot(self, time_s: float) -> int:
        slices = next(iter(self._run.gas_slices.values()), None)
        return -1 if slices is None else int(np.searchsorted(slices.time_s, time_s + 1e-9, side="right")) - 1

    def _draw_room(self, snapshot: int) -> Image.Image:
        plan = self._plan()
        painter = PlanPainter(plan, self._scale, colors.BACKGROUND)
        slices = next(iter(self._run.gas_slices.values()), None)
        if slices is None or snapshot < 0:
            painter.floor(colors.MAP_FLOOR)
        else:
            levels = GasScale.of(self._run.scenario).levels(slices.mixing_ratio_ppm(snapshot))
            painter.picture(colors.slice_colors()[levels][..., :3])
        painter.cells(plan.solid, colors.MAP_OBSTACLES)
        # Gas is over what ends below: it is seen by its edges, as on the map of the recording.
        painter.cell_outline(plan.below, colors.MAP_OBSTACLES)
        painter.outline(colors.EDGES)
        painter.wind(self._run.wind_m_s(0.0), _dim(colors.WIND), _N_ARROWS)
        painter.openings(colors.INLET, colors.OUTLET, width=_OPENING_PX)
        for source in self._run.scenario.gas.sources:
            painter.dot(source.position_m, _DOT_PX, outline=colors.SOURCE, width=3)
        return painter.image

    def _draw_marks(self, draw: ImageDraw.ImageDraw, time_s: float) -> None:
        for agent, points in self._run.waypoints.items():
            i = int(np.searchsorted(points.time_s, time_s + 1e-9, side="right")) - 1
            if i >= 0:
                x, y = self._scale.pixel(points.position_world_m[i])
                draw.line((x - 4, y, x + 4, y), fill=self._colors[agent])
                draw.line((x, y - 4, x, y + 4), fill=self._colors[agent])
        for agent, points in self._run.marks.items():
            for i in range(int(np.searchsorted(points.time_s, time_s + 1e-9, side="right"))):
                if points.label[i] in ("start", ""):
                    continue
                x, y = self._scale.pixel(points.position_world_m[i])
                draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=self._colors[agent])
                draw_text(draw, (x + 6, y - 8), points.label[i], colors.READING, 13)

    def _plan(self) -> PlanView:
        return PlanView.of(self._room, self._run.scenario.slice_height_m)


def _dim(color: Rgb) -> Rgb:
    red, green, blue = ((channel + floor) // 2 for channel, floor in zip(color, colors.MAP_FLOOR, strict=True))
    return red, green, blue


def _draw_vehicle(draw: ImageDraw.ImageDraw, place: tuple[float, float], yaw_rad: float, color: Rgb) -> None:
    x, y = place
    draw.ellipse((x - _DOT_PX, y - _DOT_PX, x + _DOT_PX, y + _DOT_PX), fill=color, outline=(255, 255, 255))
    nose = (x + 2 * _DOT_PX * math.cos(yaw_rad), y - 2 * _DOT_PX * math.sin(yaw_rad))
    draw.line((place, nose), fill=(255, 255, 255), width=2)


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
        gas = next((one for one in run.samples if (one.agent, one.quantity) == (agent, MIXING_RATIO.name)), None)
        reading = next((one for one in run.readings if (one.agent, one.quantity) == (agent, RESPONSE.name)), None)
        rows = [
            ("true gas [ppm]", gas, colors.READING),
            (f"{reading.sensor} [{reading.unit}]" if reading is not None else "", reading, color),
            ("distance [m]", run.figure(agent, DISTANCE.name), colors.SOURCE),
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


def render_frames(
    runs: Sequence[RunData],
    cut: FilmSegment,
    size_px: tuple[int, int],
    *,
    follow: str | None = None,
    has_chase_view: bool = True,
) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames of a film, (height, width, 3), 25 for each second.

    Args:
        follow: The agent that the room is seen with, of one run; absent: the first.
        has_chase_view: Whether the room is shown beside the plan.
    """
    if len(runs) > 1:
        if follow is not None:
            raise UsageError("--follow: expected one run, was several. Leave it out: tiles show plans.")
        return _tiles(runs, cut, size_px)
    (run,) = runs
    if follow is not None and follow not in run.agents:
        raise UsageError(f"--follow: expected one of {', '.join(run.agents)}, was {follow!r}.")
    return _one(run, cut, size_px, follow or run.agents[0], has_chase_view=has_chase_view)


def _one(
    run: RunData, cut: FilmSegment, size_px: tuple[int, int], follow: str, *, has_chase_view: bool
) -> Iterator[NDArray[np.uint8]]:
    width, height = size_px
    strip_height = round(height * _STRIP_SHARE)
    upper = height - strip_height
    half = width // 2 if has_chase_view else width
    plan = PlanPanel(run, (half, upper))
    strip = StripPanel(run, follow, cut, (width, strip_height))
    chase = ChasePanel(run, follow, (width - half, upper), 1 / FRAMES_PER_S) if has_chase_view else None
    try:
        for time_s in cut.times_s.tolist():
            poses = {name: interpolate_pose(track, time_s) for name, track in run.tracks.items()}
            picture = Image.new("RGB", size_px)
            picture.paste(plan.picture(time_s, poses), (0, 0))
            if chase is not None:
                picture.paste(chase.picture(time_s, poses), (half, 0))
            picture.paste(strip.picture(time_s), (0, upper))
            yield np.asarray(picture)
    finally:
        if chase is not None:
            chase.close()


def _tiles(runs: Sequence[RunData], cut: FilmSegment, size_px: tuple[int, int]) -> Iterator[NDArray[np.uint8]]:
    columns = math.ceil(math.sqrt(len(runs)))
    rows = math.ceil(len(runs) / columns)
    tile = (size_px[0] // columns, size_px[1] // rows)
    plans = [PlanPanel(run, (tile[0], tile[1] - _TITLE_PX)) for run in runs]
    ends_s = [max(float(track.time_s[-1]) for track in run.tracks.values()) for run in runs]
    for time_s in cut.times_s.tolist():
        picture = Image.new("RGB", size_px, colors.BACKGROUND)
        draw = ImageDraw.Draw(picture)
        for i, (run, plan) in enumerate(zip(runs, plans, strict=True)):
            corner = (i % columns * tile[0], i // columns * tile[1])
            # A run that is over stays as it ended.
            own_s = min(time_s, ends_s[i])
            poses = {name: interpolate_pose(track, own_s) for name, track in run.tracks.items()}
            picture.paste(plan.picture(own_s, poses), (corner[0], corner[1] + _TITLE_PX))
            methods = ", ".join(dict.fromkeys(run.methods.values()))
            caption = f"{own_s:.1f} s  {methods}, seed {run.scenario.seed}"
            if time_s >= ends_s[i] and run.result is not None:
                caption += f": {str(run.result['end_reason']).replace('_', ' ')}"
            draw_text(draw, (corner[0] + 8, corner[1] + 3), caption, colors.READING, 14)
        yield np.asarray(picture)


def write_film(frames: Frames, path: Path, progress: Callable[[int], None] = lambda _: None) -> None:
    """Write frames as a film; the file appears when it is whole.

    Args:
        frames: (height, width, 3) each, all of one size, even numbers for MP4.
        path: Its ending says what it becomes.
    """
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise UsageError(f"--out: expected a file that ends with {', '.join(FORMATS)}, was {path.name}.")
    unfinished = path.with_name(f".{path.stem}.{os.getpid()}{ending}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        counted = _counted(frames, progress)
        if ending == ".mp4":
            try:
                import av
            except ImportError as error:
                raise UsageError(f"av: expected the package, found none. Install it with: {REMEDY}") from error
            with av.open(str(unfinished), "w") as container:
                stream: Any = None
                for pixels in counted:
                    if stream is None:
                        stream = container.add_stream("libx264", rate=Fraction(FRAMES_PER_S), options=_H264)
                        stream.height, stream.width = pixels.shape[:2]
                        stream.pix_fmt = "yuv420p"
                    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
                    container.mux(stream.encode(frame))
                if stream is not None:
                    container.mux(stream.encode())
        else:
            _write_animation(counted, unfinished)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _counted(frames: Frames, progress: Callable[[int], None]) -> Iterator[NDArray[np.uint8]]:
    for i, frame in enumerate(frames, 1):
        yield frame
        progress(i)


def _write_animation(frames: Iterator[NDArray[np.uint8]], path: Path) -> None:
    is_gif = path.suffix == ".gif"
    pictures = (_few_colours(Image.fromarray(frame)) if is_gif else Image.fromarray(frame) for frame in frames)
    first = next(pictures)
    options: dict[str, Any] = {} if is_gif else {"quality": 60, "method": 2}
    first.save(path, save_all=True, append_images=pictures, duration=round(1000 / FRAMES_PER_S), loop=0, **options)


def _few_colours(picture: Image.Image) -> Image.Image:
    return picture.quantize(_COLOURS, dither=Image.Dither.NONE)
