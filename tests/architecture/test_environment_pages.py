"""The pages on environments, their folders, exchange and own geometry do what they say."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml

from gslcosim.cli.main import main
from gslcosim.environment.store import HEADER_FILE, OCCUPANCY_FILE, WIND_FILE, load_environment
from gslcosim.scenario.model_schema import find_schema_node, list_kinds
from gslcosim.scenario.models.scenario import EnvironmentSpec, Scenario, WindSpec
from gslcosim.scenario.models.wind import WIND_KINDS
from gslcosim_formats.export import FORMATS, GADEN_WINDS
from gslcosim_formats.scenario_keys import GeometrySpec

DOCS = Path(__file__).parents[2] / "docs"
ENVIRONMENTS, FOLDER, EXCHANGE, GEOMETRY = (
    (DOCS / f"{name}.md").read_text() for name in ("environments", "environment-folder", "exchange", "own-geometry")
)


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", page, re.DOTALL)


def calls_of(block):
    """Return the words behind `gslcosim` of each line."""
    return [shlex.split(line)[1:] for line in block.splitlines()]


def test_every_kind_of_environment_wind_and_layout_is_named():
    origins = set(EnvironmentSpec.model_fields) - {"doors", "heat", "air_c"}
    assert set(re.findall(r"^\| `\{(\w+): ", ENVIRONMENTS, re.MULTILINE)) == {*origins, "file"}
    assert "`doors`" in ENVIRONMENTS
    solvers = {name for name in WIND_KINDS.names() if name.isidentifier()}
    assert set(re.findall(r"^\| `(\w+)` \|", ENVIRONMENTS, re.MULTILINE)) == solvers
    kinds = list_kinds(find_schema_node(("environment", "layout")).annotation)
    assert [kind for kind in kinds if f"`{kind}`" not in ENVIRONMENTS] == []


def test_keys_of_the_table_of_parameters_exist():
    table = ENVIRONMENTS[ENVIRONMENTS.index("| AutoGDM+ | gslcosim |") :]
    for path in re.findall(r"`([a-z_]+(?:\[\])?\.[a-z_.\[\]]+)`", table):
        keys = path.replace("[]", ".0").split(".")
        location = tuple(int(key) if key.isdigit() else key for key in keys)
        if location[0] == "layout":
            location = ("environment", "layout", "warehouse_simple", *location[1:])
        assert find_schema_node(location).path.endswith(str(keys[-1])), path


def test_winds_are_winds():
    for block in blocks(ENVIRONMENTS, "yaml")[1:]:
        wind = yaml.safe_load(block)["wind"]
        kind = WIND_KINDS.block_of(wind.get("solver", "auto"))
        assert kind is not None
        kind.model_validate_json(json.dumps(wind), strict=True)
    assert Scenario.model_fields["wind"].default == WindSpec()


@pytest.mark.slow
def test_the_calls_of_environments_make_rooms(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_layout.yaml").write_text(blocks(ENVIRONMENTS, "yaml")[0])
    first, second, view = calls_of(re.search(r"```\n(gslcosim .*?)```", ENVIRONMENTS, re.DOTALL)[1])
    assert main(first) == 0
    assert main(second) == 0
    assert view == ["view", "hall", "--screenshot", "hall.png"]
    hall = load_environment(Path("hall"))
    assert "window" in {opening.name for opening in hall.openings}
    assert "crate" in {box.name for box in hall.boxes}
    assert len(list(Path("halls").iterdir())) == 2


@pytest.mark.slow
def test_the_heat_of_the_page_drives_a_wind(tmp_path):
    (heat,) = (yaml.safe_load(block) for block in blocks(ENVIRONMENTS, "yaml") if "heat:" in block)
    heat["wind"] |= {"cell_m": 0.5, "end_time_s": 20}
    heat |= {"schema": "gslcosim/scenario/1", "name": "warm", "gas": {"sources": [{"position_m": [1, 1, 1]}]}}
    nose = {"name": "nose", "model": "pid"}
    heat["agents"] = [{"name": "dog", "start": {"python": "sweep"}, "vehicle": {"start_m": [1, 1, 0.2]}}]
    heat["agents"][0]["sensors"] = [nose]
    (tmp_path / "warm.yaml").write_text(yaml.safe_dump(heat))
    assert main(["validate", str(tmp_path / "warm.yaml")]) == 0
    assert main(["environment", "generate", str(tmp_path / "warm.yaml"), "--out", str(tmp_path / "warm")]) == 0
    kelvin = json.loads((tmp_path / "warm" / "wind_report.json").read_text())["scalar_by_height"]
    assert kelvin[-1] > kelvin[0] > 0
    assert load_environment(tmp_path / "warm").wind.k_epsilon is not None


@pytest.mark.slow
def test_the_program_solves_a_wind(capsys):
    exec(blocks(ENVIRONMENTS, "python")[0], {})
    assert capsys.readouterr().out == "(30, 20, 12, 3)\n"


@pytest.fixture
def hall(tmp_path):
    """The folder that the page describes, written without this project's code."""
    folder = tmp_path / "hall"
    folder.mkdir()
    (folder / HEADER_FILE).write_text(blocks(FOLDER, "yaml")[0])
    np.save(folder / OCCUPANCY_FILE, np.zeros((4, 3, 2), np.uint8))
    np.save(folder / WIND_FILE, np.full((1, 4, 3, 2, 3), 0.5, np.float32))
    return folder


