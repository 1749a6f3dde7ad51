"""docs/methods.md and docs/methods/ match the method cards, and each bundled method is complete."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest
from methods_page import COSTS, PAGE, PICTURES, build_methods_pages, find_methods, load_costs

ROOT = Path(__file__).parents[2]
DOCS, AGENTS = ROOT / "docs", ROOT / "agents"
METHODS = find_methods(AGENTS, load_costs(DOCS))
MAX_PICTURE_BYTES, MAX_PICTURES_BYTES = 40_000, 2_000_000
CARD = """
schema: gslcosim/method/1
title: {title}
family: {family}
summary: Does it.
paper: "Doe, Roe 1999, a|journal; Poe 2001"
needs: {{sensors: {{gas: 2}}, knows: [map], radio: true}}
robots: [3, 10]
declares: true
parameters:
  step_m: {{default: 1.0, min: 0.5, max: 5, unit: m, origin: "[M]", meaning: length of a leg}}
  rule: {{default: "on", choices: ["on", "off"], origin: ours, meaning: a rule}}
  hold_s: {{default: null, type: float, min: 0, unit: s, origin: ours, meaning: a hold}}
"""


def test_the_pages_match_the_cards():
    pages = build_methods_pages(AGENTS, DOCS)
    assert {path.relative_to(DOCS).as_posix() for path in DOCS.glob("methods/*.md")} == {*pages} - {PAGE}
    for name, text in pages.items():
        assert (DOCS / name).read_text() == text, f"`make docs` rewrites {name}"


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_a_method_has_a_readme_a_picture_and_a_measured_cost(method):
    assert (AGENTS / method.name / "README.md").is_file()
    picture = DOCS / PICTURES / f"{method.name}.png"
    assert picture.is_file(), "docs/studies/draw_method_tracks.py draws it"
    assert picture.stat().st_size <= MAX_PICTURE_BYTES
    assert method.p95_ms is not None, "`make bench-methods SAVE=--save` measures it"


def test_pictures_and_costs_are_those_of_methods_and_small_together():
    names = {method.name for method in METHODS}
    pictures = list((DOCS / PICTURES).iterdir())
    assert {path.name for path in pictures} <= {f"{name}.png" for name in names}
    assert sum(path.stat().st_size for path in pictures) <= MAX_PICTURES_BYTES
    assert json.loads((DOCS / COSTS).read_text())["methods"].keys() <= names


@pytest.fixture(scope="module")
def drawing():
    """The script that draws the pictures."""
    name = "draw_method_tracks"
    spec = importlib.util.spec_from_file_location(name, DOCS / "studies" / f"{name}.py")
    sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_a_picture_shows_a_case_with_all_that_its_method_needs(drawing, method):
    scenario = drawing.case_of(method.name, method.card)
    least, most = method.card.robots if isinstance(method.card.robots, tuple) else (method.card.robots,) * 2
    assert least <= len(scenario.agents) <= most
    assert bool(scenario.channels) == method.card.needs.radio
    for agent in scenario.agents:
        assert set(agent.knows.granted) == set(method.card.needs.knows)
        assert len(agent.sensors) == max(1, sum(method.card.needs.sensors.values()))
    assert scenario.seed == drawing.SEED
    assert {agent.name.split("__")[0] for agent in scenario.agents} == {method.name}


def test_no_two_methods_have_one_title():
    titles = [method.card.title for method in METHODS]
    assert len(set(titles)) == len(titles)


@pytest.fixture
def folders(tmp_path):
    """Two methods, one of them in two more languages; docs without costs."""
    for name, title, family in (("later", "Later", "swarm"), ("first", "First", "anchor")):
        (tmp_path / "agents" / name).mkdir(parents=True)
        (tmp_path / "agents" / name / "method.yaml").write_text(CARD.format(title=title, family=family))
        (tmp_path / "agents" / name / "agent.py").touch()
    (tmp_path / "agents" / "first_rust").mkdir()
    (tmp_path / "agents" / "first_rust" / "agent.yaml").write_text("language: Rust\n")
    (tmp_path / "agents" / "both_cpp").mkdir()
    (tmp_path / "agents" / "both_cpp" / "agent.yaml").write_text("language: C++\nmethods: [first, later]\n")
    return tmp_path / "agents", tmp_path / "docs"


def test_a_row_and_a_section_show_all_that_a_card_has(folders):
    pages = build_methods_pages(*folders)
    row = "| [First](methods/anchor.md#first) | Does it | 2 gas | map | 2 | 3 to 10 | yes |  |  |"
    assert row in pages[PAGE]
    assert pages[PAGE].index("(methods/swarm.md#later)") > pages[PAGE].index(row)
    page = pages["methods/anchor.md"]
    assert "| `step_m` | 1 | 0.5 to 5 m | length of a leg | [M] |" in page
    assert "| `rule` | on | on, off | a rule | ours |" in page
    assert "| `hold_s` | null | from 0 s | a hold | ours |" in page
    assert "Needs: 2 gas, radio, map; robots: 3 to 10." in page
    assert "Also in [C++](../../agents/both_cpp/README.md), [Rust](../../agents/first_rust/README.md)." in page
    assert "## first\n" in page
    assert "Also in [C++](../../agents/both_cpp/README.md)." in pages["methods/swarm.md"]


def test_a_cost_stands_beside_its_limit_with_the_machine_that_it_is_of(folders):
    agents, docs = folders
    (docs / "studies").mkdir(parents=True)
    costs = {"command": "make it", "machine": "a box", "methods": {"first": {"p50_ms": 0.1, "p95_ms": 0.25}}}
    (docs / COSTS).write_text(json.dumps(costs))
    page = build_methods_pages(agents, docs)[PAGE]
    assert "| yes |  | 0.25 / 1 |" in page
    assert "`make it` measures it (a box)" in page
