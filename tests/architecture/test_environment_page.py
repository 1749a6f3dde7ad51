"""The page on environments and wind does what it says."""

import json
import re
import shlex
from pathlib import Path

import pytest
import yaml

from gslcosim.cli.main import main
from gslcosim.environment.store import load_environment
from gslcosim.scenario.model_schema import find_schema_node, list_kinds, list_words
from gslcosim.scenario.models.scenario import EnvironmentSpec, Scenario, WindSpec

PAGE = Path(__file__).parents[2] / "docs" / "environments.md"
TEXT = PAGE.read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)


def test_every_kind_of_environment_wind_and_layout_is_named():
    origins = set(EnvironmentSpec.model_fields) - {"doors"}
    assert set(re.findall(r"^\| `\{(\w+): ", TEXT, re.MULTILINE)) == {*origins, "file"}
    assert "`doors`" in TEXT
    assert set(re.findall(r"^\| `(\w+)` \|", TEXT, re.MULTILINE)) == set(
        list_words(find_schema_node(("wind", "solver")).annotation)
    )
    assert all(f"`{kind}`" in TEXT for kind in list_kinds(find_schema_node(("environment", "layout")).annotation))


def test_keys_of_the_table_of_parameters_exist():
    table = TEXT[TEXT.index("| AutoGDM+ | gslcosim |") :]
    for path in re.findall(r"`([a-z_]+(?:\[\])?\.[a-z_.\[\]]+)`", table):
        keys = path.replace("[]", ".0").split(".")
        location = tuple(int(key) if key.isdigit() else key for key in keys)
        if location[0] == "layout":
            location = ("environment", "layout", "warehouse_simple", *location[1:])
        assert find_schema_node(location).path.endswith(str(keys[-1])), path


def test_winds_are_winds():
    for block in blocks("yaml")[1:]:
        WindSpec.model_validate_json(json.dumps(yaml.safe_load(block)["wind"]), strict=True)
    assert Scenario.model_fields["wind"].default == WindSpec()


@pytest.mark.slow
def test_the_calls_work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_layout.yaml").write_text(blocks("yaml")[0])
    first, second, view = [
        shlex.split(call)[1:] for call in re.search(r"```\n(gslcosim .*?)```", TEXT, re.DOTALL)[1].splitlines()
    ]
    assert main(first) == 0
    assert main(second) == 0
    assert view == ["view", "hall", "--screenshot", "hall.png"]
    hall = load_environment(Path("hall"))
    assert "window" in {opening.name for opening in hall.openings}
    assert "crate" in {box.name for box in hall.boxes}
    assert len(list(Path("halls").iterdir())) == 2


@pytest.mark.slow
def test_the_program_solves_a_wind(capsys):
    exec(compile(blocks("python")[0], str(PAGE), "exec"), {})
    assert capsys.readouterr().out == "(30, 20, 12, 3)\n"
