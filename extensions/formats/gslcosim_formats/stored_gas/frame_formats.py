"""Frame formats of stored gas: readers of GADEN's (versions 1, 2, 2.6 and 3), AutoGDM+'s and GSL-Bench's frames.

Layouts (little-endian, no padding unless said) were taken from the readers and writers of MAPIRlab/gaden and
MAPIRlab/gaden_core; sizes are in centimetres, places in metres.

- 1: int 1; double min[3], max[3]; int cells[3]; double cell[3], source[3]; int gas; double moles, air; int wind;
  records int id, double x, y, z, sigma.
- 2.0 to 2.5: int 2, minor; int cells[3]; float min[3], max[3], cell; float source[3]; int gas; double moles, air;
  int wind; records as in 1.
- 2.6 and later: int 2, minor; grid as in 2.0; float source[3]; int gas; float moles, air; int wind; records int id,
  float x, y, z, sigma. GADEN's later readers of it expect no source and no gas; frames without them are read too.
- 3: int 3, minor; grid as in 2.0; source: text (size_t length, bytes) `point`, `box` + float size[3], `line` + float
  end[3], `sphere` + float radius, `cylinder` + float radius, height; float position[3]; int gas; float moles, air;
  int wind; text `filaments` with size_t n and records float x, y, z, sigma, bool active and three bytes of padding, or
  text `concentrations` with size_t n and float ppm, x running fastest. Early files of version 3 have records of 2.6
  in place of the text. Late ones begin with `GADEN_RESULT`, a zero byte and size_t size before the compressed part.
"""

import struct
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.files import read_regular_file
from gslcosim.base.gases import GASES, air_density_mol_m3
from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Grid
from gslcosim_formats.data_files import OCCUPANCY_FILE, read_occupancy
from gslcosim_services.fields.filament.plume import Filaments
from gslcosim_services.fields.mixing_ratio import Walls

# Beyond these a size is a fault of the file; the cube of a far smaller one would round to zero.
MIN_SIGMA_M = 1e-4
MAX_SIGMA_M = 100.0
MAX_GRID_CELLS = 10**9
MAX_EXTENT_M = 1e5
# Pure gas; a filament's centre cannot hold more, but for rounding.
MAX_CENTRE_PPM = 1.001e6
# Air from 3,000 m up to a pressure chamber, from frost to a furnace [mol/cm3]; at 298 K and 1 atm it is 4.09e-5.
AIR_RANGE_MOL_CM3 = (4e-6, 4e-4)
GADEN_HEADER = b"GADEN_RESULT\0"
MAX_FRAME_BYTES = 1 << 30
_DOUBLE_RECORD = np.dtype([("id", "<i4"), ("position", "<f8", 3), ("sigma", "<f8")])
_FLOAT_RECORD = np.dtype([("id", "<i4"), ("position", "<f4", 3), ("sigma", "<f4")])
_ACTIVE_RECORD = np.dtype([("position", "<f4", 3), ("sigma", "<f4"), ("active", "u1"), ("padding", "u1", 3)])
_SHAPE_FLOATS = {"point": 0, "box": 3, "line": 3, "sphere": 1, "cylinder": 2}
# Results lie a few folders below their scenario.
MAX_PARENT_FOLDERS = 4
_RECORD_KINDS = {"pose_x": "f", "pose_y": "f", "pose_z": "f", "sigma": "f"}
_HEAD_KINDS = {
    **{f"env_{end}_{axis}": "f" for end in ("min", "max") for axis in "xyz"},
    **{f"env_cells_{axis}": "iu" for axis in "xyz"},
    **{f"{name}_{axis}": "f" for name in ("cell_size", "gas_source_pos") for axis in "xyz"},
    "gas_type": "iu",
    "filament_num_moles_of_gas": "f",
    "num_moles_all_gases_in_cm3": "f",
}


@dataclass(frozen=True, kw_only=True)
class GasFrame:
    """Contents of a frame file.

    Either `filaments` or `mixing_ratio_ppm` (nx, ny, nz) at the cell centres of `grid` is there. Amounts are converted
    to this project's reference air (298 K, 1 atm), so that readings are those of the writer's own air. `gas` and
    `source_position_m` are absent where the format does not say. `version` is the format's. A grid of one layer
    `is_plane` when it holds at all heights.
    """

    version: str
    grid: Grid
    gas: str | None
    source_position_m: Vec3 | None
    wind_index: int
    filaments: Filaments | None
    mixing_ratio_ppm: NDArray[np.float32] | None = None
    is_plane: bool = False


