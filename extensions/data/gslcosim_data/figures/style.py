"""Style of figures for papers: colours, line styles, sizes, reproducible files, and data read back from SVG."""

import importlib
import io
import re
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError, build_machine_error, find_remedy
from gslcosim.base.files import replace_file

_SVG = "{http://www.w3.org/2000/svg}"
_LIMITS = re.compile(r"limits (\S+) (\S+) (\S+) (\S+)")
_PAIR = re.compile(r"[ML] (\S+) (\S+)")
OKABE_ITO = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#b8a800")
"""Colours that nearly everybody tells apart (Okabe and Ito 2008), in the report's order; yellow is darker."""
DASHES = ("-", (0, (5, 2)), (0, (1, 2)), (0, (6, 2, 1, 2)))
"""Line styles: what colours do not tell in grey print, these do."""
INK, FAINT, SOLID, BELOW = "#1c1d20", "#85878c", "#8d929c", "#dcdfe4"
SOURCE = "#a51c30"
BELIEF_MAP, SPEED_MAP = "PuBu", "Greys"
"""Colour maps; each becomes darker with every step, in grey print too."""
WIDTHS_IN = {1: 3.5, 2: 7.16}
"""Widths of figures over one and two columns of a paper [inch]."""
FORMATS = ("pdf", "svg", "png")
DOTS_PER_INCH = 300
STYLE = {
    "font.size": 8, "axes.spines.top": False, "axes.spines.right": False, "axes.linewidth": 0.6, "lines.linewidth": 1.2,
    "legend.frameon": False, "svg.hashsalt": "gslcosim", "svg.fonttype": "none", "pdf.fonttype": 42,
    "figure.constrained_layout.use": True,
}  # fmt: skip
# Every point of the data is in the file: points are read back from SVG.
_EXACT = {"path.simplify": False, "agg.path.chunksize": 0, "axes.titlesize": 8, "legend.fontsize": 7}


def write_axis_limits(figure: Any) -> None:
    """Write the limits of all axes with linear scales into a figure, from which points are read back."""
    figure.canvas.draw()
    for axes in figure.axes:
        if (axes.get_xscale(), axes.get_yscale()) == ("linear", "linear") and axes.name == "rectilinear":
            limits = " ".join(f"{value:.9g}" for value in (*axes.get_xlim(), *axes.get_ylim()))
            axes.patch.set_gid(f"limits {limits}")


def read_svg_points(path: Path | str) -> dict[str, NDArray[np.float64]]:
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


def get_line_style(i: int) -> dict[str, Any]:
    """Return colour and line style of the i-th of several lines, distinguished in colour and in grey."""
    return {"color": OKABE_ITO[i % len(OKABE_ITO)], "ls": DASHES[i % len(DASHES)]}


@contextmanager
def styled() -> Generator[Any]:
    """Draw in this style; gives matplotlib.

    Raises:
        UsageError: matplotlib is not installed.
    """
    matplotlib = matplotlib_for("figures")
    with matplotlib.rc_context(STYLE | _EXACT):
        yield matplotlib


def matplotlib_for(what: str, *, install: str = "gslcosim-data[plot]", otherwise: str = "") -> Any:
    """Return matplotlib.

    Args:
        install: The distribution with its extra that brings it.

    Raises:
        UsageError: it is not installed.
    """
    try:
        return importlib.import_module("matplotlib")
    except ImportError as error:
        raise UsageError(
            f"{what}: expected matplotlib, which draws them, found none. Install it with pip install "
            f"'{install}'{otherwise}."
        ) from error


def part_of_matplotlib(name: str) -> Any:
    """Return a module of matplotlib, for example `colors`, which nothing imports before something is drawn."""
    return importlib.import_module(f"matplotlib.{name}")


def gas_map() -> Any:
    """Return the colours of gas: pale yellow to brown, darker with every step, never so dark that a track is lost."""
    shades = importlib.import_module("matplotlib").colormaps["YlOrBr"]
    colors = [shades(0.8 * i / 15) for i in range(16)]
    return part_of_matplotlib("colors").LinearSegmentedColormap.from_list("gas", colors)


def new_figure(columns: int, aspect: float) -> Any:
    """Return an empty figure over one or two columns; `aspect` is height by width."""
    width_in = WIDTHS_IN[columns]
    return part_of_matplotlib("figure").Figure(figsize=(width_in, width_in * aspect), dpi=DOTS_PER_INCH)


def save(figure: Any, stem: Path, formats: Sequence[str], *, dots_per_inch: int = DOTS_PER_INCH) -> list[Path]:
    """Write a figure in some formats, without a date: the same data give the same bytes.

    Raises:
        MachineError: a file cannot be written.
    """
    write_axis_limits(figure)
    written: list[Path] = []
    for kind in formats:
        path = stem.with_name(f"{stem.name}.{kind}")
        # A sandbox finds by its maker that a picture shows a run.
        maker = {"Creator": "gslcosim plot"} if kind != "png" else {"Software": "gslcosim plot"}
        undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}[kind] | maker
        content = io.BytesIO()
        figure.savefig(content, format=kind, metadata=undated, dpi=dots_per_inch)
        try:
            replace_file(path.parent, path.name, content.getvalue())
        except OSError as error:
            remedy = find_remedy(error)
            raise build_machine_error(
                error, path.name, "a file that can be written", path=path, remedy=remedy
            ) from error
        written.append(path)
    return written


def safe_text(text: str) -> str:
    """Return a text as matplotlib takes it: a dollar sign would begin a formula."""
    return text.replace("$", r"\$")
