"""Vision prior of the source: coloured things in camera pictures, their positions, and how likely such things leak.

Held by:
    extensions/search/tests/unit/senses/test_vision.py
"""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import CameraImage
from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid, normalised
from gslcosim_search.elementary import distance

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
# Where each colour's hues begin, in degrees; below the first it is red again.
COLOURS = (("orange", 15.0), ("yellow", 45.0), ("green", 75.0), ("cyan", 165.0), ("blue", 195.0), ("purple", 265.0))
LAST_COLOUR, RED_FROM_DEG = "red", 330.0


@dataclass(frozen=True, kw_only=True)
class SeenObject:
    """A thing of one colour: its label, the places where it meets the floor, (n, 2) [m], and how far the nearest is."""

    label: str
    feet_m: Array
    range_m: float

    @property
    def centre_m(self) -> tuple[float, float]:
        """The mean of its feet, world frame [m]."""
        x_m, y_m = np.mean(self.feet_m, axis=0)
        return float(x_m), float(y_m)


@dataclass(frozen=True, kw_only=True)
class Viewpoint:
    """Pose of the vehicle when a picture was taken; it is taken for level."""

    position_m: Vec3
    yaw_rad: float


def decode_pixels(image: CameraImage) -> Pixels:
    """Return the (height, width, 3) colours of a picture.

    Raises:
        ValueError: the picture has depths in place of colours.
    """
    if image.encoding == "depth_png":
        raise ValueError("expected a picture of colours, was one of depths")
    return np.asarray(Image.open(io.BytesIO(image.data)).convert("RGB"), dtype=np.uint8)


def classify_colours(pixels: Pixels, *, least_saturation: float = 0.3, least_value: float = 0.1) -> NDArray[np.int64]:
    """Return the number of the colour of each pixel: its place in `labels`, -1 for grey, white and black.

    value V = max(R, G, B);  saturation S = (V - min(R, G, B)) / V;  hue by the usual hexagon, 0 red, 120 green [deg]

    Hue and saturation do not depend on how bright a face of a thing is lit.

    Args:
        pixels: (height, width, 3) uint8.

    Source:
        Smith 1978, Color gamut transform pairs, doi:10.1145/965139.807361.
    """
    rgb = pixels.astype(np.float64) / 255.0
    value, low = rgb.max(axis=2), rgb.min(axis=2)
    spread = value - low
    safe = np.where(spread > 0.0, spread, 1.0)
    red, green, blue = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    sector = np.select(
        [value == red, value == green],
        [((green - blue) / safe) % 6.0, (blue - red) / safe + 2.0],
        (red - green) / safe + 4.0,
    )
    hue_deg = 60.0 * sector
    starts = np.array([start for _, start in COLOURS])
    number = np.searchsorted(starts, hue_deg, side="right") - 1
    number = np.where((number < 0) | (hue_deg >= RED_FROM_DEG), len(COLOURS), number)
    is_coloured = (spread >= least_saturation * np.maximum(value, 1e-9)) & (value >= least_value)
    return np.where(is_coloured, number, -1)


def labels() -> tuple[str, ...]:
    """Return the names of the colours by their numbers."""
    return (*(name for name, _ in COLOURS), LAST_COLOUR)


def find_patches(colour: NDArray[np.int64], *, least_pixels: int = 8) -> list[tuple[str, NDArray[np.bool_]]]:
    """Return the connected patches of one colour, four neighbours each, in the order of their first pixel.

    Args:
        colour: (height, width) numbers as `classify_colours` gives them.
        least_pixels: Smaller patches are left out.

    Returns:
        Label and (height, width) mask of each.
    """
    left, patches = colour.copy(), []
    for row, column in np.argwhere(colour >= 0).tolist():
        if left[row, column] >= 0:
            mask = _filled(left, row, column)
            left[mask] = -1
            if int(mask.sum()) >= least_pixels:
                patches.append((labels()[int(colour[row, column])], mask))
    return patches


def world_directions(image: CameraImage, view: Viewpoint, points_px: Array) -> Array:
    """Return the directions in which points of a picture lie.

    d_W = Rz(yaw) R_body_optical ((u - c_u) / f, (v - c_v) / f, 1)        not of unit length
    [1] = [px] / [px]

    Args:
        view: Where the vehicle was; roll and pitch are left out.
        points_px: (n, 2) points (u, v), right and down from the upper left corner [px].

    Returns:
        (n, 3), world frame.

    Source:
        The pinhole camera of `CameraImage`.
    Deviation:
        The vehicle is taken for level: observations have its yaw only. A tilt of 0.05 rad at a height of 1 m moves
        what stands 3 m away by half a metre, so look from rest.
    """
    offsets = (points_px - np.array(image.centre_px)) / image.focal_px
    optical = np.column_stack([offsets, np.ones(len(offsets))])
    turned = elementary.product(_yaw_rotation(view.yaw_rad), _rotation(image.quaternion_body_wxyz))
    return elementary.product(optical, turned.T)


def floor_positions(image: CameraImage, view: Viewpoint, points_px: Array, *, floor_m: float = 0.0) -> Array:
    """Return the positions where lines of sight through image points meet a level at a known height.

    p = e + t d_W,  t = (z_floor - e_z) / d_z > 0        e the camera's eye
    [m] = [m] + [m]

    Args:
        points_px: (n, 2) points (u, v) [px].
        floor_m: Height of the level, world frame [m].

    Returns:
        (n, 2) places, world frame [m]; not-a-number for lines that do not meet it.

    Held by:
        extensions/search/tests/unit/senses/test_vision.py (what is projected into a picture comes back)
    """
    eye_m = np.array(view.position_m) + elementary.product(_yaw_rotation(view.yaw_rad), image.position_body_m)
    directions = world_directions(image, view, points_px)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (floor_m - eye_m[2]) / directions[:, 2]
    return eye_m[:2] + np.where(np.isfinite(t) & (t > 0.0), t, np.nan)[:, None] * directions[:, :2]


