import contextlib
import re
import struct
import zlib
from pathlib import Path

import gaden_writers as gaden
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gslcosim.base.errors import EnvironmentDataError
from gslcosim_formats.stored_gas.frame_formats import read_gaden_frame
from gslcosim_services.fields.mixing_ratio import mixing_ratio_ppm_at

VERSIONS = {
    "1": gaden.version_1(),
    "2.3": gaden.version_2(),
    "2.6": gaden.version_2_6(),
    "2.6 simulated": gaden.version_2_6_simulated(),
    "3.0": gaden.version_3(),
    "3.0 early": gaden.version_3_early(),
    "3.0 box": gaden.version_3("box", (1.0, 2.0, 3.0)),
    "3.0 line": gaden.version_3("line", (1.0, 2.0, 3.0)),
    "3.0 sphere": gaden.version_3("sphere", (1.0,)),
    "3.0 cylinder": gaden.version_3("cylinder", (1.0, 2.0)),
}


@pytest.fixture
def write(tmp_path):
    def build(content, name="iteration_3"):
        path = tmp_path / name
        path.write_bytes(content)
        return path

    return build


@pytest.mark.parametrize("is_late", [False, True])
@pytest.mark.parametrize("name", VERSIONS)
def test_every_version_shows_the_same(write, name, is_late):
    frame = read_gaden_frame(write(gaden.compressed(VERSIONS[name], is_late=is_late)))
    assert frame.version == name.split()[0]
    assert frame.grid.shape == gaden.CELLS
    assert (frame.grid.origin_m, frame.grid.cell_m) == (gaden.MIN_M, gaden.CELL_M)
    assert frame.wind_index == gaden.WIND
    assert frame.mixing_ratio_ppm is None
    np.testing.assert_allclose(frame.filaments.position_world_m, gaden.POSITIONS_M, rtol=1e-6)
    np.testing.assert_allclose(frame.filaments.sigma_m, gaden.SIGMAS_CM / 100, rtol=1e-6)
    if name != "2.6":
        assert (frame.gas, frame.source_position_m) == ("methane", pytest.approx(gaden.SOURCE_M))
    centre_ppm = mixing_ratio_ppm_at(gaden.POSITIONS_M[:1], frame.filaments)[0, 0]
    assert centre_ppm == pytest.approx(10.0, rel=1e-5)


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_frames_of_2_6_tell_by_their_length_whether_they_have_a_source(write, n):
    content = gaden.version_2_6_simulated()
    frame = read_gaden_frame(write(gaden.compressed(content[: len(content) - 20 * (3 - n)])))
    assert (frame.gas, len(frame.filaments.sigma_m)) == ("methane", n)
    content = gaden.version_2_6()
    frame = read_gaden_frame(write(gaden.compressed(content[: len(content) - 20 * (3 - n)])))
    assert (frame.gas, len(frame.filaments.sigma_m)) == (None, n)


def test_a_frame_of_2_6_that_ends_within_a_record_is_refused(write):
    for content in (gaden.version_2_6_simulated(), gaden.version_2_6()):
        for n_lost in range(1, 20):
            with contextlib.suppress(EnvironmentDataError):
                frame = read_gaden_frame(write(gaden.compressed(content[:-n_lost])))
                pytest.fail(f"{n_lost} bytes less: {frame}")


def test_inactive_filaments_are_left_out(write):
    frame = read_gaden_frame(write(gaden.compressed(gaden.version_3(active=(1, 0, 1)))))
    np.testing.assert_allclose(frame.filaments.sigma_m, gaden.SIGMAS_CM[[0, 2]] / 100, rtol=1e-6)


