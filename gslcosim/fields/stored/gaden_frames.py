"""Reader of GADEN's gas frames, `iteration_i`: versions 1, 2, 2.6 and 3 in their compressed binary forms.

Layouts (little-endian, no padding unless said) were taken from the readers and writers of MAPIRlab/gaden and
MAPIRlab/gaden_core; sizes are in centimetres, places in metres.

- 1: int 1; double min[3], max[3]; int cells[3]; double cell[3], source[3]; int gas; double moles, air; int wind;
  records int id, double x, y, z, sigma.
- 2.0 to 2.5: int 2, minor; int cells[3]; float min[3], max[3], cell; float source[3]; int gas; double moles, air;
  int wind; records as in 1.
- 2.6 and later: int 2, minor; grid as in 2.0; float moles, air; int wind; records int id, float x, y, z, sigma.
- 3: int 3, minor; grid as in 2.0; source: text (size_t length, bytes) `point`, `box` + float size[3], `line` + float
  end[3], `sphere` + float radius, `cylinder` + float radius, height; float position[3]; int gas; float moles, air;
  int wind; text `filaments` with size_t n and records float x, y, z, sigma, bool active and three bytes of padding, or
  text `concentrations` with size_t n and float ppm, x running fastest. Early files of version 3 have records of 2.6
  in place of the text. Late ones begin with `GADEN_RESULT`, a zero byte and size_t size before the compressed part.
"""

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid
from gslcosim.errors import EnvironmentDataError
from gslcosim.fields.filament.plume import Filaments
from gslcosim.fields.stored.frame import (
    LARGEST_CENTRE_PPM,
    GasFrame,
    edge_of_cube,
    filaments_of_frame,
    gas_of_code,
    grid_of_frame,
    place_of_source,
)
from gslcosim.quantities import Vec3

LATE_HEADER = b"GADEN_RESULT\0"
LARGEST_FRAME_BYTES = 1 << 30

_DOUBLE_RECORD = np.dtype([("id", "<i4"), ("position", "<f8", 3), ("sigma", "<f8")])
_FLOAT_RECORD = np.dtype([("id", "<i4"), ("position", "<f4", 3), ("sigma", "<f4")])
_ACTIVE_RECORD = np.dtype([("position", "<f4", 3), ("sigma", "<f4"), ("active", "u1"), ("padding", "u1", 3)])
_SHAPE_FLOATS = {"point": 0, "box": 3, "line": 3, "sphere": 1, "cylinder": 2}


@dataclass(kw_only=True)
class _Reader:
    # Takes values off the front of the bytes; running out of them is an error with the file's name.
    path: Path
    content: bytes
    offset: int = 0

    @property
    def n_left(self) -> int:
        return len(self.content) - self.offset

    def take(self, layout: str) -> tuple[float, ...]:
        size = struct.calcsize(f"<{layout}")
        if size > self.n_left:
            raise _error(self.path, f"{size} more bytes at {self.offset}", f"{self.n_left}")
        values = struct.unpack_from(f"<{layout}", self.content, self.offset)
        self.offset += size
        return values

    def take_int(self) -> int:
        return int(self.take("i")[0])

    def take_count(self) -> int:
        value = self.take_int()
        if value < 0:
            raise _error(self.path, f"a number of 0 or more at {self.offset - 4}", f"{value}")
        return value

    def take_vector(self, layout: str) -> Vec3:
        x, y, z = self.take(f"3{layout}")
        return (x, y, z)

    def take_text(self) -> str:
        size = int(self.take("Q")[0])
        if size > min(64, self.n_left):
            raise _error(self.path, f"a word at {self.offset}", f"one of {size} bytes")
        text = self.content[self.offset : self.offset + size]
        self.offset += size
        return text.decode("ascii", "replace")

    def take_records(self, dtype: np.dtype, n: int | None = None) -> NDArray:
        n_whole, rest = divmod(self.n_left, dtype.itemsize)
        if rest or (n is not None and n != n_whole):
            expected = f"{n} records" if n is not None else "whole records"
            raise _error(self.path, f"{expected} of {dtype.itemsize} bytes to the end", f"{self.n_left} bytes")
        return np.frombuffer(self.content, dtype, offset=self.offset)


def read_gaden_frame(path: Path) -> GasFrame:
    """Read one frame of a GADEN result folder.

    Raises:
        EnvironmentDataError: the file is missing, truncated, of an unknown version, or holds impossible values.
    """
    reader = _Reader(path=path, content=_decompressed(path))
    major = reader.take_int()
    if major == 1:
        return _version_1(reader)
    if major not in (2, 3):
        raise _error(path, "version 1, 2 or 3", f"{major}")
    minor = reader.take_int()
    grid = _grid(reader)
    if major == 3:
        return _version_3(reader, minor, grid)
    return _version_2(reader, minor, grid) if minor < 6 else _version_2_6(reader, minor, grid)


def _version_1(reader: _Reader) -> GasFrame:
    min_m, max_m = reader.take_vector("d"), reader.take_vector("d")
    cells = reader.take_vector("i")
    cell_m = edge_of_cube(reader.path, reader.take_vector("d"))
    source_m, gas_code = reader.take_vector("d"), reader.take_int()
    amount_mol, air_mol_cm3 = reader.take("2d")
    wind_index = reader.take_count()
    shape = (int(cells[0]), int(cells[1]), int(cells[2]))
    grid = grid_of_frame(reader.path, min_m=min_m, max_m=max_m, cell_m=cell_m, shape=shape)
    return GasFrame(
        version="1",
        grid=grid,
        gas=gas_of_code(reader.path, gas_code),
        source_position_m=place_of_source(reader.path, grid, source_m),
        wind_index=wind_index,
        filaments=_filaments(reader, grid, reader.take_records(_DOUBLE_RECORD), amount_mol, air_mol_cm3),
    )


