"""The environment folder: what is saved comes back, and what is damaged is named."""

import threading
from dataclasses import replace

import numpy as np
import pytest
import yaml

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import WindFrames, with_wind
from gslcosim.environment.store import FORMAT, load_environment, save_environment
from gslcosim.scenario.models.scenario import BoxSpec, LayoutSpec, WindSpec


def make_environment(seed=0, n_frames=2):
    shelf = BoxSpec(name="shelf", min_m=(1.0, 1.0, 0.0), max_m=(2.0, 1.3, 1.1))
    layout = LayoutSpec(size_m=(4.0, 3.0, 2.0), obstacles=(shelf,))
    room = build_layout(layout, WindSpec(cell_m=0.5))
    velocity_m_s = np.random.default_rng(seed).normal(size=(n_frames, *room.grid.shape, 3)).astype(np.float32)
    return with_wind(room, WindFrames(velocity_m_s=velocity_m_s, period_s=0.1, is_looping=False))


@pytest.fixture
def saved(tmp_path):
    folder = tmp_path / "room"
    save_environment(make_environment(), folder)
    return folder


def change_header(folder, **changes):
    path = folder / "environment.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | changes))


def refusal(folder, **options):
    with pytest.raises(EnvironmentDataError) as error:
        load_environment(folder, **options)
    return str(error.value)


def test_what_is_saved_comes_back_equal(saved):
    expected, found = make_environment(), load_environment(saved)
    assert (found.occupancy == expected.occupancy).all()
    assert (found.wind.velocity_m_s == expected.wind.velocity_m_s).all()
    for field in ("name", "grid", "boxes", "openings", "content_hash"):
        assert getattr(found, field) == getattr(expected, field)
    assert (found.wind.period_s, found.wind.is_looping) == (0.1, False)


def with_k_epsilon():
    environment = make_environment()
    k_epsilon = np.random.default_rng(9).random((*environment.grid.shape, 2)).astype(np.float32)
    return with_wind(environment, replace(environment.wind, k_epsilon=k_epsilon))


def test_k_and_epsilon_come_back_with_their_wind(tmp_path, saved):
    expected = with_k_epsilon()
    save_environment(expected, tmp_path / "turbulent")
    found, plain = load_environment(tmp_path / "turbulent"), load_environment(saved)
    assert (found.wind.k_epsilon == expected.wind.k_epsilon).all()
    assert plain.wind.k_epsilon is None
    assert found.content_hash != plain.content_hash


def test_k_and_epsilon_that_are_damaged_or_do_not_fit_are_refused(tmp_path):
    save_environment(with_k_epsilon(), tmp_path / "room")
    np.save(tmp_path / "room" / "k_epsilon.npy", np.full((8, 6, 4, 2), -1, np.float32))
    assert "k_epsilon.npy: expected finite values of at least 0" in refusal(tmp_path / "room")
    np.save(tmp_path / "room" / "k_epsilon.npy", np.zeros((8, 6, 4, 3), np.float32))
    assert "k_epsilon.npy: expected float32 (8, 6, 4, 2)" in refusal(tmp_path / "room")
    room = make_environment()
    with pytest.raises(EnvironmentDataError, match="k and epsilon of"):
        with_wind(room, replace(room.wind, k_epsilon=np.zeros((2, 2, 2, 2), np.float32)))


def test_loaded_arrays_are_plain_read_only_and_mapped_to_the_file(saved):
    environment = load_environment(saved)
    for array in (environment.occupancy, environment.wind.velocity_m_s):
        assert type(array) is np.ndarray
        assert array.flags.c_contiguous
        assert isinstance(array.base, np.memmap)
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_the_header_says_how_the_environment_was_made(tmp_path):
    save_environment(
        make_environment(), tmp_path / "room", made_from={"layout": {"size_m": (4, 3, 2)}}, notices=("A.",)
    )
    header = yaml.safe_load((tmp_path / "room" / "environment.yaml").read_text())
    assert header["format"] == FORMAT
    assert header["made_from"] == {"layout": {"size_m": [4, 3, 2]}}
    assert header["notices"] == ["A."]


def test_saving_another_environment_replaces_the_old_one_and_leaves_nothing_else(saved):
    save_environment(make_environment(seed=1), saved)
    assert load_environment(saved).content_hash == make_environment(seed=1).content_hash
    assert [path.name for path in saved.parent.iterdir()] == ["room"]
    files = ["checksums.json", "environment.yaml", "occupancy.npy", "wind.npy"]
    assert sorted(path.name for path in saved.iterdir()) == files


def test_saving_the_same_again_leaves_the_files_alone(saved):
    before = (saved / "wind.npy").stat().st_ino
    save_environment(make_environment(), saved)
    assert (saved / "wind.npy").stat().st_ino == before


def test_a_reader_keeps_its_environment_when_it_is_replaced(saved):
    environment = load_environment(saved)
    save_environment(make_environment(seed=1), saved)
    assert (environment.wind.velocity_m_s == make_environment().wind.velocity_m_s).all()


def test_a_folder_of_something_else_is_never_replaced(tmp_path):
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "thesis.tex").write_text("precious")
    with pytest.raises(EnvironmentDataError, match="Nothing was written"):
        save_environment(make_environment(), tmp_path / "room")
    assert [path.name for path in tmp_path.iterdir()] == ["room"]
    assert (tmp_path / "room" / "thesis.tex").read_text() == "precious"


