"""Gas tape: the filaments of a whole run, computed once, memory-mapped and shared by all runs with the same gas.

A tape is a folder in the cache, named by a hash of all that determines the gas, so it is never stale:

    head.json       format, number of frames, of filaments in all and of sources
    first.npy       (n_frames + 1,) int64: frame k holds the filaments first[k] to first[k + 1] - 1
    filaments.npy   (n, 4) float32: x, y, z and sigma, world frame [m]
    sources.npy     (n,) uint8: index of the source that released it; only with several sources
    checksums.json  hashes of these files, signed with the key of the cache; see `gslcosim.base.checksums`

That is 16 or 17 bytes for each filament and tick. Arrays are numpy's own format, C order, little-endian.
"""

import hashlib
import json
import logging
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.checksums import check_files, write_checksums
from gslcosim.base.code_identity import hash_code, list_package_files
from gslcosim.base.disk_cache import keep_within_limit, mark_used
from gslcosim.base.errors import EnvironmentDataError, ModelError
from gslcosim.base.files import remove_tree
from gslcosim.base.kernel_cache import get_cache_root
from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.base.untrusted_input import MalformedFileError, read_json
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim_services.fields.filament.downwash import Jets
from gslcosim_services.fields.filament.plume import FilamentPlume, Filaments
from gslcosim_services.fields.gas_setup import gas_timing

TAPE_FORMAT = "gslcosim/gas_tape/1"
MAX_SOURCES = 256
_HEAD, _FIRST, _FILAMENTS, _SOURCES = "head.json", "first.npy", "filaments.npy", "sources.npy"
# A tape depends on all settings of the scenario's gas but these; the seed enters the hash by itself.
_IRRELEVANT_SETTINGS = {"tape", "seed"}
_SOURCE_FILES = (
    *(f"gslcosim_services/fields/{name}" for name in (
        "filament", "models", "turbulence", "gas_setup.py", "tape.py",
    )),
    *(f"gslcosim/{name}" for name in (
        "environment/model.py", "environment/grid_kernels.py", "base/gases.py", "base/rng.py",
    )),
)  # fmt: skip

_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class TapeSchedule:
    """Schedule of a tape: `n_frames` gas steps from `first_step` on, `stride` steps apart."""

    first_step: int
    stride: int
    n_frames: int

    @classmethod
    def of(cls, scenario: Scenario) -> "TapeSchedule":
        """Return the schedule of a run up to its time limit."""
        timing = gas_timing(scenario)
        n_ticks = ticks_from_seconds(scenario.referee.stop.time_limit_s, scenario.tick_ns)
        return cls(
            first_step=timing.warm_up_steps,
            stride=timing.steps_per_tick,
            n_frames=n_ticks // timing.ticks_per_step + 1,
        )

    def frame_at(self, step: int) -> int:
        """Return the number of the frame at a step; past the end the last one stays (a run is over then)."""
        frame, rest = divmod(step - self.first_step, self.stride)
        if rest or frame < 0:
            raise ModelError(
                f"gas tape: expected step {self.first_step} or a multiple of {self.stride} after it, was {step}."
            )
        return min(frame, self.n_frames - 1)


class _TapeHead(TypedDict):
    format: str
    n_frames: int
    n_filaments: int
    n_sources: int


