"""Films of measured gas."""

import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError
from gslcosim_formats.stored_gas.playback import GasMovie, values_in_cells

SOUND = {
    "time_s": np.array([1.0, 1.5, 3.0]),
    "mixing_ratio_ppm": np.arange(3 * 2 * 3 * 4).reshape(3, 2, 3, 4).astype(np.float64),
    "origin_m": np.array([1.0, 2.0, 3.0]),
    "cell_m": np.array(0.5),
}


@pytest.fixture
def film(tmp_path):
    """Write a film with some of its arrays replaced and open it."""

    def build(*, is_looping=False, **changes):
        arrays = {name: array for name, array in {**SOUND, **changes}.items() if array is not None}
        np.savez(tmp_path / "film.npz", **arrays)
        return GasMovie(tmp_path / "film.npz", is_looping=is_looping)

    return build


def picture(movie, time_s):
    """Number of the picture at a time; nothing before the first."""
    frame = movie.frame_at(time_s)
    return None if frame is None else round(float(frame.mixing_ratio_ppm.flat[0]) / 24)


def test_a_picture_holds_until_the_next(film):
    movie = film()
    assert [picture(movie, t) for t in (0.0, 0.99, 1.0, 1.49, 1.5, 2.9, 3.0, 99.0)] == [
        None, None, 0, 0, 1, 1, 2, 2,
    ]  # fmt: skip


def test_a_loop_gives_the_last_picture_the_time_of_the_one_before(film):
    movie = film(is_looping=True)
    assert movie.duration_s == pytest.approx(3.5)
    assert [picture(movie, t) for t in (0.5, 4.4, 4.5, 5.0, 6.6, 7.9, 8.0)] == [None, 2, 0, 1, 2, 2, 0]


def test_values_are_those_of_the_cells_and_nothing_outside(film):
    frame = film().frame_at(1.0)
    points = np.array([(1.1, 2.1, 3.1), (1.6, 3.4, 4.9), (0.9, 2.1, 3.1)])
    assert values_in_cells(frame, points).tolist() == [0.0, 23.0, 0.0]


def test_a_plane_holds_at_all_heights(film):
    frame = film(mixing_ratio_ppm=np.arange(18.0).reshape(3, 2, 3)).frame_at(1.5)
    points = np.array([(1.6, 2.1, -5.0), (1.6, 2.1, 0.3), (1.6, 2.1, 80.0), (5.0, 2.1, 3.0)])
    assert values_in_cells(frame, points).tolist() == [9.0, 9.0, 9.0, 0.0]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"cell_m": None}, "was without cell_m"),
        ({"time_s": np.array([1.0, 1.0, 2.0])}, "one ascending time for each of 3 pictures"),
        ({"time_s": np.array([1.0, 2.0])}, "one ascending time for each of 3 pictures"),
        ({"mixing_ratio_ppm": np.zeros((3, 2))}, "of shape"),
        ({"mixing_ratio_ppm": np.full((3, 2, 3, 4), -1.0)}, "from 0 to 1e6 ppm"),
        ({"mixing_ratio_ppm": np.full((3, 2, 3, 4), 2e6)}, "from 0 to 1e6 ppm"),
        ({"mixing_ratio_ppm": np.full((3, 2, 3, 4), np.nan)}, "from 0 to 1e6 ppm"),
        ({"mixing_ratio_ppm": np.array([["a"]])}, "expected arrays of numbers, was mixing_ratio_ppm of <U1"),
        ({"time_s": np.array(["1", "2", "3"])}, "expected arrays of numbers, was time_s of <U1"),
        ({"cell_m": np.array(0.0)}, "cell_m greater than 0"),
        ({"origin_m": np.zeros(2)}, "origin_m of three numbers"),
    ],
)
def test_a_faulty_film_is_refused(film, changes, expected):
    with pytest.raises(EnvironmentDataError, match=expected):
        film(**changes)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 not an archive", b"plain text"])
def test_a_file_of_another_kind_is_refused(tmp_path, content):
    (tmp_path / "film.npz").write_bytes(content)
    with pytest.raises(EnvironmentDataError, match="gas movie"):
        GasMovie(tmp_path / "film.npz")
