"""Frames of a film: of one run plan, chase view and strip; of several runs their plans as tiles."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gslcosim.base.errors import UsageError
from gslcosim.data.film.chase_panel import ChasePanel
from gslcosim.data.film.keyframes import FRAMES_PER_S, FilmSegment, interpolate_pose
from gslcosim.data.film.panels import PlanPanel, StripPanel, draw_text
from gslcosim.data.run import RunData
from gslcosim_services.recorder import colors

_STRIP_SHARE = 0.2
_TITLE_PX = 22


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
        runs: One run, or several as tiles.
        cut: What is shown of each.
        size_px: Width and height.
        follow: The agent that the room is seen with, of one run; absent: the first.
        has_chase_view: Whether the room is shown beside the plan.

    Raises:
        UsageError: there is no such agent, or agents are followed in several runs.
        ModelError: the room is to be shown where neither EGL nor OSMesa works.
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
