"""Rooms as logs of the suite `measured`: what estimators see, and what is scored of it."""

import json

import numpy as np
import pytest

from gslcosim_bench.results import Results
from gslcosim_bench.store import ResultsFolder
from gslcosim_validation import read_measured
from gslcosim_validation.measured_suite.logs import load_log_cases
from gslcosim_validation.measured_suite.room_estimators import ROOM_ENTRIES
from gslcosim_validation.measured_suite.run import choose_entries, run_entry, run_measured

PLACES_M = {f"c_{i}{j}_ppm": (1.0 + 2.0 * i, 1.0 + 2.0 * j, 1.0) for i in range(3) for j in range(3)}
CORNERS_M = [[0, 0], [6, 0], [6, 6], [0, 6]]
NEAR = ("c_00_ppm", "c_11_ppm")
N_SECONDS, OPENED_S = 3900, 600


def write_room(folder, *, seconds=N_SECONDS):
    """Write two experiments: gas comes in whiffs to the sensor beside the source, and first; others read more."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    (folder / "room.json").write_text(json.dumps({"floor_corners_m": CORNERS_M, "height_m": {"value": 3.0}}))
    rows = [f"{name},{x},{y},{z},1.0" for name, (x, y, z) in PLACES_M.items()]
    (folder / "sensors.csv").write_text("\n".join(["column,x_m,y_m,z_m,plateau_ratio_median", *rows]) + "\n")
    table = ["experiment,source_x_m,source_y_m,source_z_m,artificial_airflow,window,gas_seen_from_min"]
    for number, near in enumerate(NEAR, 1):
        x_m, y_m, z_m = PLACES_M[near]
        table.append(f"{number},{x_m + 0.5},{y_m},{z_m},off,closed,10.5")
        time_s = np.arange(float(seconds))
        readings = rng.normal(1.0, 0.01, (seconds, len(PLACES_M)))
        for k, name in enumerate(PLACES_M):
            is_near = name == near
            since_s = np.clip(time_s - OPENED_S - (0.0 if is_near else 120.0 + 10.0 * k), 0.0, None)
            level = (2.0 if is_near else 3.0 + k) * (1.0 - np.exp(-since_s / 600.0))
            readings[:, k] += level * (1.0 + (np.sin(time_s / 5.0) if is_near else 0.0))
        lines = [
            "time_s," + ",".join(PLACES_M),
            *(",".join(f"{x:.3f}" for x in row) for row in np.c_[time_s, readings]),
        ]
        (folder / f"exp{number:02d}.csv").write_text("\n".join(lines) + "\n")
    (folder / "experiments.csv").write_text("\n".join(table) + "\n")
    return folder


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return write_room(tmp_path_factory.mktemp("data") / "our_room")


def run_all(folder):
    """Return the outcomes of each entry of rooms."""
    (case,) = load_log_cases(read_measured(folder))
    results = {entry.name: run_entry(entry, case) for entry in ROOM_ENTRIES}
    assert not [result.fault for result in results.values() if result.fault]
    return {name: tuple(each.outcome for each in result.score.releases) for name, result in results.items()}


def test_each_estimator_goes_by_what_it_says(room):
    assert run_all(room) == {
        "liveliest_sensor": ("exact", "exact"),
        "first_sensor": ("exact", "exact"),
        "nearest_sensor": ("touched", "touched"),
    }


def test_an_experiment_that_ends_before_the_gas_has_no_place(tmp_path):
    outcomes = run_all(write_room(tmp_path / "room", seconds=200))
    assert set(outcomes.values()) == {("touched", "touched")}


def test_entries_of_masts_leave_rooms_alone(room, tmp_path):
    (case,) = load_log_cases(read_measured(room))
    assert {entry.name for entry in choose_entries([], [], room) if entry.can_take(case.site)} == {
        entry.name for entry in ROOM_ENTRIES
    }
    done = run_measured(room, ResultsFolder(tmp_path / "results"))
    rows = Results.load(done.folder)
    assert rows.success("oracle").value == rows.success("liveliest_sensor").value == 1.0
    assert rows.success("nearest_sensor").value == 0.0
    assert set(rows.trials["sensors"].to_pylist()) == {"room_sensor"}
    assert "| experiment=1 |" in done.page.read_text()