def test_stored_mixing_ratios_come_with_x_running_fastest(write):
    frame = read_gaden_frame(write(gaden.compressed(gaden.version_3_concentrations())))
    assert frame.filaments is None
    i, j, k = np.indices(gaden.CELLS)
    np.testing.assert_array_equal(frame.mixing_ratio_ppm, i + 10 * j + 100 * k)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "one whole zlib stream"),
        (b"plain text", "one zlib stream"),
        (gaden.compressed(gaden.version_1())[:-3], "one whole zlib stream"),
        (gaden.compressed(gaden.version_1()) + b"more", "one whole zlib stream and nothing else"),
        (zlib.compress(gaden.version_1()[:50]), r"expected \d+ more bytes"),
        (zlib.compress(gaden.version_1()[:-3]), "whole records of 36 bytes"),
        (zlib.compress(gaden.version_3()[:-20]), "3 records of 20 bytes"),
        (zlib.compress(b"\x07\0\0\0" + gaden.version_2()[4:]), "version 1, 2 or 3, was 7"),
        (zlib.compress(gaden.version_3("blob")), "a source of point, box"),
        (zlib.compress(gaden.version_3_concentrations()[:-4]), "140 records of 4 bytes"),
    ],
)
def test_faulty_files_are_refused_with_what_was_expected(write, content, expected):
    with pytest.raises(EnvironmentDataError, match=expected) as caught:
        read_gaden_frame(write(content))
    assert str(caught.value).endswith("iteration_3")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"positions_m": gaden.POSITIONS_M * 100}, "filament 0 is at"),
        ({"positions_m": gaden.POSITIONS_M * np.nan}, "filament 0 is at"),
        ({"sigmas_cm": np.array([10.0, 0.0, 10.0])}, "filament 1 is at"),
        ({"sigmas_cm": np.array([10.0, 20.0, np.inf])}, "filament 2 is at"),
        ({"sigmas_cm": np.array([1e-200, 20.0, 30.0])}, "filament 0 is at"),
        ({"sigmas_cm": np.array([0.2, 20.0, 30.0])}, r"at most pure gas, 1e6 ppm, was 1.25e\+06 ppm"),
    ],
)
def test_impossible_filaments_are_refused(write, changes, expected):
    with pytest.raises(EnvironmentDataError, match=expected):
        read_gaden_frame(write(gaden.compressed(gaden.version_1(**changes))))


@pytest.mark.parametrize(
    ("layout", "offset", "value", "expected"),
    [
        ("<d", 28, 1e7, "a grid of positive size within 100000 m"),
        ("<d", 72, 0.25, "cubic cells, was (0.5, 0.25, 0.5)"),
        ("<d", 88, np.nan, "a source between"),
        ("<d", 88, 40.0, "a source between"),
        ("<d", 124, 1e-9, "moles in a filament and in a cm3 of air"),
        ("<i", 132, -1, "a number of 0 or more at 132, was -1"),
    ],
)
def test_impossible_heads_are_refused(write, layout, offset, value, expected):
    content = bytearray(gaden.version_1())
    struct.pack_into(layout, content, offset, value)
    with pytest.raises(EnvironmentDataError, match=re.escape(expected)):
        read_gaden_frame(write(gaden.compressed(bytes(content))))


def test_mixing_ratios_far_beyond_pure_gas_are_refused(write):
    content = gaden.version_3_concentrations()[:-4] + struct.pack("<f", 1e30)
    with pytest.raises(EnvironmentDataError, match="beyond pure gas"):
        read_gaden_frame(write(gaden.compressed(content)))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(EnvironmentDataError, match="cannot be read"):
        read_gaden_frame(tmp_path / "iteration_9")


def test_a_huge_stream_is_refused_before_it_fills_the_memory(write, monkeypatch):
    monkeypatch.setattr("gslcosim_formats.stored_gas.frame_formats.MAX_FRAME_BYTES", 1000)
    with pytest.raises(EnvironmentDataError, match="one whole zlib stream"):
        read_gaden_frame(write(zlib.compress(bytes(100_000))))


@settings(deadline=None, max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.sampled_from(sorted(VERSIONS)), data=st.data())
def test_mutated_frames_are_read_or_refused(tmp_path, name, data):
    """Bytes changed inside the stream, where the checksum does not help: a sound frame or a clear error."""
    content = bytearray(VERSIONS[name])
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = Path(tmp_path) / "iteration_0"
    path.write_bytes(zlib.compress(bytes(content)))
    with contextlib.suppress(EnvironmentDataError):
        frame = read_gaden_frame(path)
        if frame.filaments is None:
            return
        assert np.isfinite(frame.filaments.position_world_m).all()
        assert (frame.filaments.sigma_m > 0).all()
        assert np.isfinite(mixing_ratio_ppm_at(gaden.POSITIONS_M, frame.filaments)).all()
