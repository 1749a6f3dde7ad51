"""Environment folder: an environment with its wind on disk, format version 1, and its meshes as glTF.

environment.yaml   name, grid, boxes, openings, lights, wind timing, content hash, recipe (text, UTF-8)
    occupancy.npy      (nx, ny, nz) uint8: 0 free, 1 solid, 2 free and touching an outlet
    wind.npy           (t, nx, ny, nz, 3) float32, cell centres, world frame, xyz [m/s]; read memory-mapped
    visual.glb         meshes for pictures (glTF 2.0, y up, metres; see `VisualMesh`); only where the header's
                       `meshes` names any: rooms from geometry files
    scene.xml          the boxes as MJCF, for other programs; may be absent
    top_view.png       a picture from above, for people; may be absent
    checksums.json     hashes of the files above, which reveal a change; see `gslcosim.base.checksums`
    wind_report.json   quality of the built-in solver's wind, and wind_history.png, a plot of its steps; may be absent

Arrays are numpy's own format (version 1 or newer), C order, little-endian, index order x, y, z.
All lengths are metres in the world frame; cell (0, 0, 0) touches `grid.origin_m`.
Unknown keys in environment.yaml are ignored; additions have defaults; a changed meaning is a new format number.
"""

import contextlib
import errno
import re
import uuid
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gslcosim.base.checksums import CHECKSUMS_FILE, check_files, write_checksums
from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.files import read_regular_file, remove_tree
from gslcosim.base.untrusted_input import MalformedFileError, describe_validation_errors
from gslcosim.environment.model import (
    Box,
    Cell,
    Environment,
    Grid,
    Light,
    Opening,
    WindFrames,
    content_hash,
    freeze_array,
)
from gslcosim.environment.visual_meshes import encode_glb, load_visual_meshes

FORMAT = "gslcosim/environment/1"
HEADER_FILE: Final = "environment.yaml"
OCCUPANCY_FILE: Final = "occupancy.npy"
WIND_FILE: Final = "wind.npy"
K_EPSILON_FILE: Final = "k_epsilon.npy"
MESHES_FILE: Final = "visual.glb"
EnvironmentFile = Literal["environment.yaml", "occupancy.npy", "wind.npy", "k_epsilon.npy", "visual.glb"]
"""Name of a file that is part of an environment; other files are for people and other programs."""
ENVIRONMENT_FILES: tuple[EnvironmentFile, ...] = (HEADER_FILE, OCCUPANCY_FILE, WIND_FILE, K_EPSILON_FILE, MESHES_FILE)
REQUIRED_FILES: frozenset[EnvironmentFile] = frozenset({HEADER_FILE, OCCUPANCY_FILE, WIND_FILE})
REPORT_FILE: Final = "wind_report.json"

# The C parser is ten times quicker; PyYAML has it in all its wheels, but not in every build from source.
_YAML_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

# The format needs three levels; unclosed brackets in names count as well.
_DEEPEST = 1000
# Boxes and meshes of a large building.
_MAX_HEADER_BYTES = 64_000_000


def data_error(path: Path, expected: str, found: str, *, remedy: str = "") -> EnvironmentDataError:
    """Return the error of a faulty file."""
    tail = f" {remedy}" if remedy else ""
    return EnvironmentDataError(f"{path.name}: expected {expected}, was {found}.{tail}\nFile: {path}")


