"""The arrays that the kernels of the batch work on: all cases, all searches, and the scratch of a thread."""

from typing import Any, NamedTuple

import numpy as np

from gslcosim.training.batch.batch_records import MOST_GASES, MOST_VALUES, SAMPLE_LENGTH


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

    The latter are samples of late, see `sensing_kernels`.
    """

    searches: Any
    paths: Any
    gauges: Any
    memory: Any


class Work(NamedTuple):
    """Scratch of one thread.

    `states` (3, 3, 3) and two records of `records.STATE` for planning; `places_m`, `velocity_m_s`, `ppm` and `wind_m_s`
    of the sensors' places, `rotation` nine numbers of the vehicle's; `sample`, `raw`, `parts`, `hits`, `slots`,
    `marks` and `is_nearby` for readings.
    """

    states: Any
    paths: Any
    places_m: Any
    velocity_m_s: Any
    ppm: Any
    wind_m_s: Any
    rotation: Any
    sample: Any
    raw: Any
    parts: Any
    hits: Any
    slots: Any
    marks: Any
    is_nearby: Any


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
    return Work(
        states=np.zeros((3, 3, 3)),
        paths=np.zeros(2, state_dtype),
        places_m=np.zeros((n_places, 3)),
        velocity_m_s=np.zeros((n_places, 3)),
        ppm=np.zeros((n_places, MOST_GASES)),
        wind_m_s=np.zeros((n_places, 3)),
        rotation=np.zeros(9),
        sample=np.zeros(SAMPLE_LENGTH),
        raw=np.zeros(MOST_VALUES),
        parts=np.zeros(64),
        hits=np.zeros(most_filaments, np.int32),
        slots=np.zeros(most_filaments, np.int32),
        marks=np.zeros(most_filaments // 64 + 1, np.uint64),
        is_nearby=np.zeros(most_filaments, np.bool_),
    )
