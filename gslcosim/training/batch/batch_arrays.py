"""The arrays that the kernels of the batch work on: all cases, all searches, and the scratch of a thread."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gslcosim.training.batch.batch_records import CASES, MOST_GASES, WORK


class Cases(NamedTuple):
    """All cases, read-only: (n,) records of `ROOM`, `CASE`, `records.CONSTANTS`, `PLUME` and `TAPE`, and their arrays.

    `strengths` [ppm m3] and `gas_of_source` (n,) of the sources of filaments; `instruments` (n_cases, n_sensors)
    records of `INSTRUMENT`; `names` bytes of their random streams; `start_rows` (n, 8) place, velocity, whether
    something forbidden and whether anything touches it at the end of each tick in which a vehicle leaves what it stands
    on; `sources_m` (n, 3); `places_m` (n_cases, n_places, 3) of the sensors in the body frame [m].
    """

    rooms: Any
    cases: Any
    vehicles: Any
    plumes: Any
    tapes: Any
    strengths: Any
    gas_of_source: Any
    instruments: Any
    names: Any
    start_rows: Any
    sources_m: Any
    places_m: Any


class Searches(NamedTuple):
    """All searches: (n,) records of `SEARCH` and `records.STATE`, (n, n_sensors) of `GAUGE`, and (n, n_memory) numbers.

    The latter are samples of late, see `sensing_kernels`, and knots of the (n, n_wanders) records of `WANDER`.
    """

    searches: Any
    paths: Any
    gauges: Any
    memory: Any
    wanders: Any


class Work(NamedTuple):
    """Scratch of one thread: (1,) record of `WORK`, and the arrays that it points into."""

    record: Any
    kept: tuple[Any, ...]


class Touch(NamedTuple):
    """A vehicle after a tick in which it may have touched something: `is_touched` (1,) whether it has.

    `rotation` (9,) are the rows of the matrix that turns body-frame into world-frame vectors; `places_m` and
    `velocity_m_s` (n_places, 3) are those of its sensors, world frame.
    """

    is_touched: Any
    rotation: Any
    places_m: Any
    velocity_m_s: Any


def new_touch(n_places: int) -> Touch:
    """Return what is filled in where a vehicle touches something."""
    places_m = np.zeros((n_places, 3))
    return Touch(
        is_touched=np.zeros(1, np.int64), rotation=np.zeros(9), places_m=places_m, velocity_m_s=places_m.copy()
    )


def new_work(n_places: int, most_filaments: int, state_dtype: np.dtype[Any]) -> Work:
    """Return the scratch of a thread.

    Args:
        n_places: Places that are sampled for a vehicle.
        most_filaments: How many filaments a frame of a tape has at most.
        state_dtype: `records.STATE`.
    """
    record = np.zeros(1, WORK)
    arrays = {
        "paths": np.zeros(2, state_dtype),
        "places_m": np.zeros((n_places, 3)),
        "velocity_m_s": np.zeros((n_places, 3)),
        "wind_m_s": np.zeros((n_places, 3)),
        "ppm": np.zeros((n_places, MOST_GASES)),
        "hits": np.zeros(most_filaments, np.int32),
        "slots": np.zeros(most_filaments, np.int32),
        "marks": np.zeros(most_filaments // 64 + 1, np.uint64),
        "is_nearby": np.zeros(most_filaments, np.uint8),
    }
    record["n_places"], record["most_filaments"] = n_places, most_filaments
    for name, array in arrays.items():
        record[name] = array.ctypes.data
    return Work(record=record, kept=tuple(arrays.values()))


def record_of(cases: Cases) -> NDArray[np.void]:
    """Return the (1,) record of `CASES` that points into cases, which have to be kept."""
    record = np.zeros(1, CASES)
    for name, array in cases._asdict().items():
        assert array.flags.c_contiguous, name
        record[name] = array.ctypes.data
        if f"n_{name}" in (CASES.names or ()):
            record[f"n_{name}"] = len(array)
    record["n_cases"], record["n_sensors"] = cases.instruments.shape
    record["n_places"] = cases.places_m.shape[1]
    return record
