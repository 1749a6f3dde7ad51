"""How all figures for papers look: colours, line styles, sizes, and files that are the same for the same data."""

import importlib
import io
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gslcosim.errors import MachineError, UsageError
from gslcosim.machine import machine_error, remedy_of
from gslcosim.plotting.svg_points import name_axes
from gslcosim.safe_files import replace_file

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


def look(i: int) -> dict[str, Any]:
    """Return colour and line style of the i-th of several lines, told apart in colour and in grey."""
    return {"color": OKABE_ITO[i % len(OKABE_ITO)], "ls": DASHES[i % len(DASHES)]}


@contextmanager
def styled() -> Generator[Any]:
    """Draw in this style; gives matplotlib.

    Raises:
        UsageError: matplotlib is not installed.
    """
    matplotlib = matplotlib_for("figures", extra="plot")
    with matplotlib.rc_context(STYLE | _EXACT):
        yield matplotlib


def matplotlib_for(what: str, *, extra: str, otherwise: str = "") -> Any:
    """Return matplotlib.

    Args:
        what: What needs it.
        extra: The extra of gslcosim that brings it.
        otherwise: What one can do without it.

    Raises:
        UsageError: it is not installed.
    """
    try:
        return importlib.import_module("matplotlib")
    except ImportError as error:
        raise UsageError(
            f"{what}: expected matplotlib, which draws them, found none. Install it with pip install "
            f"'gslcosim[{extra}]'{otherwise}."
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
    name_axes(figure)
    written: list[Path] = []
    for kind in formats:
        path = stem.with_name(f"{stem.name}.{kind}")
        undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {"Software": None}}[kind]
        content = io.BytesIO()
        figure.savefig(content, format=kind, metadata=undated, dpi=dots_per_inch)
        try:
            replace_file(path.parent, path.name, content.getvalue())
        except OSError as error:
            raise _cannot_write(path, error) from error
        written.append(path)
    return written


def safe_text(text: str) -> str:
    """Return a text as matplotlib takes it: a dollar sign would begin a formula."""
    return text.replace("$", r"\$")


def _cannot_write(path: Path, error: OSError) -> MachineError:
    return machine_error(error, path.name, "a file that can be written", path=path, remedy=remedy_of(error))