def test_many_writers_at_once_leave_one_whole_environment(tmp_path):
    environments = [make_environment(seed=seed) for seed in (0, 0, 0, 1, 1, 2)]
    start, errors = threading.Barrier(len(environments)), []

    def save(environment):
        start.wait()
        try:
            save_environment(environment, tmp_path / "room")
        except Exception as error:
            errors.append(error)

    threads = [threading.Thread(target=save, args=(environment,)) for environment in environments]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert [path.name for path in tmp_path.iterdir()] == ["room"]
    found = load_environment(tmp_path / "room").content_hash
    assert found in {environment.content_hash for environment in environments}


def test_wind_that_is_not_finite_is_not_saved(tmp_path):
    environment = make_environment()
    velocity_m_s = environment.wind.velocity_m_s.copy()
    velocity_m_s[1, 2, 3, 1, 0] = np.nan
    broken = replace(environment, wind=replace(environment.wind, velocity_m_s=velocity_m_s))
    with pytest.raises(EnvironmentDataError, match=r"1 that are not, the first at \(2, 3, 1, 0\) of frame 1"):
        save_environment(broken, tmp_path / "room")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_is_named(tmp_path):
    assert "no such folder" in refusal(tmp_path / "nowhere")
    assert "without environment.yaml" in refusal(tmp_path)


@pytest.mark.parametrize("name", ["occupancy.npy", "wind.npy"])
def test_a_missing_array_is_named(saved, name):
    (saved / name).unlink()
    assert f"{name}: expected an array, was missing" in refusal(saved)


@pytest.mark.parametrize("name", ["occupancy.npy", "wind.npy"])
@pytest.mark.parametrize("kept", [0, 5, 100, -1])
def test_a_truncated_array_is_named(saved, name, kept):
    content = (saved / name).read_bytes()
    (saved / name).write_bytes(content[:kept])
    assert f"{name}: expected a whole numpy array, was {len(content[:kept])} bytes" in refusal(saved)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_wind_that_is_not_finite_is_named(saved, value):
    velocity_m_s = np.load(saved / "wind.npy")
    velocity_m_s[1, 2, 3, 1, 0] = value
    np.save(saved / "wind.npy", velocity_m_s)
    assert "wind.npy: expected finite velocities" in refusal(saved)


def test_arrays_of_another_shape_or_type_are_named(saved):
    wind = np.load(saved / "wind.npy")
    for other in (wind[0], wind[:, :-1], wind[:0], wind.astype(np.float64), wind[..., :2]):
        np.save(saved / "wind.npy", other)
        text = refusal(saved)
        assert "wind.npy: expected float32 (t >= 1, 8, 6, 4, 3)" in text
        assert f"was {other.dtype} {other.shape}" in text


def test_arrays_in_fortran_order_are_read_all_the_same(saved):
    wind = np.load(saved / "wind.npy")
    np.save(saved / "wind.npy", np.asfortranarray(wind))
    found = load_environment(saved).wind.velocity_m_s
    assert (found == wind).all()
    assert found.flags.c_contiguous
    assert not found.flags.writeable


def test_unknown_cell_codes_are_named(saved):
    occupancy = np.load(saved / "occupancy.npy")
    occupancy[1, 1, 1] = 7
    np.save(saved / "occupancy.npy", occupancy)
    assert "occupancy.npy: expected 0 free, 1 solid, 2 outlet, was 7" in refusal(saved)


def test_a_header_of_another_format_is_named(saved):
    change_header(saved, format="gslcosim/environment/9")
    assert "expected format: gslcosim/environment/1, was 'gslcosim/environment/9'" in refusal(saved)


NESTED = "YAML, was nested more than 1000 times"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *((text, "") for text in ("", "- 1\n", "a: [", "\tx: 1", "\x00", "a: 2001-99-99", f"a: {'9' * 5000}",
                                  'a: !!int ""', 'a: !!timestamp ""')),
        *((text, NESTED) for text in ("a: " + "[" * 100_000, "a:\n" + "- " * 100_000, "{\n" * 100_000)),
    ],
    ids=lambda text: text[:9],
)  # fmt: skip
def test_a_header_that_is_no_mapping_is_named(saved, text, expected):
    (saved / "environment.yaml").write_text(text)
    assert f"environment.yaml: expected {expected}" in refusal(saved)


def test_all_bad_values_of_a_header_are_named(saved):
    change_header(saved, name=None, grid={"origin_m": [0, 0, 0], "cell_m": -1, "shape": [8, 6]})
    lines = refusal(saved).splitlines()
    assert [line.split(":")[1].strip() for line in lines[:-1]] == ["name", "grid.cell_m", "grid.shape[2]"]


def test_keys_of_later_minor_versions_are_passed_over(saved):
    change_header(saved, smells=[1, 2, 3])
    assert load_environment(saved).name == "warehouse_empty"


def test_a_changed_file_is_found_by_its_hash(saved):
    wind = np.load(saved / "wind.npy")
    wind[0, 0, 0, 0, 0] += 1.0
    np.save(saved / "wind.npy", wind)
    assert "content_hash: expected" in refusal(saved)