def build_grid(path: Path, *, min_m: Vec3, max_m: Vec3, cell_m: float, shape: tuple[int, int, int]) -> Grid:
    """Build the grid that a frame's head describes."""
    # NaN is not below either.
    is_sound = bool((abs(np.array([*min_m, *max_m, cell_m])) < MAX_EXTENT_M).all()) and cell_m > 0 and min(shape) > 0
    if not is_sound or int(np.prod(np.array(shape, object))) > MAX_GRID_CELLS:
        raise EnvironmentDataError(
            f"gas frame: expected a grid of positive size within {MAX_EXTENT_M:g} m, "
            f"was {shape} cells of {cell_m} m from {min_m} to {max_m}. File: {path}"
        )
    sides_m = np.subtract(max_m, min_m)
    if not (abs(sides_m - np.multiply(shape, cell_m)) <= cell_m).all():
        raise EnvironmentDataError(
            f"gas frame: expected {shape} cells of {cell_m:g} m between its corners, was {sides_m} m. File: {path}"
        )
    return Grid(origin_m=min_m, cell_m=cell_m, shape=shape)


def check_cubic_cell(path: Path, cell_m: Vec3) -> float:
    """Return the edge of cells [m] that a format describes by three, checked to be equal."""
    if not np.allclose(cell_m, cell_m[0], rtol=1e-6, atol=0.0):
        raise EnvironmentDataError(f"gas frame: expected cubic cells, was {cell_m} m. File: {path}")
    return cell_m[0]


def check_source_position(path: Path, grid: Grid, position_m: Vec3) -> Vec3:
    """Return the position of the source that a frame's head gives, world frame [m], checked."""
    low, high = np.subtract(grid.origin_m, grid.cell_m), np.add(grid.max_m, grid.cell_m)
    if not ((low <= position_m) & (position_m <= high)).all():
        raise EnvironmentDataError(
            f"gas frame: expected a source between {grid.origin_m} and {grid.max_m} m, was {position_m}. File: {path}"
        )
    return position_m


def build_filaments(
    path: Path,
    grid: Grid,
    *,
    position_m: NDArray[np.float64],
    sigma_cm: NDArray[np.float64],
    amount_mol: float,
    air_mol_cm3: float,
) -> Filaments:
    """Build checked filaments in this project's units.

    Args:
        path: The file, for errors.
        grid: Where filaments may be.
        position_m: (n, 3) centres [m].
        sigma_cm: (n,) standard deviations [cm].
        amount_mol: Gas in each filament [mol].
        air_mol_cm3: Moles of air in a cubic centimetre, as the writer had it.
    """
    if not (0.0 < amount_mol < 1e3 and AIR_RANGE_MOL_CM3[0] < air_mol_cm3 < AIR_RANGE_MOL_CM3[1]):
        raise EnvironmentDataError(
            f"gas frame: expected moles in a filament and in a cm3 of air, was {amount_mol} and {air_mol_cm3}. "
            f"File: {path}"
        )
    low, high = np.subtract(grid.origin_m, grid.cell_m), np.add(grid.max_m, grid.cell_m)
    is_inside = ((position_m >= low) & (position_m <= high)).all(axis=1)
    sigma_m = 0.01 * sigma_cm
    is_sound = is_inside & (sigma_m > MIN_SIGMA_M) & (sigma_m < MAX_SIGMA_M)
    if not is_sound.all():
        i = int(np.argmin(is_sound))
        raise EnvironmentDataError(
            f"gas frame: expected filaments inside the grid with a size, filament {i} is at {position_m[i]} m "
            f"with sigma {sigma_cm[i]} cm. File: {path}"
        )
    _check_strength(path, sigma_cm, amount_mol, air_mol_cm3)
    return Filaments(
        position_world_m=np.ascontiguousarray(position_m, np.float64),
        sigma_m=np.ascontiguousarray(sigma_m, np.float64),
        source_index=np.zeros(len(sigma_m), np.int32),
        amount_mol=np.array([amount_mol * air_density_mol_m3() / (air_mol_cm3 * 1e6)]),
        gas_index=np.zeros(1, np.int32),
    )