class GasTape:
    """A tape in a folder, read-only and memory-mapped."""

    def __init__(self, folder: Path, *, is_new: bool = False) -> None:
        """Open a tape.

        Args:
            is_new: True if this process has just recorded it: then its content is not compared with its checksums.
        """
        try:
            # Compiled code reads it, and does not check the positions in it.
            if not (is_new or check_files(folder, _HEAD, _FIRST, _FILAMENTS, _SOURCES)):
                raise ValueError("not signed with the key of this cache")
            head = read_json(folder / _HEAD, _TapeHead)
            self._first = np.load(folder / _FIRST, allow_pickle=False)
            self._filaments = _map_array(folder / _FILAMENTS)
            self._sources = _map_array(folder / _SOURCES) if head["n_sources"] > 1 else None
            is_whole = (
                head["format"] == TAPE_FORMAT
                and self._first.shape == (head["n_frames"] + 1,)
                and self._filaments.shape == (head["n_filaments"], 4)
                and int(self._first[-1]) == head["n_filaments"]
                and (self._sources is None or len(self._sources) == head["n_filaments"])
            )
        except (OSError, ValueError, EOFError, MalformedFileError) as error:
            raise EnvironmentDataError(
                f"gas tape: expected a whole one, was not ({error}). Folder: {folder}"
            ) from error
        if not is_whole:
            raise EnvironmentDataError(f"gas tape: expected a whole one of format {TAPE_FORMAT}. Folder: {folder}")

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self._first) - 1

    @property
    def n_bytes(self) -> int:
        """Size of the filaments on disk."""
        return int(self._filaments.nbytes + (0 if self._sources is None else self._sources.nbytes))

    @property
    def arrays(self) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.uint8] | None]:
        """Start of each frame, all filaments and their sources (absent: there is one), as they are on disk."""
        return self._first, self._filaments, self._sources

    def frame(self, number: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return the (n, 4) filaments of a frame, x, y, z and sigma [m], and the (n,) sources that released them."""
        some = slice(int(self._first[number]), int(self._first[number + 1]))
        n = some.stop - some.start
        sources = np.zeros(n, np.int32) if self._sources is None else self._sources[some].astype(np.int32)
        return self._filaments[some], sources


def record_tape(plume: FilamentPlume, schedule: TapeSchedule, folder: Path) -> None:
    """Advance a plume from time 0 and record the frames that a run reads.

    Several processes may record the same tape at the same time: the first to finish keeps its folder.

    Args:
        schedule: Steps of the frames.
        folder: Folder of the tape; its parents are made.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        _record(plume, schedule, beside)
        write_checksums(beside, *(path.name for path in sorted(beside.iterdir())), place=folder.name)
        beside.rename(folder)
    except OSError:
        if not folder.is_dir():
            raise
    finally:
        remove_tree(beside, ignore_errors=True)


class CachedPlume:
    """Plume cached on tape, recorded first where there is none yet; see `FilamentSource`."""

    def __init__(self, plume_of: Callable[[int], FilamentPlume], scenario: Scenario, environment: Environment) -> None:
        """Prepare the playback.

        Args:
            plume_of: Builds the live plume of a seed, at time 0.
        """
        self._plume_of = plume_of
        self._scenario = scenario
        self._environment = environment
        self._schedule = TapeSchedule.of(scenario)
        self._step_s = gas_timing(scenario).step_s
        self._tapes_dir = get_cache_root() / "tapes"
        live = plume_of(scenario.seed).filaments
        self._amount_mol, self._gas_index = live.amount_mol, live.gas_index
        # The tape of a seed; none before the first reset.
        self._seed: int | None = None
        self._tape: GasTape | None = None
        self._step = 0

    @property
    def tape(self) -> GasTape:
        """The tape of the seed of the last reset."""
        assert self._tape is not None, "reset comes first"
        return self._tape

    @property
    def sources(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Amount in a filament of each source [mol], and its gas."""
        return self._amount_mol, self._gas_index

    @property
    def step(self) -> int:
        """Number of steps made."""
        return self._step

    @property
    def time_s(self) -> float:
        """Time since the sources opened [s]."""
        return self._step * self._step_s

    @property
    def filaments(self) -> Filaments:
        """The filaments now."""
        return self.filaments_of_frame(self._schedule.frame_at(self._step))

    def filaments_of_frame(self, number: int) -> Filaments:
        """Return the filaments of a frame of the tape."""
        rows, sources = self.tape.frame(number)
        return Filaments(
            position_world_m=rows[:, :3],
            sigma_m=rows[:, 3],
            source_index=sources,
            amount_mol=self._amount_mol,
            gas_index=self._gas_index,
            is_rounded=True,
        )

    def reset(self, seed: int) -> None:
        """Return to time 0, with the tape of a seed."""
        self._step = 0
        if seed != self._seed:
            self._tape = self._open(seed)
            self._seed = seed

    def advance(self, n_steps: int = 1) -> None:
        """Go on by steps."""
        self._step += n_steps

    def blow(self, jets: Jets) -> None:
        """Raise an error: filaments on tape cannot be moved."""
        del jets
        raise ModelError("gas tape: expected gas that no vehicle moves, was to be blown away.")

    def _open(self, seed: int) -> GasTape:
        folder = self._tapes_dir / tape_hash(self._scenario, self._environment, seed)
        mark_used(folder)
        try:
            return GasTape(folder)
        except EnvironmentDataError as error:
            if folder.exists():
                _log.warning("A gas tape in the cache is damaged and is recorded anew: %s", error)
                remove_tree(folder, ignore_errors=True)
        record_tape(self._plume_of(seed), self._schedule, folder)
        keep_within_limit()
        return GasTape(folder, is_new=True)


def tape_hash(scenario: Scenario, environment: Environment, seed: int) -> str:
    """Return 32 hexadecimal digits of all that determines a tape's content, the code included."""
    recipe: dict[str, Any] = {
        "format": TAPE_FORMAT,
        "gas": scenario.gas.model_dump(mode="json", exclude=_IRRELEVANT_SETTINGS),
        "seed": seed,
        "tick_ns": scenario.tick_ns,
        "n_frames": TapeSchedule.of(scenario).n_frames,
        "environment": environment.content_hash,
        "packages": {name: version(name) for name in ("numpy", "numba", "llvmlite", "scipy")},
    }
    digest = hashlib.blake2b(json.dumps(recipe, sort_keys=True).encode(), digest_size=16)
    digest.update(hash_code(list_package_files(*_SOURCE_FILES)).encode())
    return digest.hexdigest()


def _record(plume: FilamentPlume, schedule: TapeSchedule, folder: Path) -> None:
    n_sources = len(plume.filaments.gas_index)
    first = [0]
    plume.advance(schedule.first_step)
    with (folder / "rows").open("wb") as rows, (folder / "row_sources").open("wb") as row_sources:
        for frame in range(schedule.n_frames):
            plume.advance(0 if frame == 0 else schedule.stride)
            filaments = plume.filaments
            both = np.hstack([filaments.position_world_m, filaments.sigma_m[:, None]])
            rows.write(both.astype("<f4").tobytes())
            row_sources.write(filaments.source_index.astype(np.uint8).tobytes())
            first.append(first[-1] + len(both))
    _convert_to_array(folder / "rows", folder / _FILAMENTS, np.dtype("<f4"), (first[-1], 4))
    if n_sources > 1:
        _convert_to_array(folder / "row_sources", folder / _SOURCES, np.dtype(np.uint8), (first[-1],))
    for name in ("rows", "row_sources"):
        (folder / name).unlink()
    np.save(folder / _FIRST, np.array(first, np.int64))
    head = {"format": TAPE_FORMAT, "n_frames": schedule.n_frames, "n_filaments": first[-1], "n_sources": n_sources}
    (folder / _HEAD).write_text(json.dumps(head) + "\n", encoding="utf-8")


# The head of an array holds its length, which is known only at the end.
def _convert_to_array(raw: Path, path: Path, dtype: np.dtype, shape: tuple[int, ...]) -> None:
    head = {"descr": dtype.str, "fortran_order": False, "shape": shape}
    with path.open("wb") as file, raw.open("rb") as content:
        np.lib.format.write_array_header_1_0(file, head)
        shutil.copyfileobj(content, file, 1 << 20)


def _map_array(path: Path) -> NDArray[Any]:
    if path.stat().st_size < 256 and not len(array := np.load(path, allow_pickle=False)):
        return array
    # A plain view: compiled kernels have a fast path for arrays, and a slow one for memmap objects.
    return np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