def test_a_folder_as_described_is_read(hall):
    environment = load_environment(hall)
    assert (environment.name, environment.grid.shape) == ("shed", (4, 3, 2))
    assert [each.name for each in (*environment.boxes, *environment.openings)] == ["wall_x_max", "outlet"]


def test_every_key_of_a_folder_is_described(hall, tmp_path):
    main(["environment", "export", str(hall), "--to", "gaden", "--out", str(tmp_path / "gaden")])
    main(["environment", "import", str(tmp_path / "gaden"), "--out", str(tmp_path / "again")])
    keys = re.findall(r"^(\w+):", (tmp_path / "again" / HEADER_FILE).read_text(), re.MULTILINE)
    assert keys == re.findall(r"^(\w+):", blocks(FOLDER, "yaml")[0], re.MULTILINE)
    assert keys == re.findall(r"^\| `(\w+)` \|", FOLDER, re.MULTILINE)


def test_the_program_reads_a_folder(hall, monkeypatch, capsys):
    monkeypatch.chdir(hall.parent)
    exec(blocks(FOLDER, "python")[0], {})
    assert capsys.readouterr().out == "0 [0.5 0.5 0.5]\n"


@pytest.mark.slow
def test_the_calls_of_exchange_bring_a_room_back(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    calls = calls_of(blocks(EXCHANGE, "")[0])
    assert len(calls) == 4
    assert [main(call) for call in calls] == [0] * 4
    one, other = load_environment(tmp_path / "hall"), load_environment(tmp_path / "hall_again")
    np.testing.assert_array_equal(one.occupancy, other.occupancy)
    np.testing.assert_array_equal(one.wind.velocity_m_s, other.wind.velocity_m_s)


def test_every_format_that_is_written_is_described():
    assert [name for name in FORMATS if f"| `{name}` |" not in EXCHANGE] == []
    assert [name for name in GADEN_WINDS if f"`{name}`" not in EXCHANGE] == []


@pytest.mark.slow
def test_the_calls_of_own_geometry_make_a_room_equal_to_the_one_that_was_exported(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_room.yaml").write_text(blocks(GEOMETRY, "yaml")[0])
    *calls, view = calls_of(blocks(GEOMETRY, "")[0])
    for call in calls:
        assert main(call) == 0, capsys.readouterr().err
    assert view == ["view", "my_room", "--screenshot", "my_room.png"]
    original, own = load_environment(Path("tunnel")), load_environment(Path("my_room"), with_meshes=True)
    np.testing.assert_array_equal(own.occupancy, original.occupancy)
    assert [(opening.name, opening.kind) for opening in own.openings] == [("fan", "inlet"), ("grille", "outlet")]
    assert own.meshes
    assert own.wind.velocity_m_s[0, :, 5, 8, 0].mean() > 0.5


def test_every_key_of_geometry_is_explained():
    assert re.findall(r"^\| `(\w+)` \|", GEOMETRY, re.MULTILINE) == list(GeometrySpec.model_fields)
