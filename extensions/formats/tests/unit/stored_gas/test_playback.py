import shutil

import gaden_writers as gaden
import gsl_bench_writers as gsl_bench
import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim_formats.stored_gas.frame_formats import read_gsl_bench_frame
from gslcosim_formats.stored_gas.playback import GasPlayback


@pytest.fixture
def gaden_folder(tmp_path):
    """Frames 2, 3 and 5 of a GADEN result; frame 5 is a grid of mixing ratios."""
    (tmp_path / "iteration_2").write_bytes(gaden.compressed(gaden.version_1()))
    (tmp_path / "iteration_3").write_bytes(gaden.compressed(gaden.version_3(), is_late=True))
    (tmp_path / "iteration_5").write_bytes(gaden.compressed(gaden.version_3_concentrations()))
    (tmp_path / "wind").mkdir()
    (tmp_path / "notes.txt").write_text("iteration_4 is missing")
    return tmp_path


def test_frames_hold_until_the_next_one_that_is_there(gaden_folder):
    playback = GasPlayback(gaden_folder, period_s=0.5)
    assert playback.numbers == (2, 3, 5)
    assert [playback.number_at(t) for t in (0.0, 0.99, 1.0, 1.49, 1.5, 2.4, 2.5, 99.0)] == [
        None, None, 2, 2, 3, 3, 5, 5,
    ]  # fmt: skip


def test_looping_begins_again_after_the_last_frame(gaden_folder):
    playback = GasPlayback(gaden_folder, period_s=0.5, is_looping=True)
    assert [playback.number_at(t) for t in (2.9, 3.0, 4.0, 4.5)] == [5, None, 2, 3]


def test_readings_follow_the_frames(gaden_folder):
    playback = GasPlayback(gaden_folder, period_s=1.0)
    place = gaden.POSITIONS_M[:1]
    assert playback.mixing_ratio_ppm_at(place, 1.0)[0] == 0.0
    assert playback.mixing_ratio_ppm_at(place, 2.0)[0] == pytest.approx(10.0, rel=1e-5)
    cell = np.floor((place[0] - gaden.MIN_M) / gaden.CELL_M)
    assert playback.mixing_ratio_ppm_at(place, 5.0)[0] == cell @ (1, 10, 100)
    assert playback.mixing_ratio_ppm_at(place + 100.0, 5.0)[0] == 0.0


def test_a_folder_without_frames_is_refused(tmp_path):
    for folder in (tmp_path, tmp_path / "missing"):
        with pytest.raises(EnvironmentDataError, match="expected files iteration_0, iteration_1"):
            GasPlayback(folder, period_s=1.0)


def test_a_missing_number_is_refused(gaden_folder):
    with pytest.raises(EnvironmentDataError, match=r"expected a number among 2 to 5 \(3 frames\), was 4"):
        GasPlayback(gaden_folder, period_s=1.0).frame(4)


def test_gsl_benchs_layout_is_read(gsl_bench_folder):
    frame = GasPlayback(gsl_bench_folder, period_s=1.0).frame(0)
    assert (frame.gas, frame.grid.shape, frame.source_position_m) == ("methane", gaden.CELLS, gaden.SOURCE_M)
    np.testing.assert_array_equal(frame.filaments.position_world_m, gaden.POSITIONS_M)
    np.testing.assert_allclose(frame.filaments.sigma_m, gaden.SIGMAS_CM / 100)


def test_a_missing_head_is_named(gsl_bench_folder):
    (gsl_bench_folder / "iteration_0_head.npy").unlink()
    with pytest.raises(EnvironmentDataError, match=r"iteration_0_head\.npy"):
        read_gsl_bench_frame(gsl_bench_folder / "iteration_0_fil.npy")


@pytest.mark.parametrize("content", [b"", b"not an array", b"\x93NUMPY\x01\x00"])
def test_files_that_are_no_arrays_are_refused(gsl_bench_folder, content):
    path = gsl_bench_folder / "iteration_0_fil.npy"
    path.write_bytes(content)
    with pytest.raises(EnvironmentDataError, match=r"cannot be read as an array"):
        read_gsl_bench_frame(path)


def test_arrays_of_another_kind_are_refused(gsl_bench_folder):
    path = gsl_bench_folder / "iteration_0_fil.npy"
    np.save(path, np.zeros((3, 5)))
    with pytest.raises(EnvironmentDataError, match=r"expected records with pose_x, .* was float64 \(3, 5\)"):
        read_gsl_bench_frame(path)


@pytest.mark.parametrize("name", ["iteration_0_fil.npy", "iteration_0_head.npy"])
def test_bytes_behind_the_records_are_refused(gsl_bench_folder, name):
    """Bytes that were doubled in the middle shift all that follow, and leave some over."""
    path = gsl_bench_folder / name
    path.write_bytes(path.read_bytes() + b"12345678")
    with pytest.raises(EnvironmentDataError, match=r"expected \d+ bytes of records, was \d+"):
        read_gsl_bench_frame(gsl_bench_folder / "iteration_0_fil.npy")


def test_a_head_of_signed_numbers_or_without_its_length_is_read(gsl_bench_folder):
    path = gsl_bench_folder / "iteration_0_head.npy"
    signed = np.dtype([(name, "<i4" if kind == "<u4" else kind) for name, kind in gsl_bench.HEAD.descr])
    np.save(path, np.load(path).astype(signed)[0])
    assert read_gsl_bench_frame(gsl_bench_folder / "iteration_0_fil.npy").gas == "methane"


def test_frames_that_contradict_each_other_are_refused(gsl_bench_folder):
    head = np.load(gsl_bench_folder / "iteration_0_head.npy")
    head["filament_num_moles_of_gas"] *= 2
    np.save(gsl_bench_folder / "iteration_1_head.npy", head)
    shutil.copy(gsl_bench_folder / "iteration_0_fil.npy", gsl_bench_folder / "iteration_1_fil.npy")
    with pytest.raises(EnvironmentDataError, match="moles of all filaments as in frame 0") as caught:
        GasPlayback(gsl_bench_folder, period_s=1.0).frame(1)
    assert str(caught.value).endswith("iteration_1_fil.npy")