def load_npy(path: Path) -> NDArray[Any]:
    """Return the array of a `.npy` file, memory-mapped, so that a false size in its head allocates no memory."""
    if not path.is_file():
        raise data_error(path, "an array", "missing")
    try:
        with warnings.catch_warnings(action="ignore"):
            mapped = np.load(path, mmap_mode="r", allow_pickle=False)
    # The head is Python text: a faulty one raises any error of the tokenizer, the parser or numpy's types.
    except Exception as error:
        n_bytes = path.stat().st_size
        raise data_error(path, "a whole numpy array", f"{n_bytes} bytes that are not ({error})") from error
    if not isinstance(mapped, np.ndarray):
        raise data_error(path, "one numpy array", "an archive of them")
    # Duplicated bytes in the middle shift all later ones, and leave some at the end.
    n_left = path.stat().st_size - getattr(mapped, "offset", 0) - mapped.nbytes
    if n_left:
        raise data_error(path, "a numpy array and nothing else", f"{n_left} bytes more")
    # A plain view: a memmap object would take the slow path of compiled kernels.
    return np.asarray(mapped)


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)


class _WindPart(_Part):
    period_s: float = Field(gt=0)
    is_looping: bool
    has_k_epsilon: bool = False


class _Header(_Part):
    format: str
    name: str
    content_hash: str
    grid: Grid
    wind: _WindPart
    boxes: tuple[Box, ...]
    openings: tuple[Opening, ...]
    lights: tuple[Light, ...] = ()
    meshes: tuple[str, ...] = ()


def save_environment(
    environment: Environment,
    folder: Path,
    *,
    made_from: Mapping[str, Any] | None = None,
    notices: Sequence[str] = (),
    extras: Mapping[str, bytes] | None = None,
) -> None:
    """Write an environment to a folder atomically.

    The files are written to a folder beside the target, which is then renamed. It replaces another environment; an
    equal one stays untouched. Several processes may save to one folder at the same time.

    Args:
        environment: The environment.
        folder: Target; missing parents are created.
        made_from: Plain values of its recipe, kept for people in environment.yaml.
        notices: Sentences about deviations from the scenario, kept for people in environment.yaml.
        extras: Further files by name, such as `REPORT_FILE`.
    """
    _check_finite(environment.wind.velocity_m_s, folder / WIND_FILE)
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = folder.with_name(f".{folder.name}.{uuid.uuid4().hex}.partial")
    beside.mkdir()
    try:
        np.save(beside / OCCUPANCY_FILE, np.ascontiguousarray(environment.occupancy, dtype=np.uint8))
        np.save(beside / WIND_FILE, np.ascontiguousarray(environment.wind.velocity_m_s, dtype="<f4"))
        if environment.wind.k_epsilon is not None:
            np.save(beside / K_EPSILON_FILE, np.ascontiguousarray(environment.wind.k_epsilon, dtype="<f4"))
        if environment.meshes:
            (beside / MESHES_FILE).write_bytes(encode_glb(environment.meshes))
        (beside / HEADER_FILE).write_text(_header_text(environment, made_from, notices), encoding="utf-8")
        for name, content in (extras or {}).items():
            (beside / name).write_bytes(content)
        present = (name for name in ENVIRONMENT_FILES if (beside / name).is_file())
        write_checksums(beside, *present, place=folder.name)
        _move_into_place(beside, folder, environment.content_hash)
    finally:
        remove_tree(beside, ignore_errors=True)


