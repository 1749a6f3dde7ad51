"""Columns of measured CSV files, checked as they are read: names, units, numbers, clocks."""

import csv
import gzip
import io
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError, describe_os_error
from gslcosim.base.files import read_regular_file
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3

# Of a file as it lies on the disk, and unpacked.
MAX_BYTES = 256_000_000
MAX_UNPACKED_BYTES = 1_000_000_000
# Air has 2 ppm; a mast in a plume all day long has tens.
_MAX_MEDIAN_METHANE_PPM = 200.0
# What loggers write where nothing was measured: digits that no instrument gives, Campbell's codes, the end of a 16-bit
# scale, and fills of NetCDF, which are larger than anything measured.
_FILLS = (
    *(-99999.0, -9999.0, -999.0, -9999.9, -9999.99, -999.9, -999.99, -999.25, -99.99, -99.9),
    *(-6999.0, -7999.0, -32768.0, -65.536),
)
_MAX_MEASURED = 1e19
# Of quantities that are above 0, or a little below for an instrument's offset, one of these alone stands for none.
_RARELY_BELOW_0 = ("_ppm", "_ppb", "_k", "_pa", "_percent", "_std_m_s")
_SMALL_FILLS = frozenset((-1.0, -9.0, -99.0))
# Parts of units at the end of columns' names.
_UNIT_WORDS = frozenset(
    (
        *("c", "k", "degc", "degf", "f", "deg", "rad"),
        *("m", "mm", "cm", "km", "ft", "mi", "ms", "s", "min", "h", "utc", "mph", "kn", "kt"),
        *("ug", "mg", "g", "kg", "t", "lb", "ml", "l", "slpm", "v", "volume"),
        *("pa", "hpa", "kpa", "mbar", "torr", "psi"),
        *("ppm", "ppmv", "ppb", "ppbv", "ppt", "percent", "pct", "per"),
    )
)


class MeasuredDataError(EnvironmentDataError):
    """A file of measurements is missing, or is not what its format says; the user corrects the file."""


def build_error(path: Path, where: str, *, expected: str, found: str, remedy: str = "") -> MeasuredDataError:
    """Return an error about a place in a file.

    Args:
        where: The place in it, such as `column wind_speed_m_s`; empty: the whole.
    """
    place = f"{path.parent.name}/{path.name}" + (f", {where}" if where else "")
    problem = Problem(where=place, expected=expected, found=found, remedy=remedy)
    return MeasuredDataError(f"{problem}\nFile: {path}")