def _check_strength(path: Path, sigma_cm: NDArray[np.float64], amount_mol: float, air_mol_cm3: float) -> None:
    least_cm = float(sigma_cm.min(initial=np.inf))
    centre_ppm = 1e6 * amount_mol / (air_mol_cm3 * (2.0 * np.pi) ** 1.5 * least_cm**3)
    if centre_ppm > MAX_CENTRE_PPM:
        raise EnvironmentDataError(
            f"gas frame: expected filaments of at most pure gas, 1e6 ppm, was {centre_ppm:.3g} ppm in one of "
            f"{amount_mol} mol and sigma {least_cm} cm. File: {path}"
        )


def find_gas_by_code(path: Path, code: int) -> str:
    """Return the name of a gas by GADEN's number."""
    names = {gas.gaden_code: name for name, gas in GASES.items() if gas.gaden_code is not None}
    if code not in names:
        raise EnvironmentDataError(f"gas frame: expected a gas code from 0 to {max(names)}, was {code}. File: {path}")
    return names[code]


@dataclass(kw_only=True)
class _GadenReader:
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
    """Read one frame of a GADEN result folder."""
    reader = _GadenReader(path=path, content=_decompress(path))
    major = reader.take_int()
    if major == 1:
        return _read_version_1(reader)
    if major not in (2, 3):
        raise _error(path, "version 1, 2 or 3", f"{major}")
    minor = reader.take_int()
    grid = _read_grid(reader)
    if major == 3:
        return _read_version_3(reader, minor, grid)
    return _read_version_2(reader, minor, grid) if minor < 6 else _read_version_2_6(reader, minor, grid)


def _read_version_1(reader: _GadenReader) -> GasFrame:
    min_m, max_m = reader.take_vector("d"), reader.take_vector("d")
    cells = reader.take_vector("i")
    cell_m = check_cubic_cell(reader.path, reader.take_vector("d"))
    source_m, gas_code = reader.take_vector("d"), reader.take_int()
    amount_mol, air_mol_cm3 = reader.take("2d")
    wind_index = reader.take_count()
    shape = (int(cells[0]), int(cells[1]), int(cells[2]))
    grid = build_grid(reader.path, min_m=min_m, max_m=max_m, cell_m=cell_m, shape=shape)
    return GasFrame(
        version="1",
        grid=grid,
        gas=find_gas_by_code(reader.path, gas_code),
        source_position_m=check_source_position(reader.path, grid, source_m),
        wind_index=wind_index,
        filaments=_read_filaments(reader, grid, reader.take_records(_DOUBLE_RECORD), amount_mol, air_mol_cm3),
    )


def _read_version_2(reader: _GadenReader, minor: int, grid: Grid) -> GasFrame:
    source_m, gas_code = reader.take_vector("f"), reader.take_int()
    amount_mol, air_mol_cm3 = reader.take("2d")
    wind_index = reader.take_count()
    return GasFrame(
        version=f"2.{minor}",
        grid=grid,
        gas=find_gas_by_code(reader.path, gas_code),
        source_position_m=check_source_position(reader.path, grid, source_m),
        wind_index=wind_index,
        filaments=_read_filaments(reader, grid, reader.take_records(_DOUBLE_RECORD), amount_mol, air_mol_cm3),
    )


def _read_version_2_6(reader: _GadenReader, minor: int, grid: Grid) -> GasFrame:
    gas, source_m = None, None
    # Records are 20 bytes each; the remainder shows whether 16 bytes of source and gas are there.
    if reader.n_left % _FLOAT_RECORD.itemsize == struct.calcsize("<3fi2fi") % _FLOAT_RECORD.itemsize:
        source_m = check_source_position(reader.path, grid, reader.take_vector("f"))
        gas = find_gas_by_code(reader.path, reader.take_int())
    amount_mol, air_mol_cm3 = reader.take("2f")
    wind_index = reader.take_count()
    return GasFrame(
        version=f"2.{minor}",
        grid=grid,
        gas=gas,
        source_position_m=source_m,
        wind_index=wind_index,
        filaments=_read_filaments(reader, grid, reader.take_records(_FLOAT_RECORD), amount_mol, air_mol_cm3),
    )


