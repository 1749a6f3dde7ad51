"""Files of gas that were damaged: a clear error or a correct read, never a crash or a silent wrong number.

Where a format has a checksum (zlib, zip), what is read from damaged bytes must be what was written. Where it has none,
what is read must be possible: finite, inside the room, not negative.
"""

import struct
import zlib

import gaden_writers as gaden
import gsl_bench_writers as gsl_bench
import numpy as np
import pytest
from damaged_files import FileFuzzer

from gslcosim.environment.model import Grid
from gslcosim_formats.data_files import read_result
from gslcosim_formats.stored_gas.frame_formats import read_gaden_frame, read_gsl_bench_frame, read_walls
from gslcosim_formats.stored_gas.playback import GasMovie
from gslcosim_services.fields.mixing_ratio import mixing_ratio_ppm_at
from gslcosim_services.fields.spatial_index import FilamentIndex

CONTENTS = {
    "version_1": gaden.version_1(),
    "version_2": gaden.version_2(),
    "version_2_6": gaden.version_2_6(),
    "version_2_6_simulated": gaden.version_2_6_simulated(),
    "version_3": gaden.version_3(),
    "version_3_box": gaden.version_3("box", (0.1, 0.2, 0.3)),
    "version_3_early": gaden.version_3_early(),
    "version_3_grid": gaden.version_3_concentrations(),
}
# Numbers that readers stumble over: huge counts, negative ones, NaN, infinity, tiny and huge reals.
STUMBLING_BLOCKS = [
    *(struct.pack("<i", n) for n in (0, -1, 1, 2**31 - 1, -(2**31))),
    *(struct.pack("<Q", n) for n in (0, 2**63, 2**64 - 1)),
    *(struct.pack(layout, x) for layout in ("<f", "<d") for x in (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-30, 1e30)),
]


def check_possible(frame):
    """Fail unless what was read can be: filaments in the room, readings finite."""
    if frame.filaments is not None:
        places_m, sigma_m = frame.filaments.position_world_m, frame.filaments.sigma_m
        assert np.isfinite(places_m).all()
        assert np.isfinite(sigma_m).all()
        assert (sigma_m > 0.0).all()
        low = np.subtract(frame.grid.origin_m, frame.grid.cell_m)
        high = np.add(frame.grid.max_m, frame.grid.cell_m)
        assert ((places_m >= low) & (places_m <= high)).all()
        plain = mixing_ratio_ppm_at(places_m[:3], frame.filaments)
        assert np.isfinite(plain).all()
        index = FilamentIndex(min_m=frame.grid.origin_m, max_m=frame.grid.max_m)
        index.build(frame.filaments)
        np.testing.assert_allclose(index.mixing_ratio_ppm_at(places_m[:3]), plain, rtol=1e-9)
    else:
        assert frame.mixing_ratio_ppm.shape == frame.grid.shape
        assert np.isfinite(frame.mixing_ratio_ppm).all()
        assert (frame.mixing_ratio_ppm >= 0.0).all()


def is_same(one, other):
    """Tell whether two frames say the same."""
    if (one.version, one.grid, one.gas, one.source_position_m, one.wind_index) != (
        other.version, other.grid, other.gas, other.source_position_m, other.wind_index
    ):  # fmt: skip
        return False
    if one.filaments is None:
        return np.array_equal(one.mixing_ratio_ppm, other.mixing_ratio_ppm)
    return all(
        np.array_equal(getattr(one.filaments, name), getattr(other.filaments, name))
        for name in ("position_world_m", "sigma_m", "amount_mol")
    )


