"""The data of a figure, read back from its SVG file: lines are found by their names, axes tell their limits."""

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import UsageError

_SVG = "{http://www.w3.org/2000/svg}"
_LIMITS = re.compile(r"limits (\S+) (\S+) (\S+) (\S+)")
_PAIR = re.compile(r"[ML] (\S+) (\S+)")


def name_axes(figure: Any) -> None:
    """Write the limits of all axes with linear scales into a figure, from which points are read back."""
    figure.canvas.draw()
    for axes in figure.axes:
        if (axes.get_xscale(), axes.get_yscale()) == ("linear", "linear") and axes.name == "rectilinear":
            limits = " ".join(f"{value:.9g}" for value in (*axes.get_xlim(), *axes.get_ylim()))
            axes.patch.set_gid(f"limits {limits}")


def points_in_svg(path: Path | str) -> dict[str, NDArray[np.float64]]:
    """Return the (n, 2) points of each named line or group of markers of a figure, in its axes' units.

    Raises:
        UsageError: the file is no figure of ours.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise UsageError(f"{path}: expected a figure as SVG, was a file that cannot be read ({error}).") from error
    found: dict[str, NDArray[np.float64]] = {}
    for axes in root.iter(f"{_SVG}g"):
        if not re.fullmatch(r"axes_\d+", axes.get("id", "")):
            continue
        patch = next((one for one in axes if _LIMITS.fullmatch(one.get("id", ""))), None)
        if patch is None:
            continue
        x0, x1, y0, y1 = (float(text) for text in _LIMITS.fullmatch(patch.get("id", "")).groups())  # type: ignore[union-attr]
        corners = _drawn(patch)
        (left, top), (right, bottom) = corners.min(axis=0), corners.max(axis=0)
        for group in axes:
            name = group.get("id", "")
            points = _drawn(group) if "/" in name else np.zeros((0, 2))
            if len(points):
                x = x0 + (points[:, 0] - left) / (right - left) * (x1 - x0)
                y = y0 + (bottom - points[:, 1]) / (bottom - top) * (y1 - y0)
                found[name] = np.column_stack([x, y])
    return found


# Of markers their places; of a line that is drawn with a halo the first of two equal paths.
def _drawn(group: ElementTree.Element) -> NDArray[np.float64]:
    places = [(float(use.get("x", "nan")), float(use.get("y", "nan"))) for use in group.iter(f"{_SVG}use")]
    if places:
        return np.array(places)
    for path in group.iter(f"{_SVG}path"):
        pairs = [(float(x), float(y)) for x, y in _PAIR.findall(path.get("d", ""))]
        if pairs:
            return np.array(pairs)
    return np.zeros((0, 2))
