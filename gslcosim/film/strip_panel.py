"""The strip below a film's picture: time, what the first gas sensor says, and the distance to the source."""

import numpy as np
from PIL import Image, ImageDraw

from gslcosim.film.cuts import Cut
from gslcosim.film.lettering import write
from gslcosim.recording import colors
from gslcosim.recording.colors import Rgb, agent_color
from gslcosim.run_data.opening import RunData
from gslcosim.run_data.recorded_streams import RecordedSeries

_LABEL_PX = 150
_MARGIN_PX = 10
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

    def __init__(self, run: RunData, agent: str, cut: Cut, size_px: tuple[int, int]) -> None:
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
        write(draw, (_MARGIN_PX, 2), f"{time_s:7.1f} s", (255, 255, 255), round(0.8 * self._top))
        write(draw, (_MARGIN_PX + 95, 4), f"x {self._cut.speed:g}", colors.EDGES, _TEXT_PX)
        for k, (_, series, shade) in enumerate(self._rows):
            i = max(int(np.searchsorted(series.time_s, time_s + 1e-9, side="right")) - 1, 0)
            top, height = self._row(k)
            value = _short(float(series.value[i]))
            write(draw, (_MARGIN_PX + 95, top + height / 2 - self._text_px / 2), value, shade, self._text_px)
        return picture

    def _row(self, k: int) -> tuple[float, float]:
        return self._top + k * self._row_height, self._row_height

    def _x(self, time_s: float) -> float:
        share = (time_s - self._cut.from_s) / max(self._cut.to_s - self._cut.from_s, 1e-9)
        return _LABEL_PX + share * (self._size_px[0] - _LABEL_PX - _MARGIN_PX)

    def _curves(self) -> Image.Image:
        picture = Image.new("RGB", self._size_px, colors.BACKGROUND)
        draw = ImageDraw.Draw(picture)
        for k, (label, series, shade) in enumerate(self._rows):
            top, height = self._row(k)
            write(draw, (_MARGIN_PX, top + height / 2 - self._text_px / 2), label, shade, self._text_px)
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