class Fuzzer(FileFuzzer):
    """Damages files of every kind, one after the other, and counts what came of it."""

    blocks = STUMBLING_BLOCKS

    def __init__(self, folder, seed):
        super().__init__(folder, seed)
        self.names = sorted(CONTENTS)
        self.intact = {}
        for name in self.names:
            (folder / name).write_bytes(gaden.compressed(CONTENTS[name]))
            self.intact[name] = read_gaden_frame(folder / name)
        head, records = gsl_bench_arrays()
        np.save(folder / "iteration_0_head.npy", head)
        np.save(folder / "iteration_0_fil.npy", records)
        np.savez(folder / "film.npz", time_s=[0.0, 1.0], mixing_ratio_ppm=np.ones((2, 3, 4, 2)),
                 origin_m=np.zeros(3), cell_m=0.5)  # fmt: skip
        self.grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, shape=(2, 3, 4))
        rows = "\n".join(["0 1 0\n0 0 2\n;"] * 4)
        text = f"#env_min(m) 0 0 0\n#env_max(m) 1 1.5 2\n#num_cells 2 3 4\n#cell_size(m) 0.5\n{rows}\n"
        (folder / "OccupancyGrid3D.csv").write_text(text)
        (folder / "wind_iteration_0").write_bytes(np.ones(72).astype("<f8").tobytes())

    def round(self):
        for name in self.names:
            self.try_stream(name)
            self.try_content(name)
        frame = self.folder / "iteration_0_fil.npy"
        for name, read in (
            ("iteration_0_fil.npy", lambda: check_possible(read_gsl_bench_frame(frame))),
            ("iteration_0_head.npy", lambda: check_possible(read_gsl_bench_frame(frame))),
            ("film.npz", self.check_film),
            ("OccupancyGrid3D.csv", self.check_walls),
            ("wind_iteration_0", self.check_wind),
        ):
            self.try_file(self.folder / name, read)

    # The stream carries a checksum: what is read must be what was written.
    def try_stream(self, name):
        is_late = bool(self.rng.integers(2))
        path = self.folder / f"{name}_stream"
        path.write_bytes(self.damage(gaden.compressed(CONTENTS[name], is_late=is_late)))
        self.attempt(lambda: self.check_same(read_gaden_frame(path), name), path)

    # What is compressed was wrong already.
    def try_content(self, name):
        path = self.folder / f"{name}_content"
        path.write_bytes(zlib.compress(self.damage(CONTENTS[name]), 1))
        self.attempt(lambda: check_possible(read_gaden_frame(path)), path)

    def check_same(self, frame, name):
        assert is_same(frame, self.intact[name]), name

    # An archive has checksums as well.
    def check_film(self):
        frame = GasMovie(self.folder / "film.npz").frame_at(1.0)
        assert frame.grid == Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, shape=(3, 4, 2))
        assert (frame.mixing_ratio_ppm == 1.0).all()

    def check_walls(self):
        walls = read_walls(self.folder / "OccupancyGrid3D.csv")
        assert set(np.unique(walls.occupancy)) <= {0, 1, 2}
        assert np.isfinite([*walls.origin_m, walls.cell_m]).all()

    def check_wind(self):
        assert np.isfinite(read_result(self.folder / "wind_iteration_0", self.grid)).all()


def gsl_bench_arrays():
    """One frame in GSL-Bench's layout: its head and its records."""
    head = (
        1, *gaden.MIN_M, *gaden.MAX_M, *gaden.CELLS, *(gaden.CELL_M,) * 3, *gaden.SOURCE_M, gaden.GAS_CODE,
        gaden.MOLES, gaden.AIR, 0,
    )  # fmt: skip
    rows = [(i, *p, s) for i, (p, s) in enumerate(zip(gaden.POSITIONS_M.tolist(), gaden.SIGMAS_CM, strict=True))]
    return np.array([head], gsl_bench.HEAD), np.array(rows, gsl_bench.RECORD)


@pytest.mark.slow
def test_damaged_files_are_refused_or_read_as_they_were(tmp_path):
    fuzzer = Fuzzer(tmp_path, seed=1)
    for _ in range(120):
        fuzzer.round()
    assert fuzzer.n_refused > 1000
    assert fuzzer.n_read > 50


@pytest.mark.soak
@pytest.mark.timeout(1200)
def test_fifteen_minutes_of_damaged_files(tmp_path):
    """A new seed for each quarter of an hour; a failure names it."""
    assert Fuzzer.run_for(tmp_path, 900.0).n_refused > 10_000