@dataclass(frozen=True)
class Columns:
    """A table of texts by column name, from a file that is named in errors."""

    path: Path
    texts: dict[str, tuple[str, ...]]

    @property
    def n_rows(self) -> int:
        """Number of rows below the header."""
        return len(next(iter(self.texts.values())))

    def require(self, names: Sequence[str]) -> None:
        """Raise unless all of these columns are there."""
        for name in names:
            if name not in self.texts:
                raise self._missing(name)

    def numbers(self, name: str, *, allow_gaps: bool = False) -> NDArray[np.float64]:
        """Return a column of numbers; an empty field is nan.

        Args:
            allow_gaps: Whether fields may be empty.
        """
        self.require([name])
        texts = self.texts[name]
        is_empty = np.array([not text for text in texts])
        try:
            values = np.array([text or "nan" for text in texts], dtype=np.float64)
        except ValueError:
            i = next(i for i, text in enumerate(texts) if text and not _is_number(text))
            raise self.error(name, i, "a number", f"{texts[i]!r}", "Correct or empty the field.") from None
        remedy = "Empty the field where nothing was measured."
        bad = np.flatnonzero(~np.isfinite(values) & ~is_empty)
        if len(bad):
            raise self.error(name, int(bad[0]), "a finite number", texts[int(bad[0])], remedy)
        is_fill = np.isin(values, _FILLS) | (np.abs(values) > _MAX_MEASURED)
        below = set(values[(values < 0.0) & ~is_fill].tolist())
        if name.endswith(_RARELY_BELOW_0) and len(below) == 1 and below <= _SMALL_FILLS:
            is_fill |= values < 0.0
        fills = np.flatnonzero(is_fill)
        if len(fills):
            i = int(fills[0])
            found = f"{texts[i]}, which stands for none, in {len(fills)} of {len(texts)} rows"
            raise self.error(name, i, "a measured number", found, remedy)
        if is_empty.any() and not allow_gaps:
            i = int(np.argmax(is_empty))
            raise self.error(name, i, "a number", "an empty field", "Fill it in, or leave the row out.")
        return values

    def optional_numbers(self, name: str) -> NDArray[np.float64]:
        """Return a column of numbers with nan for empty fields; all nan where there is no such column."""
        return self.numbers(name, allow_gaps=True) if name in self.texts else np.full(self.n_rows, np.nan)

    def matrix(self, names: Iterable[str], *, allow_gaps: bool = False) -> NDArray[np.float64]:
        """Return columns of numbers side by side, (n_rows, n_names); arguments and errors as of `numbers`."""
        return np.stack([self.numbers(name, allow_gaps=allow_gaps) for name in names], axis=1)

    def point(self, name: str, i_row: int) -> Vec3:
        """Return the point [m] that columns `NAME_x_m`, `NAME_y_m` and `NAME_z_m` have in a row."""
        x_m, y_m, z_m = (float(self.numbers(f"{name}_{axis}_m")[i_row]) for axis in "xyz")
        return x_m, y_m, z_m

    def words(self, name: str) -> tuple[str, ...]:
        """Return a column of words, none of them empty."""
        self.require([name])
        for i, text in enumerate(self.texts[name]):
            if not text:
                raise self.error(name, i, "a word", "an empty field", "Fill it in, or leave the row out.")
        return self.texts[name]

    def clock_s(self, name: str) -> NDArray[np.float64]:
        """Return a column of ISO 8601 times as seconds since 1970-01-01; without zone they count as UTC."""
        values = np.empty(self.n_rows)
        for i, text in enumerate(self.words(name)):
            try:
                time = datetime.fromisoformat(text)
            except ValueError:
                raise self.error(
                    name, i, "a time as 2022-05-09T02:18:02Z", f"{text!r}", "Write times as ISO 8601."
                ) from None
            values[i] = (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()
        return values

    def rising_s(self, *, may_repeat: bool = False, longest_gap_s: float = np.inf) -> NDArray[np.float64]:
        """Return the column `time_s` [s]; arguments and errors as of `numbers` and `require_rising`."""
        return self.require_rising("time_s", self.numbers("time_s"), may_repeat=may_repeat, longest_gap_s=longest_gap_s)

    def require_rising(
        self, name: str, values: NDArray[np.float64], *, may_repeat: bool = False, longest_gap_s: float = np.inf
    ) -> NDArray[np.float64]:
        """Return the times unchanged; raise unless they rise, with no gap longer than is allowed.

        Args:
            values: (n,) times [s].
            may_repeat: Whether two rows may share a time.
            longest_gap_s: The longest step between two rows [s].
        """
        steps = np.diff(values)
        back = np.flatnonzero(steps < 0.0 if may_repeat else steps <= 0.0)
        if len(back):
            i = int(back[0]) + 1
            found = f"{self.texts[name][i]} after {self.texts[name][i - 1]}"
            raise self.error(name, i, "a later time than in the row before", found, "Sort the rows by time.")
        ahead = np.flatnonzero(steps > longest_gap_s)
        if len(ahead):
            i = int(ahead[0]) + 1
            raise self.error(
                name,
                i,
                f"steps of at most {longest_gap_s:g} s",
                f"one of {steps[i - 1]:g} s",
                "Fill the gap with rows whose readings are empty, or split the file there.",
            )
        return values

    def require_ppm(self, name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return readings of methane unchanged; raise where their median is what no open air has [ppm]."""
        known = values[np.isfinite(values)]
        median = float(np.median(known)) if len(known) else 0.0
        if median > _MAX_MEDIAN_METHANE_PPM:
            raise build_error(
                self.path,
                f"column {name}",
                expected=f"methane in ppm, some 2 ppm most of the time and a median below {_MAX_MEDIAN_METHANE_PPM:g}",
                found=f"a median of {median:g}",
                remedy="Divide by 1000 what is in ppb.",
            )
        return values

    def error(self, name: str, i_row: int, expected: str, found: str, remedy: str) -> MeasuredDataError:
        """Return an error about one field; `i_row` counts the rows below the header from 0."""
        where = f"line {i_row + 2}, column {name}"
        return build_error(self.path, where, expected=expected, found=found, remedy=remedy)

    # A column of the same quantity in another unit is the likeliest mistake.
    def _missing(self, name: str) -> MeasuredDataError:
        quantity = _without_unit(name)
        twin = next((other for other in self.texts if _without_unit(other) == quantity), None)
        if twin is not None:
            remedy = f"Convert column {twin} and rename it."
            return build_error(self.path, "", expected=f"a column {name}", found=f"{twin}", remedy=remedy)
        listed = ", ".join(list(self.texts)[:8]) + (", …" if len(self.texts) > 8 else "")
        remedy = "docs/measured-data.md lists the columns of each format."
        return build_error(self.path, "", expected=f"a column {name}", found=listed, remedy=remedy)


def _without_unit(name: str) -> tuple[str, ...]:
    parts = name.split("_")
    while len(parts) > 1 and parts[-1] in _UNIT_WORDS:
        parts.pop()
    return tuple(parts)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_columns(path: Path, *, must_have_rows: bool = True) -> Columns:
    """Return the columns of a CSV file, gzipped where its name ends with .gz.

    Args:
        must_have_rows: Whether a header alone is an error.
    """
    try:
        content = read_regular_file(path, max_bytes=MAX_BYTES)
        if path.suffix == ".gz":
            with gzip.GzipFile(fileobj=io.BytesIO(content)) as packed:
                content = packed.read(MAX_UNPACKED_BYTES + 1)
        if len(content) > MAX_UNPACKED_BYTES:
            raise build_error(path, "", expected=f"at most {MAX_UNPACKED_BYTES:,} bytes", found="more")
        rows = [row for row in csv.reader(io.StringIO(content.decode("utf-8-sig")), strict=True) if row]
    except (gzip.BadGzipFile, EOFError, zlib.error, UnicodeDecodeError, csv.Error) as error:
        raise build_error(
            path, "", expected="a CSV file in UTF-8", found=f"one that cannot be read ({error})"
        ) from error
    except OSError as error:
        raise build_error(
            path, "", expected="a file that can be read", found=describe_os_error(error), remedy="Add the file."
        ) from error
    if not rows or (must_have_rows and len(rows) == 1):
        found = "a header alone" if rows else "nothing"
        raise build_error(path, "", expected="a header and rows", found=found)
    header = [name.strip() for name in rows[0]]
    twice = next((name for name in header if header.count(name) > 1), None)
    if twice is not None:
        raise build_error(path, "header", expected="each column once", found=f"{twice} twice")
    for i, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            raise build_error(
                path, f"line {i}", expected=f"{len(header)} fields, as in the header", found=f"{len(row)}"
            )
    texts = {name: tuple(row[k].strip() for row in rows[1:]) for k, name in enumerate(header)}
    return Columns(path, texts)


def find_table(folder: Path, stem: str) -> Path:
    """Return `stem.csv` or `stem.csv.gz` of a folder; the first where there is neither."""
    plain, packed = folder / f"{stem}.csv", folder / f"{stem}.csv.gz"
    return packed if packed.is_file() and not plain.is_file() else plain
