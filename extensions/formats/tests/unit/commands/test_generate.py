"""`gslcosim environment generate`: from scenarios, layout files and kinds; many at a time; failures are told."""

import json

import pytest

from gslcosim.cli.main import main
from gslcosim.environment.store import load_environment

LAYOUT = """
layout: {kind: cluttered_rooms, size_m: [6, 6, 2], n_rooms: [2, 2], seed: 4}
wind: {solver: uniform, cell_m: 0.25}
"""


@pytest.fixture
def layout_file(tmp_path):
    def write(text=LAYOUT):
        path = tmp_path / "rooms.yaml"
        path.write_text(text)
        return str(path)

    return write


def generate(*words):
    return main(["environment", "generate", *words])


def test_a_scenario_becomes_a_folder_with_a_picture(tmp_path, capsys):
    out = tmp_path / "room"
    assert generate("tiny_room", "--out", str(out), "--json") == 0
    (made,) = json.loads(capsys.readouterr().out)
    environment = load_environment(out)
    assert (made["content_hash"], made["error"]) == (environment.content_hash, None)
    assert (out / "top_view.png").read_bytes().startswith(b"\x89PNG")
    assert all(f'name="{box.name}"' in (out / "scene.xml").read_text() for box in environment.boxes)


@pytest.mark.slow
def test_a_solved_wind_comes_with_the_plot_of_its_solve(layout_file, tmp_path):
    layout = layout_file(LAYOUT.replace("solver: uniform", "solver: built_in, end_time_s: 1"))
    assert generate(layout, "--out", str(tmp_path / "room")) == 0
    assert (tmp_path / "room" / "wind_history.png").read_bytes().startswith(b"\x89PNG")


def test_many_have_their_own_seeds_and_folders(layout_file, tmp_path, capsys):
    assert generate(layout_file(), "--out", str(tmp_path / "all"), "--count", "3", "--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert [each["seed"] for each in made] == [4, 5, 6]
    assert {path.name for path in (tmp_path / "all").iterdir()} == {f"cluttered_rooms_{seed}" for seed in (4, 5, 6)}
    assert len({each["content_hash"] for each in made}) == 3
    assert all(0 < x < 6 for each in made for x in each["random_source_m"][:2])


def test_one_that_fails_is_reported_and_the_others_are_made(layout_file, tmp_path, capsys):
    taken = tmp_path / "all" / "cluttered_rooms_5"
    taken.mkdir(parents=True)
    (taken / "thesis.tex").touch()
    assert generate(layout_file(), "--out", str(tmp_path / "all"), "--count", "3") == 3
    output = capsys.readouterr()
    assert f"The folder holds something else than an environment (it has no environment.yaml): {taken}." in output.err
    assert [line.split()[0] for line in output.out.splitlines()] == ["seed", "4", "6"]
    assert (taken / "thesis.tex").exists()


@pytest.mark.slow
def test_several_processes_make_the_same_as_one(layout_file, tmp_path, capsys):
    hashes = []
    for jobs in ("1", "2"):
        words = ("--out", str(tmp_path / jobs), "--count", "3", "--jobs", jobs, "--seed", "1", "--json")
        assert generate(layout_file(), *words) == 0
        hashes.append([each["content_hash"] for each in json.loads(capsys.readouterr().out)])
    assert hashes[0] == hashes[1]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("layout: {kind: offise}", "rooms.yaml:1: layout.kind: expected one of warehouse_empty, warehouse_simple, "
         "warehouse_complex, office, home, cluttered_rooms, plant or wind_tunnel, was 'offise'. Did you mean office?"),
        ("layout: {kind: office}\ngas: 1", "rooms.yaml:2: gas: expected one of the keys layout, wind, "
         "was an unknown key."),
        ("layout: {size_m: [1000, 1000, 100]}", "wind.cell_m: expected cells that divide the room into at most 2e+08, "
         "was 0.2 m, which makes 1.25e+10."),
        ("layout: {inlet: {min_m: [3, 0, 0], max_m: [3, 1, 1]}}", "environment.layout.inlet: expected a rectangle "
         "flat on one face of the room"),
        ("layout: {obstacles: [{name: door, min_m: [14, 13, 0], max_m: [15, 15, 8]}]}", "expected air at the outlet"),
        ("layout: {obstacles: [{name: wall, min_m: [7, 0, 0], max_m: [8, 15, 8]}]}", "obstacles that divide the room"),
    ],
)  # fmt: skip
def test_an_impossible_layout_is_reported_and_leaves_nothing(layout_file, tmp_path, capsys, text, expected):
    assert generate(layout_file(text), "--out", str(tmp_path / "room")) == 2
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "room").exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["offise"], "Did you mean office?"),
        (
            ["office", "--mesh-study", "0.5,0.4"],
            "three or more lengths above 0 like 0.4,0.3,0.2, was '0.5,0.4'",
        ),
        (["office", "--mesh-study", "0.5,0.4,0.3", "--probe", "1,2"], "expected three numbers like 5,3,2, was '1,2'"),
        (
            ["tiny_room", "--set", "gas.sources[0].position_m=[9, 9, 9]"],
            "gas.sources[0].position_m: expected a point in",
        ),
        (["office", "--count", "0"], "expected a whole number of at least 1, was '0'"),
    ],
)
def test_a_wrong_call_is_reported(tmp_path, capsys, words, expected):
    assert generate(*words, "--out", str(tmp_path / "room")) == 2
    assert expected in capsys.readouterr().err
