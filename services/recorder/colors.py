"""Colours of the recording: one meaning each, and one logarithmic scale for all gas."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.scenario import Scenario

Rgb = tuple[int, int, int]

BACKGROUND: Rgb = (20, 23, 29)
FLOOR: Rgb = (52, 57, 66)
FLOOR_LINES: Rgb = (78, 85, 97)
MAP_FLOOR: Rgb = (33, 37, 45)
MAP_OBSTACLES: Rgb = (98, 106, 119)
EDGES: Rgb = (120, 128, 140)
SOURCE: Rgb = (255, 72, 72)
INLET: Rgb = (76, 160, 255)
OUTLET: Rgb = (205, 130, 255)
WIND: Rgb = (150, 200, 255)
READING: Rgb = (235, 235, 235)
# Seen on the dark of the window and on the light of browsers.
TRUTH: Rgb = (160, 160, 160)
AGENTS: tuple[Rgb, ...] = (
    (110, 235, 120), (80, 210, 230), (240, 225, 100), (225, 140, 235), (150, 170, 255),
    (214, 178, 132), (255, 160, 185), (195, 235, 175), (170, 195, 215), (200, 120, 120),
)  # fmt: skip

CONTACT: Rgb = (255, 150, 60)
# Components of vectors.
AXES: dict[str, Rgb] = {"x": (240, 95, 95), "y": (110, 220, 120), "z": (100, 155, 255), "w": (225, 225, 225)}

N_LEVELS = 256
DECADES = 3
# Dark violet over red and orange to pale yellow, brighter with every step; chosen.
_GAS_ANCHORS = ((52, 18, 92), (120, 28, 109), (190, 48, 84), (237, 105, 37), (251, 180, 46), (252, 252, 190))

# Dark teal over turquoise to white: no colour of the gas.
_BELIEF_ANCHORS = ((33, 37, 45), (20, 78, 99), (28, 140, 140), (110, 205, 160), (240, 255, 235))


def agent_color(index: int) -> Rgb:
    """Return the colour of the vehicle, the track and the curves of the i-th agent."""
    return AGENTS[index % len(AGENTS)]


def axis_color(axis: str, index: int) -> Rgb:
    """Return the colour of the i-th number of a row: red, green and blue for x, y and z."""
    return AXES.get(axis, agent_color(index))


def shade(color: Rgb, index: int) -> Rgb:
    """Return the colour of the i-th of an agent's curves in one plot: each is darker than the one before."""
    red, green, blue = (round(channel * 0.72 ** (index % 4)) for channel in color)
    return red, green, blue


def plan_color(color: Rgb) -> Rgb:
    """Return the colour of what a vehicle of a colour plans: half of that colour, half white."""
    red, green, blue = ((channel + 255) // 2 for channel in color)
    return red, green, blue


@dataclass(frozen=True, kw_only=True)
class GasScale:
    """A logarithmic colour scale of mixing ratios [ppm]: `DECADES` powers of ten up to `max_ppm`."""

    max_ppm: float

    @classmethod
    def of(cls, scenario: Scenario) -> "GasScale":
        """Return the scale whose upper end is the strongest source's mixing ratio at a filament's birth."""
        return cls(max_ppm=max(source.ppm for source in scenario.gas.sources))

    @property
    def min_ppm(self) -> float:
        """Below this nothing is drawn [ppm]."""
        return self.max_ppm / 10**DECADES

    def levels(self, mixing_ratio_ppm: NDArray[np.floating]) -> NDArray[np.uint8]:
        """Return the level of each mixing ratio: 0 at `min_ppm` and below, 255 at `max_ppm` and above.

        Args:
            mixing_ratio_ppm: (…) mixing ratios [ppm], >= 0.
        """
        decades_above_min = np.log10(np.maximum(mixing_ratio_ppm, self.min_ppm) / self.min_ppm)
        return np.minimum(decades_above_min * ((N_LEVELS - 1) / DECADES), N_LEVELS - 1).astype(np.uint8)


def gas_colors() -> NDArray[np.uint8]:
    """Return the (256, 3) colours of the levels, red green blue."""
    return np.rint(_interpolate(_GAS_ANCHORS)).astype(np.uint8)


def _interpolate(anchors: tuple[Rgb, ...]) -> NDArray[np.float64]:
    at = np.linspace(0, len(anchors) - 1, N_LEVELS)
    return np.column_stack([np.interp(at, np.arange(len(anchors)), channel) for channel in zip(*anchors, strict=True)])


def _with_opacity(rgb: NDArray[np.float64]) -> NDArray[np.uint8]:
    return np.column_stack([np.rint(rgb).astype(np.uint8), np.full(N_LEVELS, 255, dtype=np.uint8)])


def belief_colors() -> NDArray[np.uint8]:
    """Return the (256, 4) colours of a belief: the floor's where there is none, white in the most probable cell."""
    return _with_opacity(_interpolate(_BELIEF_ANCHORS))


def slice_colors() -> NDArray[np.uint8]:
    """Return the (256, 4) colours of a slice: the floor's where there is no gas, blending into the scale's."""
    share = np.clip(np.arange(N_LEVELS) / (N_LEVELS / 4), 0, 1)[:, None]
    return _with_opacity(np.array(MAP_FLOOR) * (1 - share) + gas_colors() * share)
