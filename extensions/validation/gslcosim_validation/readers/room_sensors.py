"""Gas sensors in a room: `experiments.csv`, `sensors.csv`, `room.json`, `expNN.csv` (27 in an office of Örebro)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim_validation.readers.columns import Columns, build_error, find_table, read_columns
from gslcosim_validation.readers.documents import Document, read_document

# Steps of the clock beyond this are gaps.
LONGEST_GAP_S = 60.0


@dataclass(frozen=True)
class RoomExperiment:
    """One experiment.

    `number` as in the table; `time_s` (n,); `readings_ppm` (n, k) of the sensors in their order, in a unit that is
    comparable within one sensor only; `temperature_c` (n, m) of the nodes on desks, m = 0 without; `wind_m_s` (n,)
    speed at the anemometer; `is_window_open`; `airflow` what moved the air; `gas_seen_s` when gas was first seen, None
    where the table has no time.
    """

    number: int
    source_m: Vec3
    airflow: str
    is_window_open: bool
    time_s: NDArray[np.float64]
    readings_ppm: NDArray[np.float64]
    temperature_c: NDArray[np.float64]
    wind_m_s: NDArray[np.float64]
    gas_seen_s: float | None


@dataclass(frozen=True)
class RoomSensors:
    """A room with sensors in it, and experiments with one source each.

    `corners_m` (m, 2) of the floor, in order; `height_m`; `sensors` names of columns, (k,) in the order of the
    readings; `positions_m` (k, 3); `plateau_ratio` (k,) a sensor's reading over the median sensor's when the room is
    mixed, nan where unknown; `supply_m` (2,) where the air comes in at the floor; `window_m` the corners of the window
    that can open, on the wall of the largest x, None where unknown.
    """

    corners_m: NDArray[np.float64]
    height_m: float
    supply_m: tuple[float, float] | None
    window_m: tuple[Vec3, Vec3] | None
    sensors: tuple[str, ...]
    positions_m: NDArray[np.float64]
    plateau_ratio: NDArray[np.float64]
    experiments: tuple[RoomExperiment, ...]


def read_room_sensors(folder: Path) -> RoomSensors:
    """Return the set in a folder."""
    room = read_document(folder / "room.json")
    sensors, table = read_columns(folder / "sensors.csv"), read_columns(folder / "experiments.csv")
    names = sensors.words("column")
    corners = room.get("floor_corners_m")
    if not isinstance(corners, list) or len(corners) < 3:
        raise build_error(room.path, "floor_corners_m", expected="three corners or more", found=repr(corners)[:40])
    supply = room.get("air_supply", "near_m")
    return RoomSensors(
        corners_m=np.array(corners, dtype=np.float64),
        height_m=room.number("height_m", "value"),
        supply_m=None if supply is None else (float(supply[0]), float(supply[1])),
        window_m=_read_window(room, max(float(corner[0]) for corner in corners)),
        sensors=names,
        positions_m=sensors.matrix(["x_m", "y_m", "z_m"]),
        plateau_ratio=sensors.optional_numbers("plateau_ratio_median"),
        experiments=tuple(_read_experiment(folder, table, i, names) for i in range(table.n_rows)),
    )


def _read_window(room: Document, x_m: float) -> tuple[Vec3, Vec3] | None:
    if room.get("window") is None:
        return None
    y_m, z_m, width_m, height_m = (
        room.number("window", name) for name in ("centre_y_m", "centre_z_m", "width_m", "height_m")
    )
    return (x_m, y_m - width_m / 2, z_m - height_m / 2), (x_m, y_m + width_m / 2, z_m + height_m / 2)


def _read_experiment(folder: Path, table: Columns, i: int, sensors: tuple[str, ...]) -> RoomExperiment:
    number = int(table.numbers("experiment")[i])
    log = read_columns(find_table(folder, f"exp{number:02d}"))
    theirs = tuple(name for name in log.texts if name.startswith("c_"))
    if set(theirs) != set(sensors):
        found = ", ".join(sorted(set(theirs) ^ set(sensors))[:4])
        raise build_error(
            log.path,
            "",
            expected=f"the {len(sensors)} sensors of sensors.csv",
            found=f"others ({found})",
            remedy="Take the table of sensors of the same installation.",
        )
    nodes = [name for name in log.texts if name.startswith("temperature_")]
    seen_min = table.optional_numbers("gas_seen_from_min")[i]
    return RoomExperiment(
        number=number,
        source_m=table.point("source", i),
        airflow=table.words("artificial_airflow")[i],
        is_window_open=table.words("window")[i] != "closed",
        time_s=log.rising_s(may_repeat=True, longest_gap_s=LONGEST_GAP_S),
        readings_ppm=log.matrix(sensors, allow_gaps=True),
        temperature_c=np.stack([log.optional_numbers(name) for name in nodes], axis=1)
        if nodes
        else np.zeros((log.n_rows, 0)),
        wind_m_s=log.optional_numbers("wind_speed_m_s"),
        gas_seen_s=None if np.isnan(seen_min) else 60.0 * float(seen_min),
    )
