"""Writer of gas frames in GSL-Bench's layout, for tests of the reader."""

import gaden_writers as gaden
import numpy as np

HEAD = np.dtype(
    [
        ("h", "<u4"),
        *((f"env_{end}_{axis}", "<f8") for end in ("min", "max") for axis in "xyz"),
        *((f"env_cells_{axis}", "<u4") for axis in "xyz"),
        *((f"cell_size_{axis}", "<f8") for axis in "xyz"),
        *((f"gas_source_pos_{axis}", "<f8") for axis in "xyz"),
        ("gas_type", "<u4"),
        ("filament_num_moles_of_gas", "<f8"),
        ("num_moles_all_gases_in_cm3", "<f8"),
        ("binary_bool", "<u4"),
    ]
)
RECORD = np.dtype([("id", "<u4"), ("pose_x", "<f8"), ("pose_y", "<f8"), ("pose_z", "<f8"), ("sigma", "<f8")])


def write_frame(
    folder,
    *,
    number=0,
    positions_m=gaden.POSITIONS_M,
    sigmas_cm=gaden.SIGMAS_CM,
    source_m=gaden.SOURCE_M,
    gas_code=gaden.GAS_CODE,
):
    """Write a frame into a folder; by default frame 0, with what GADEN's writers have."""
    head = (
        1, *gaden.MIN_M, *gaden.MAX_M, *gaden.CELLS, *(gaden.CELL_M,) * 3, *source_m, gas_code, gaden.MOLES,
        gaden.AIR, 0,
    )  # fmt: skip
    rows = [(i, *p, s) for i, (p, s) in enumerate(zip(positions_m.tolist(), sigmas_cm, strict=True))]
    np.save(folder / f"iteration_{number}_head.npy", np.array([head], HEAD))
    np.save(folder / f"iteration_{number}_fil.npy", np.array(rows, RECORD))