def _version_2(reader: _Reader, minor: int, grid: Grid) -> GasFrame:
    source_m, gas_code = reader.take_vector("f"), reader.take_int()
    amount_mol, air_mol_cm3 = reader.take("2d")
    wind_index = reader.take_count()
    return GasFrame(
        version=f"2.{minor}",
        grid=grid,
        gas=gas_of_code(reader.path, gas_code),
        source_position_m=place_of_source(reader.path, grid, source_m),
        wind_index=wind_index,
        filaments=_filaments(reader, grid, reader.take_records(_DOUBLE_RECORD), amount_mol, air_mol_cm3),
    )


def _version_2_6(reader: _Reader, minor: int, grid: Grid) -> GasFrame:
    amount_mol, air_mol_cm3 = reader.take("2f")
    wind_index = reader.take_count()
    return GasFrame(
        version=f"2.{minor}",
        grid=grid,
        gas=None,
        source_position_m=None,
        wind_index=wind_index,
        filaments=_filaments(reader, grid, reader.take_records(_FLOAT_RECORD), amount_mol, air_mol_cm3),
    )


def _version_3(reader: _Reader, minor: int, grid: Grid) -> GasFrame:
    shape = reader.take_text()
    if shape not in _SHAPE_FLOATS:
        raise _error(reader.path, f"a source of {', '.join(_SHAPE_FLOATS)}", repr(shape))
    reader.take(f"{_SHAPE_FLOATS[shape]}f")
    source_m, gas_code = reader.take_vector("f"), reader.take_int()
    amount_mol, air_mol_cm3 = reader.take("2f")
    wind_index = reader.take_count()
    mode = _mode(reader)
    filaments, mixing_ratio_ppm = None, None
    if mode == "concentrations":
        mixing_ratio_ppm = _mixing_ratios(reader, grid)
    elif mode == "filaments":
        records = reader.take_records(_ACTIVE_RECORD, int(reader.take("Q")[0]))
        filaments = _filaments(reader, grid, records[records["active"] != 0], amount_mol, air_mol_cm3)
    else:
        filaments = _filaments(reader, grid, reader.take_records(_FLOAT_RECORD), amount_mol, air_mol_cm3)
    return GasFrame(
        version=f"3.{minor}",
        grid=grid,
        gas=gas_of_code(reader.path, gas_code),
        source_position_m=place_of_source(reader.path, grid, source_m),
        wind_index=wind_index,
        filaments=filaments,
        mixing_ratio_ppm=mixing_ratio_ppm,
    )


# Early files have no word here: what would be its length is then a filament's number and a coordinate.
def _mode(reader: _Reader) -> str:
    following = reader.content[reader.offset :]
    for word in ("filaments", "concentrations"):
        if following.startswith(struct.pack("<Q", len(word)) + word.encode()):
            return reader.take_text()
    return ""


def _grid(reader: _Reader) -> Grid:
    cells = reader.take_vector("i")
    min_m, max_m = reader.take_vector("f"), reader.take_vector("f")
    cell_m = reader.take("f")[0]
    shape = (int(cells[0]), int(cells[1]), int(cells[2]))
    return grid_of_frame(reader.path, min_m=min_m, max_m=max_m, cell_m=cell_m, shape=shape)


def _filaments(reader: _Reader, grid: Grid, records: NDArray, amount_mol: float, air_mol_cm3: float) -> Filaments:
    # Converting a signalling NaN warns; what is not finite is refused below.
    with np.errstate(invalid="ignore"):
        position_m, sigma_cm = records["position"].astype(np.float64), records["sigma"].astype(np.float64)
    return filaments_of_frame(
        reader.path,
        grid,
        position_m=position_m,
        sigma_cm=sigma_cm,
        amount_mol=amount_mol,
        air_mol_cm3=air_mol_cm3,
    )


def _mixing_ratios(reader: _Reader, grid: Grid) -> NDArray[np.float32]:
    n = int(reader.take("Q")[0])
    values = reader.take_records(np.dtype("<f4"), n)
    if n != int(np.prod(grid.shape)):
        raise _error(reader.path, f"one mixing ratio for each of {grid.shape} cells", f"{n}")
    # Overlapping filaments add up, so that close to a strong source there may be more than pure gas.
    if not ((values >= 0.0) & (values <= 10.0 * LARGEST_CENTRE_PPM)).all():
        raise _error(reader.path, "mixing ratios that are neither negative nor beyond pure gas", "others among them")
    nx, ny, nz = grid.shape
    return np.ascontiguousarray(values.reshape(nz, ny, nx).transpose(2, 1, 0))


def _decompressed(path: Path) -> bytes:
    try:
        stored = path.read_bytes()
    except OSError as error:
        raise EnvironmentDataError(f"gas frame: cannot be read ({error.strerror}). File: {path}") from error
    if stored.startswith(LATE_HEADER):
        stored = stored[len(LATE_HEADER) + 8 :]
    stream = zlib.decompressobj()
    try:
        content = stream.decompress(stored, LARGEST_FRAME_BYTES)
    except zlib.error as error:
        raise _error(path, "one zlib stream", f"{len(stored)} bytes ({error})") from error
    if not stream.eof or stream.unused_data:
        raise _error(path, "one whole zlib stream and nothing else", f"{len(stored)} bytes")
    return content


def _error(path: Path, expected: str, found: str) -> EnvironmentDataError:
    return EnvironmentDataError(f"gas frame: expected {expected}, was {found}. File: {path}")