def _read_version_3(reader: _GadenReader, minor: int, grid: Grid) -> GasFrame:
    shape = reader.take_text()
    if shape not in _SHAPE_FLOATS:
        raise _error(reader.path, f"a source of {', '.join(_SHAPE_FLOATS)}", repr(shape))
    reader.take(f"{_SHAPE_FLOATS[shape]}f")
    source_m, gas_code = reader.take_vector("f"), reader.take_int()
    amount_mol, air_mol_cm3 = reader.take("2f")
    wind_index = reader.take_count()
    mode = _read_mode(reader)
    filaments, mixing_ratio_ppm = None, None
    if mode == "concentrations":
        mixing_ratio_ppm = _read_mixing_ratios(reader, grid)
    elif mode == "filaments":
        records = reader.take_records(_ACTIVE_RECORD, int(reader.take("Q")[0]))
        filaments = _read_filaments(reader, grid, records[records["active"] != 0], amount_mol, air_mol_cm3)
    else:
        filaments = _read_filaments(reader, grid, reader.take_records(_FLOAT_RECORD), amount_mol, air_mol_cm3)
    return GasFrame(
        version=f"3.{minor}",
        grid=grid,
        gas=find_gas_by_code(reader.path, gas_code),
        source_position_m=check_source_position(reader.path, grid, source_m),
        wind_index=wind_index,
        filaments=filaments,
        mixing_ratio_ppm=mixing_ratio_ppm,
    )


# Early files have no word here: what would be its length is then a filament's number and a coordinate.
def _read_mode(reader: _GadenReader) -> str:
    following = reader.content[reader.offset :]
    for word in ("filaments", "concentrations"):
        if following.startswith(struct.pack("<Q", len(word)) + word.encode()):
            return reader.take_text()
    return ""


def _read_grid(reader: _GadenReader) -> Grid:
    cells = reader.take_vector("i")
    min_m, max_m = reader.take_vector("f"), reader.take_vector("f")
    cell_m = reader.take("f")[0]
    shape = (int(cells[0]), int(cells[1]), int(cells[2]))
    return build_grid(reader.path, min_m=min_m, max_m=max_m, cell_m=cell_m, shape=shape)


def _read_filaments(
    reader: _GadenReader, grid: Grid, records: NDArray, amount_mol: float, air_mol_cm3: float
) -> Filaments:
    # Converting a signalling NaN warns; what is not finite is refused below.
    with np.errstate(invalid="ignore"):
        position_m, sigma_cm = records["position"].astype(np.float64), records["sigma"].astype(np.float64)
    return build_filaments(
        reader.path,
        grid,
        position_m=position_m,
        sigma_cm=sigma_cm,
        amount_mol=amount_mol,
        air_mol_cm3=air_mol_cm3,
    )


def _read_mixing_ratios(reader: _GadenReader, grid: Grid) -> NDArray[np.float32]:
    n = int(reader.take("Q")[0])
    values = reader.take_records(np.dtype("<f4"), n)
    if n != int(np.prod(grid.shape)):
        raise _error(reader.path, f"one mixing ratio for each of {grid.shape} cells", f"{n}")
    # Overlapping filaments add up, so that close to a strong source there may be more than pure gas.
    if not ((values >= 0.0) & (values <= 10.0 * MAX_CENTRE_PPM)).all():
        raise _error(reader.path, "mixing ratios that are neither negative nor beyond pure gas", "others among them")
    nx, ny, nz = grid.shape
    return np.ascontiguousarray(values.reshape(nz, ny, nx).transpose(2, 1, 0))


def _decompress(path: Path) -> bytes:
    try:
        stored = read_regular_file(path)
    except OSError as error:
        raise EnvironmentDataError(f"gas frame: cannot be read ({error.strerror}). File: {path}") from error
    if stored.startswith(GADEN_HEADER):
        stored = stored[len(GADEN_HEADER) + 8 :]
    stream = zlib.decompressobj()
    try:
        content = stream.decompress(stored, MAX_FRAME_BYTES)
    except zlib.error as error:
        raise _error(path, "one zlib stream", f"{len(stored)} bytes ({error})") from error
    if not stream.eof or stream.unused_data:
        raise _error(path, "one whole zlib stream and nothing else", f"{len(stored)} bytes")
    return content