def load_environment(folder: Path, *, with_meshes: bool = False) -> Environment:
    """Return the environment in a folder, its wind memory-mapped and all its arrays read-only.

    Its files are compared with their checksums. Where these do not bear the signature of this cache, the content hash
    is computed, which takes longer with meshes, and compared with that of the header if there are checksums.

    Args:
        folder: The environment folder.
        with_meshes: Also read the meshes, which only pictures need.
    """
    is_ours = False
    with contextlib.suppress(MalformedFileError):
        is_ours = check_files(folder, *ENVIRONMENT_FILES)
    header = _load_header(folder)
    grid = header.grid
    has_meshes = bool(header.meshes) and (with_meshes or not is_ours)
    occupancy = _load_occupancy(folder / OCCUPANCY_FILE, grid)
    velocity_m_s = _load_array(folder / WIND_FILE, np.dtype("<f4"), (None, *grid.shape, 3))
    if not is_ours:  # files with the signature of this cache were finite when they were saved
        _check_finite(velocity_m_s, folder / WIND_FILE)
    environment = Environment(
        name=header.name,
        grid=grid,
        occupancy=occupancy,
        wind=WindFrames(
            velocity_m_s=velocity_m_s,
            period_s=header.wind.period_s,
            is_looping=header.wind.is_looping,
            k_epsilon=_load_k_epsilon(folder / K_EPSILON_FILE, grid) if header.wind.has_k_epsilon else None,
        ),
        boxes=header.boxes,
        openings=header.openings,
        content_hash=header.content_hash,
        lights=header.lights,
        meshes=load_visual_meshes(folder / MESHES_FILE, header.meshes) if has_meshes else (),
    )
    if is_ours:
        return environment
    found = content_hash(environment, environment.wind)
    # A folder without checksums is from another program or an older version.
    if found != header.content_hash and (folder / CHECKSUMS_FILE).is_file():
        raise EnvironmentDataError(
            f"content_hash: expected {header.content_hash}, was {found}. A file was changed after it was saved; make "
            f"the environment again, or remove {CHECKSUMS_FILE} to take it as it is.\nFolder: {folder}"
        )
    return replace(environment, content_hash=found)


def _header_text(environment: Environment, made_from: Mapping[str, Any] | None, notices: Sequence[str]) -> str:
    header = {
        "format": FORMAT,
        "name": environment.name,
        "content_hash": environment.content_hash,
        "grid": asdict(environment.grid),
        "wind": {
            "period_s": environment.wind.period_s,
            "is_looping": environment.wind.is_looping,
            **({} if environment.wind.k_epsilon is None else {"has_k_epsilon": True}),
        },
        "boxes": [asdict(box) for box in environment.boxes],
        "openings": [asdict(opening) for opening in environment.openings],
        "lights": [asdict(light) for light in environment.lights],
        "meshes": [mesh.name for mesh in environment.meshes],
        "notices": list(notices),
        "made_from": dict(made_from or {}),
    }
    return yaml.safe_dump(_plain(header), sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)


# YAML has lists, but no tuples.
def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


# Renaming a folder onto one that is not empty fails on every system; the second process then checks the folder of the
# first.
def _move_into_place(beside: Path, folder: Path, content_hash: str) -> None:
    for _ in range(100):
        try:
            beside.rename(folder)
        except OSError as error:
            # A folder was there; another process may have removed it by now.
            was_taken = error.errno in (errno.ENOTEMPTY, errno.EEXIST)
            if not was_taken and not (error.errno in (errno.ENOTDIR, errno.EACCES) and folder.exists()):
                raise
        else:
            return
        if _is_whole(folder, content_hash):
            return
        _clear(folder)
    raise EnvironmentDataError(f"{folder}: expected to replace it, but other processes kept writing to it. Try again.")


def _is_whole(folder: Path, content_hash: str) -> bool:
    try:
        return load_environment(folder).content_hash == content_hash
    except (EnvironmentDataError, FileNotFoundError):
        # The second: another process removed the folder during the reading.
        return False


# Moves an old environment aside in one step, and never touches anything else. Another process may do the same at any
# moment; then the folder is gone or replaced, and the caller tries again.
def _clear(folder: Path) -> None:
    aside = folder.with_name(f".{folder.name}.{uuid.uuid4().hex}.old")
    try:
        before = folder.stat().st_ino
        if not (folder / HEADER_FILE).exists():
            if folder.stat().st_ino == before:
                raise EnvironmentDataError(
                    f"The folder holds something else than an environment (it has no {HEADER_FILE}): {folder}. "
                    "Nothing was written; choose another folder."
                )
            return
        folder.rename(aside)
    except FileNotFoundError:
        return
    remove_tree(aside, ignore_errors=True)


