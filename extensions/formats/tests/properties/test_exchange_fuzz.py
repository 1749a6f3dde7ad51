"""Damaged files of rooms and wind: a clear error or a read of what can be, never a crash or a number that cannot be.

None of the formats but our own has a checksum, so a digit that became another is not noticed. What is read must be
possible: finite, of the grid's shape, with codes that there are, no faster than sound can tell.
"""

import json
import struct

import numpy as np
import pytest
from damaged_files import FileFuzzer

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.model import Grid, WindFrames, with_wind
from gslcosim.environment.store import load_environment, save_environment
from gslcosim_formats.data_files import LARGEST_SPEED_M_S
from gslcosim_formats.environment_folders import (
    geometry_from_grid,
    load_gaden_geometry,
    load_gsl_bench_geometry,
)
from gslcosim_formats.export import export_environment
from gslcosim_formats.wind_files import NoWindWarning, WindGapsWarning, load_wind

GRID = Grid(origin_m=(0.0, -1.0, 0.5), cell_m=0.5, shape=(4, 3, 2))
FOAM_HEAD = 'FoamFile\n{{\n format {form};\n arch "LSB;label=32;scalar=64";\n}}\n'
# What readers of text stumble over.
WORDS = [
    b"nan", b"inf", b"-inf", b"1e400", b"1e10", b"10000000000", b"-1", b"0", b"1.5", b"", b";", b",", b"#", b"\n",
    b"\r", b"\xff", b"\0", b'"', b"9" * 5000, b"1_0", b"0x10", b"[", b"}", b"(", b")", b" ", b"&a", b"*a", b"!!int",
]  # fmt: skip
# What readers of binary files stumble over.
NUMBERS = [
    *(struct.pack("<i", n) for n in (0, -1, 999, 2**31 - 1)),
    *(struct.pack(form, x) for form in ("<f", "<d") for x in (np.nan, np.inf, 1e30, -1e30, 5e-324, 340.0)),
]
# Files of an exported or saved environment that are read, by kind.
WIND_KINDS = ("components", "components_text", "points", "iterations")


def foam(values, *, is_binary):
    vectors = values.reshape(-1, 3)
    head = FOAM_HEAD.format(form="binary" if is_binary else "ascii")
    rows = "\n" + "\n".join(f"({x!r} {y!r} {z!r})" for x, y, z in vectors.tolist()) + "\n"
    data = vectors.astype("<f8").tobytes() if is_binary else rows.encode()
    return f"{head}internalField nonuniform List<vector> {len(vectors)}\n(".encode() + data + b");\n"


class Fuzzer(FileFuzzer):
    """One small environment in all formats; damages a file of each, reads, and counts what came of it."""

    blocks, words = NUMBERS, WORDS
    ignored_warnings = (NoWindWarning, WindGapsWarning)

    def __init__(self, folder, seed):
        super().__init__(folder, seed)
        codes = np.zeros(GRID.shape, np.uint8)
        codes[1, 1], codes[3, 0] = 1, 2
        wind = np.random.default_rng(1).normal(size=(2, *GRID.shape, 3)).astype(np.float32)
        self.environment = with_wind(geometry_from_grid("shed", GRID, codes), WindFrames(velocity_m_s=wind))
        save_environment(self.environment, folder / "own")
        for kind in WIND_KINDS:
            export_environment(self.environment, folder / kind, "gaden", gaden_wind=kind)
        export_environment(self.environment, folder / "gsl_bench", "gsl_bench")
        export_environment(self.environment, folder / "openfoam_points", "openfoam_points")
        (folder / "uniform").mkdir()
        (folder / "uniform" / "uniform.csv").write_text("1,0,0\n0.5,0.25,0\n")
        for name in ("ascii", "binary"):
            (folder / name / "5").mkdir(parents=True)
            for file, values in (("C", GRID.centres_m()), ("U", wind[0])):
                (folder / name / "5" / file).write_bytes(foam(values, is_binary=name == "binary"))
        self.cases = [(path, self.reader_of(path)) for path in sorted(folder.rglob("*")) if path.is_file()]
        self.cases = [(path, reader) for path, reader in self.cases if reader is not None]

    def reader_of(self, path):
        """Return what reads a file, if anything does."""
        top = self.folder / path.relative_to(self.folder).parts[0]
        if top.name == "own":
            return lambda: self.check_own(top)
        if path.name == "OccupancyGrid3D.csv":
            return lambda: self.check_room(load_gaden_geometry(top))
        if path.parent.name == "occupancy":
            return lambda: self.check_room(load_gsl_bench_geometry(top))
        if top.name in ("ascii", "binary"):
            return lambda: self.check_wind(top)
        if path.suffix == ".stl":
            return None
        return lambda: self.check_wind(path.parent)

    def round(self):
        for path, read in self.cases:
            self.try_file(path, read)

    def check_wind(self, path):
        frames = load_wind(path, GRID, occupancy=self.environment.occupancy)
        assert frames.velocity_m_s.shape[1:] == (*GRID.shape, 3)
        assert frames.velocity_m_s.dtype == np.float32
        assert (np.abs(frames.velocity_m_s) <= LARGEST_SPEED_M_S).all()

    def check_room(self, room):
        assert room.occupancy.shape == room.grid.shape
        assert set(np.unique(room.occupancy)) <= {0, 1, 2}
        assert np.isfinite([*room.grid.origin_m, *room.grid.max_m, room.grid.cell_m]).all()

    # Ours carries a hash of all that matters.
    def check_own(self, folder):
        load_environment(folder)
        back = load_environment(folder)
        assert back.grid == self.environment.grid
        np.testing.assert_array_equal(back.occupancy, self.environment.occupancy)
        np.testing.assert_array_equal(back.wind.velocity_m_s, self.environment.wind.velocity_m_s)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_damaged_files_are_refused_or_can_be(tmp_path, seed):
    fuzzer = Fuzzer(tmp_path, seed)
    for _ in range(60):
        fuzzer.round()
    assert fuzzer.n_refused > 500
    assert fuzzer.n_read > 50


@pytest.mark.parametrize("n", ["10000000000", "100000"])
def test_absurd_counts_cost_no_memory(tmp_path, n):
    """A terabyte that a head promises is never asked for: what the file holds is looked at first."""
    (tmp_path / "OccupancyGrid3D.csv").write_text(
        f"#env_min(m) 0 0 0\n#env_max(m) {n} 100 100\n#num_cells {n} 100 100\n#cell_size(m) 1\n0 0\n;\n"
    )
    with pytest.raises(EnvironmentDataError):
        load_gaden_geometry(tmp_path)
    head = {"env_min": [0, 0, 0], "env_max": [int(n), 100, 100], "num_cells": [int(n), 100, 100], "cell_size": 1}
    (tmp_path / "occupancy").mkdir()
    (tmp_path / "occupancy" / "a_head.txt").write_text(json.dumps(head))
    header = f"{{'descr': '<i8', 'fortran_order': False, 'shape': (100, {n}, 100), }}".ljust(117) + "\n"
    content = b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header.encode()
    (tmp_path / "occupancy" / "a_grid.npy").write_bytes(content)
    with pytest.raises(EnvironmentDataError):
        load_gsl_bench_geometry(tmp_path)


@pytest.mark.soak
@pytest.mark.timeout(1200)
def test_ten_minutes_of_damaged_files(tmp_path):
    """A new seed each time; a failure names it."""
    assert Fuzzer.run_for(tmp_path, 600.0).n_refused > 5000
