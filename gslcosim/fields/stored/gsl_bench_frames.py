"""Reader of AutoGDM+'s and GSL-Bench's gas frames: `iteration_i_fil.npy` beside `iteration_i_head.npy`."""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import EnvironmentDataError
from gslcosim.fields.stored.frame import (
    GasFrame,
    edge_of_cube,
    filaments_of_frame,
    gas_of_code,
    grid_of_frame,
    place_of_source,
)
from gslcosim.quantities import Vec3

_RECORD_KINDS = {"pose_x": "f", "pose_y": "f", "pose_z": "f", "sigma": "f"}
_HEAD_KINDS = {
    **{f"env_{end}_{axis}": "f" for end in ("min", "max") for axis in "xyz"},
    **{f"env_cells_{axis}": "iu" for axis in "xyz"},
    **{f"{name}_{axis}": "f" for name in ("cell_size", "gas_source_pos") for axis in "xyz"},
    "gas_type": "iu",
    "filament_num_moles_of_gas": "f",
    "num_moles_all_gases_in_cm3": "f",
}


def read_gsl_bench_frame(filaments_path: Path) -> GasFrame:
    """Read one frame: the filaments of `iteration_i_fil.npy` and the head of `iteration_i_head.npy` beside it.

    Raises:
        EnvironmentDataError: a file is missing, truncated, not of this kind, or holds impossible values.
    """
    head_path = filaments_path.with_name(filaments_path.name.replace("_fil.npy", "_head.npy"))
    heads = _load(head_path, _HEAD_KINDS)
    if len(heads) != 1:
        raise EnvironmentDataError(f"gas frame: expected one head, was {len(heads)}. File: {head_path}")
    head = {name: heads[name][0].item() for name in _HEAD_KINDS}
    records = _load(filaments_path, _RECORD_KINDS)
    grid = grid_of_frame(
        head_path,
        min_m=_vector(head, "env_min"),
        max_m=_vector(head, "env_max"),
        cell_m=edge_of_cube(head_path, _vector(head, "cell_size")),
        shape=(head["env_cells_x"], head["env_cells_y"], head["env_cells_z"]),
    )
    return GasFrame(
        version="gsl_bench",
        grid=grid,
        gas=gas_of_code(head_path, head["gas_type"]),
        source_position_m=place_of_source(head_path, grid, _vector(head, "gas_source_pos")),
        wind_index=0,
        filaments=filaments_of_frame(
            filaments_path,
            grid,
            position_m=np.stack([records[f"pose_{axis}"].astype(np.float64) for axis in "xyz"], axis=1),
            sigma_cm=records["sigma"].astype(np.float64),
            amount_mol=head["filament_num_moles_of_gas"],
            air_mol_cm3=head["num_moles_all_gases_in_cm3"],
        ),
    )


def _vector(head: dict[str, float], name: str) -> Vec3:
    return (head[f"{name}_x"], head[f"{name}_y"], head[f"{name}_z"])


# Mapped and not read: a head that promises more than the file holds is then refused before memory is asked for.
def _load(path: Path, kinds: dict[str, str]) -> NDArray:
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