def _error(path: Path, expected: str, found: str) -> EnvironmentDataError:
    return EnvironmentDataError(f"gas frame: expected {expected}, was {found}. File: {path}")


def find_occupancy(folder: Path) -> Path | None:
    """Return the nearest `OccupancyGrid3D.csv` in a folder or the few above it, if there is one."""
    above = folder.resolve()
    for candidate in [above, *above.parents][: MAX_PARENT_FOLDERS + 1]:
        if (candidate / OCCUPANCY_FILE).is_file():
            return candidate / OCCUPANCY_FILE
    return None


def read_walls(path: Path) -> Walls:
    """Return the walls that an `OccupancyGrid3D.csv` describes."""
    grid, occupancy = read_occupancy(path)
    return Walls.of_occupancy(occupancy, grid)


def read_gsl_bench_frame(filaments_path: Path) -> GasFrame:
    """Read one frame: the filaments of `iteration_i_fil.npy` and the head of `iteration_i_head.npy` beside it."""
    head_path = filaments_path.with_name(filaments_path.name.replace("_fil.npy", "_head.npy"))
    heads = _load_gsl_bench_record(head_path, _HEAD_KINDS)
    if len(heads) != 1:
        raise EnvironmentDataError(f"gas frame: expected one head, was {len(heads)}. File: {head_path}")
    head = {name: heads[name][0].item() for name in _HEAD_KINDS}
    records = _load_gsl_bench_record(filaments_path, _RECORD_KINDS)
    grid = build_grid(
        head_path,
        min_m=_read_vector(head, "env_min"),
        max_m=_read_vector(head, "env_max"),
        cell_m=check_cubic_cell(head_path, _read_vector(head, "cell_size")),
        shape=(head["env_cells_x"], head["env_cells_y"], head["env_cells_z"]),
    )
    return GasFrame(
        version="gsl_bench",
        grid=grid,
        gas=find_gas_by_code(head_path, head["gas_type"]),
        source_position_m=check_source_position(head_path, grid, _read_vector(head, "gas_source_pos")),
        wind_index=0,
        filaments=build_filaments(
            filaments_path,
            grid,
            position_m=np.stack([records[f"pose_{axis}"].astype(np.float64) for axis in "xyz"], axis=1),
            sigma_cm=records["sigma"].astype(np.float64),
            amount_mol=head["filament_num_moles_of_gas"],
            air_mol_cm3=head["num_moles_all_gases_in_cm3"],
        ),
    )


def _read_vector(head: dict[str, float], name: str) -> Vec3:
    return (head[f"{name}_x"], head[f"{name}_y"], head[f"{name}_z"])


# Mapped and not read: a head that promises more than the file holds is then refused before memory is asked for.
def _load_gsl_bench_record(path: Path, kinds: dict[str, str]) -> NDArray:
    try:
        with warnings.catch_warnings(action="ignore"):
            array = np.load(path, mmap_mode="r", allow_pickle=False)
    # The head is Python text, and a faulty one raises whatever the tokenizer, the parser or numpy's types do.
    except Exception as error:
        raise EnvironmentDataError(f"gas frame: cannot be read as an array ({error}). File: {path}") from error
    n_bytes = path.stat().st_size - getattr(array, "offset", 0)
    if n_bytes != array.nbytes:
        raise EnvironmentDataError(f"gas frame: expected {array.nbytes} bytes of records, was {n_bytes}. File: {path}")
    fields = getattr(array, "dtype", np.dtype(float)).fields or {}
    found = {name: np.dtype(entry[0]).kind for name, entry in fields.items()}
    if array.ndim > 1 or any(found.get(name, "missing") not in kind for name, kind in kinds.items()):
        raise EnvironmentDataError(
            f"gas frame: expected records with {', '.join(kinds)}, was {array.dtype} {array.shape}. File: {path}"
        )
    return np.atleast_1d(np.array(array))
