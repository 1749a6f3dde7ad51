"""A frame sorted into columns gives the filaments near a place, all of them and in their order."""

import numpy as np

from gslcosim_services.world import vehicle_records
from gslcosim_training.batch import batch_records
from gslcosim_training.batch.batch_records import build_scratch
from gslcosim_training.batch.gas_readings import near_filaments_inplace, sort_frames_inplace

CUTOFF_SIGMA = 5.0


def test_the_near_filaments_of_a_frame_are_all_within_their_cut_off_in_order():
    rng = np.random.default_rng(3)
    counts = [0, 400, 1, 700]
    first = np.concatenate([[0], np.cumsum(counts)])
    rows = np.column_stack([rng.uniform(-1, 7, (sum(counts), 3)), rng.uniform(0.01, 0.3, sum(counts))])
    rows = rows.astype(np.float32)
    starts, members = np.empty((4, 6 * 5 + 1), np.int32), np.empty(len(rows), np.int32)
    numbers, largest_m = np.empty((4, len(rows)), np.float32), np.empty(4, np.float32)
    sort_frames_inplace(first, rows, np.zeros(2), 1.0, 6, 5, starts, members, numbers, largest_m)
    tape = np.zeros((), batch_records.TAPE)
    tape["n_frames"], tape["column_m"], tape["shape"] = 4, 1.0, (6, 5)
    tape["n_rows"] = len(rows)
    arrays = {
        "first": first, "starts": starts, "members": members, "sorted_numbers": numbers, "largest_sigma_m": largest_m,
    }  # fmt: skip
    for name, array in arrays.items():
        tape[name] = array.ctypes.data
    work, n_found = build_scratch(1, 700, vehicle_records.STATE), 0
    hits, marks = work.kept[5], work.kept[7]
    for frame in range(4):
        own = rows[first[frame] : first[frame + 1]].astype(np.float64)
        for place_m in rng.uniform(-2, 8, (100, 3)):
            near = np.flatnonzero(np.linalg.norm(own[:, :3] - place_m, axis=1) <= CUTOFF_SIGMA * own[:, 3])
            n = near_filaments_inplace(tape[()], frame, *place_m, CUTOFF_SIGMA, work.record[0])
            found = first[frame] + hits[:n]
            assert members[found].tolist() == near.tolist()
            assert np.array_equal(numbers[:, found].T, own.astype(np.float32)[near])
            assert not marks.any()
            n_found += n
    assert n_found > 400