def _load_header(folder: Path) -> _Header:
    path = folder / HEADER_FILE
    if not path.is_file():
        found = f"a folder without {HEADER_FILE}" if folder.is_dir() else "no such folder"
        raise EnvironmentDataError(f"expected an environment folder, was {found}.\nFolder: {folder}")
    try:
        text = read_regular_file(path, max_bytes=_MAX_HEADER_BYTES).decode()
        _check_nesting(text)
        values = yaml.load(text, Loader=_YAML_LOADER)
    # Numbers of thousands of digits, impossible dates and empty numbers (`!!int ""`) raise no YAMLError.
    except (OSError, yaml.YAMLError, ValueError, LookupError, AttributeError, RecursionError) as error:
        raise data_error(path, "YAML", str(error)) from error
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        found = repr(values.get("format")) if isinstance(values, dict) else type(values).__name__
        raise data_error(path, f"format: {FORMAT}", found)
    try:
        return _Header.model_validate(values)
    except ValidationError as error:
        lines = [f"{HEADER_FILE}: {problem}." for problem in describe_validation_errors(error)]
        raise EnvironmentDataError("\n".join([*lines, f"File: {path}"])) from error


# The parser in C makes one nested call for each level, until the process crashes.
def _check_nesting(text: str) -> None:
    codes = np.frombuffer(text.encode(), np.uint8)
    opens, closes = (np.isin(codes, np.frombuffer(marks, np.uint8)) for marks in (b"[{", b"]}"))
    depth = np.cumsum(opens.astype(np.int64) - closes)
    if depth.max(initial=0) > _DEEPEST or re.search(rf"^[ ?:-]{{{_DEEPEST}}}", text, re.MULTILINE):
        raise ValueError(f"nested more than {_DEEPEST} times")


def _load_occupancy(path: Path, grid: Grid) -> NDArray[np.uint8]:
    occupancy = _load_array(path, np.dtype(np.uint8), grid.shape)
    if occupancy.max(initial=0) > max(Cell):
        codes = ", ".join(f"{cell.value} {cell.name.lower()}" for cell in Cell)
        raise data_error(path, codes, str(occupancy.max()))
    return occupancy


def _load_k_epsilon(path: Path, grid: Grid) -> NDArray[np.float32]:
    k_epsilon = _load_array(path, np.dtype("<f4"), (*grid.shape, 2))
    # A comparison with NaN is false.
    if not bool(((k_epsilon >= 0) & (k_epsilon < np.inf)).all()):
        raise data_error(path, "finite values of at least 0", "something else")
    return k_epsilon


def _load_array(path: Path, dtype: np.dtype[Any], shape: tuple[int | None, ...]) -> NDArray[Any]:
    array = load_npy(path)
    is_shape = array.ndim == len(shape) and all(want in (None, n) for want, n in zip(shape, array.shape, strict=True))
    if not is_shape or array.dtype != dtype or array.shape[0] == 0:
        want = f"{dtype.name} ({', '.join('t >= 1' if n is None else str(n) for n in shape)})"
        raise data_error(path, f"{want}, as in the grid of {HEADER_FILE}", f"{array.dtype.name} {array.shape}")
    return array if array.flags.c_contiguous else freeze_array(np.ascontiguousarray(array))


# The sum of squares of a frame is finite exactly when all its values are (winds are far below 1e19 m/s), and takes one
# pass without temporary arrays.
def _check_finite(velocity_m_s: NDArray[np.float32], path: Path) -> None:
    for i, frame in enumerate(velocity_m_s):
        values = frame.reshape(-1)
        with np.errstate(all="ignore"):
            is_finite = np.isfinite(np.dot(values, values))
        if not is_finite:
            bad = np.argwhere(~np.isfinite(frame))
            found = f"{len(bad)} that are not, the first at {tuple(bad[0].tolist())}" if len(bad) else "above 1e19 m/s"
            raise data_error(path, "finite velocities", f"{found} of frame {i}")
