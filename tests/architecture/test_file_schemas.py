"""Published JSON Schemas of files are what the models say, and every bundled file names its own and is valid."""

import json
import re
from pathlib import Path

import jsonschema
import pytest
import yaml
from file_schemas import MODELS, build_schema_text

from gslcosim.base.bundled import bundled_agents, bundled_schemas
from gslcosim.base.yaml_core import EDITOR_HEADER, CoreLoader, without_editor_header
from gslcosim.cli.main import main
from gslcosim.scenario import load_scenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim_bench.cases.models import EntrySpec
from gslcosim_bench.cases.suite_files import agent_hash

ROOT = Path(__file__).parents[2]
KIND = re.compile(r"^schema: gslcosim/(\w+)/", re.MULTILINE)
PATTERNS = ("scenarios/**/*.yaml", "agents/*/method.yaml", "docs/examples/**/method.yaml")
FILES = {
    path.relative_to(ROOT).as_posix(): found[1]
    for pattern in PATTERNS
    for path in sorted(ROOT.glob(pattern))
    if (found := KIND.search(path.read_text()))
}
TEMPLATE = "extensions/conformance/gslcosim_conformance/templates/participants/ventilated_room.yaml"


def validator_of(kind):
    return jsonschema.Draft202012Validator(json.loads(bundled_schemas()[kind].read_text()))


def values_of(path):
    return yaml.load(path.read_text(), Loader=CoreLoader)


@pytest.mark.parametrize("kind", MODELS)
def test_a_schema_is_what_its_model_says(kind):
    assert bundled_schemas()[kind].read_text() == build_schema_text(kind), "`make contract` rewrites it"
    jsonschema.Draft202012Validator.check_schema(json.loads(bundled_schemas()[kind].read_text()))


def test_there_are_files_of_each_kind():
    assert set(FILES.values()) == set(MODELS)
    assert len(FILES) > 100


@pytest.mark.parametrize("name", FILES)
def test_a_bundled_file_names_its_schema_and_is_valid(name):
    path = ROOT / name
    header = path.read_text().splitlines()[0]
    assert header.startswith(f"{EDITOR_HEADER}$schema=")
    named = (path.parent / header.partition("$schema=")[2]).resolve()
    assert named == bundled_schemas()[FILES[name]].resolve()
    assert [error.message for error in validator_of(FILES[name]).iter_errors(values_of(path))] == []


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("scenario", {"tick_ms": "ten"}), ("scenario", {"sead": 1}), ("suite", {"repetitions": 0}),
        ("method", {"family": "reactiv"}), ("method", {"includes": ["nope"]}), ("family", {"seeds": {}}),
        ("train", {"trainer": {"kind": "guess"}}),
    ],
)  # fmt: skip
def test_a_schema_refuses_what_its_loader_refuses(kind, change):
    values = values_of(ROOT / next(name for name, each in FILES.items() if each == kind))
    assert validator_of(kind).is_valid(values)
    assert not validator_of(kind).is_valid({**values, **change})


def test_a_new_scenario_names_the_schema_of_this_installation(tmp_path, capsys):
    assert main(["participant", "new", "python", "cooler", "--dir", str(tmp_path)]) == 0
    header, *_ = (tmp_path / "ventilated_room.yaml").read_text().splitlines()
    assert header == f"{EDITOR_HEADER}$schema={bundled_schemas()['scenario'].as_uri()}"
    load_scenario(tmp_path / "ventilated_room.yaml")
    assert validator_of("scenario").is_valid(values_of(ROOT / TEMPLATE))


def test_the_line_for_editors_is_no_content(tmp_path):
    """An agent is the same with and without it, so that results of before go on to be its."""
    card = bundled_agents()["surge_cast"].with_name("method.yaml").read_bytes()
    hashes = set()
    for content in (card, without_editor_header(card)):
        (tmp_path / "method.yaml").write_bytes(content)
        (tmp_path / "agent.py").write_text("x = 1\n")
        hashes.add(agent_hash(EntrySpec(name="a", start=StartSpec(python="agent.py")), tmp_path))
    assert len(hashes) == 1
    assert without_editor_header(card) != card
    assert without_editor_header(b"a: 1\n") == b"a: 1\n"