def seen_objects(
    image: CameraImage, view: Viewpoint, *, floor_m: float = 0.0, farthest_m: float = 10.0, least_pixels: int = 8
) -> list[SeenObject]:
    """Return the coloured things of a picture that stand on the floor, and where.

    In each column of pixels a thing meets the floor at the lower edge of its lowest pixel, where grey begins. Columns
    in which the picture's lower edge or something coloured hides its foot are left out, and so is what would stand
    farther away than `farthest_m`, where a pixel's error is metres.

    Args:
        farthest_m: Greatest distance that is believed [m].
        least_pixels: Smaller patches of colour are left out.
    """
    found = []
    colour = classify_colours(decode_pixels(image))
    # A row below the picture hides what reaches it.
    is_coloured = np.concatenate([colour >= 0, np.ones((1, colour.shape[1]), np.bool_)])
    for label, mask in find_patches(colour, least_pixels=least_pixels):
        columns = np.flatnonzero(mask.any(axis=0))
        bottoms = image.height_px - np.argmax(mask[::-1], axis=0)[columns]
        whole = ~is_coloured[bottoms, columns]
        points_px = np.column_stack([columns[whole] + 0.5, bottoms[whole]]).astype(np.float64)
        feet_m = floor_positions(image, view, points_px, floor_m=floor_m)
        ranges_m = np.linalg.norm(feet_m - view.position_m[:2], axis=1)
        near = ranges_m <= farthest_m
        if near.any():
            found.append(SeenObject(label=label, feet_m=feet_m[near], range_m=float(ranges_m[near].min())))
    return found


class SeenObjects:
    """The things seen so far, each once: of those with one label and centres close together the nearest view counts.

    State: the things.
    """

    def __init__(self, *, merge_m: float = 0.8) -> None:
        """Begin with nothing seen; things with centres closer than `merge_m` are one."""
        self._merge_m = merge_m
        self._things: list[SeenObject] = []

    @property
    def things(self) -> tuple[SeenObject, ...]:
        """All things, in the order in which they were seen first."""
        return tuple(self._things)

    def add(self, seen: Sequence[SeenObject]) -> bool:
        """Take note of what a picture shows; return whether anything is new or seen from nearer."""
        return sum(self._add(thing) for thing in seen) > 0

    def _add(self, thing: SeenObject) -> bool:
        for i, known in enumerate(self._things):
            if known.label == thing.label and distance(known.centre_m, thing.centre_m) < self._merge_m:
                if thing.range_m < known.range_m:
                    self._things[i] = thing
                    return True
                return False
        self._things.append(thing)
        return True


def prior_from_objects(
    grid: CellGrid,
    objects: Sequence[SeenObject],
    odds: Mapping[str, float],
    *,
    spread_m: float = 0.6,
    other_odds: float = 1.0,
) -> Array:
    """Return the probability of each cell to hold the source, by what stands there: the hook for any belief.

    w(c) = max over likely things of 1 + (o - 1) k  times  min over unlikely things of 1 + (o - 1) k
    k = exp(-d^2 / (2 s^2))        d distance from the cell's centre to the nearest of the thing's feet, s spread
    [1]; o: how many times more likely a source is beside such a thing than on empty floor

    The result is scaled to sum 1. Multiply any belief by it, once: what is seen again is no new evidence.

    Args:
        odds: o by label; above 1 likely, below 1 unlikely.
        spread_m: How far from its feet a thing may leak [m]: its size, and the error of the projection.
        other_odds: o of labels that are not named.

    Source:
        The idea: Monroy et al. 2018, Sensors (remembered, unverified): detections give a prior of the source by the
        class of the object. The formula is ours.
    """
    most, least = np.ones(grid.shape), np.ones(grid.shape)
    centres_m = grid.centres_m()
    for thing in objects:
        o = odds.get(thing.label, other_odds)
        squares_m2 = np.square(centres_m[:, None, :] - thing.feet_m[None, :, :]).sum(axis=-1).min(axis=1)
        weight = 1.0 + (o - 1.0) * elementary.exp_each(-0.5 * squares_m2 / (spread_m * spread_m)).reshape(grid.shape)
        most, least = np.maximum(most, weight), np.minimum(least, weight)
    return normalised(most * least)


def _filled(colour: NDArray[np.int64], row: int, column: int) -> NDArray[np.bool_]:
    mask = np.zeros(colour.shape, np.bool_)
    mask[row, column] = True
    waiting = [(row, column)]
    while waiting:
        r, c = waiting.pop()
        for y, x in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
            is_inside = 0 <= y < colour.shape[0] and 0 <= x < colour.shape[1]
            if is_inside and not mask[y, x] and colour[y, x] == colour[row, column]:
                mask[y, x] = True
                waiting.append((y, x))
    return mask


def _yaw_rotation(yaw_rad: float) -> Array:
    c, s = elementary.cos(yaw_rad), elementary.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _rotation(quaternion_wxyz: tuple[float, float, float, float]) -> Array:
    w, x, y, z = quaternion_wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
