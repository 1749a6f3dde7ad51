"""The page of all keys of a scenario is current and whole: every key of every block, each with what it means."""

from pathlib import Path

import pytest
from scenario_page import BlockSection, build_scenario_page, iterate_sections, section_rows

from gslcosim.scenario.model_schema import _all_blocks, list_keys
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.problems import child_path

PAGE = (Path(__file__).parents[2] / "docs" / "scenario.md").read_text()
SECTIONS = list(iterate_sections(BlockSection(path="", kinds={"": Scenario})))
ROWS = [row for section in SECTIONS for row in section_rows(section)]


def test_the_page_is_what_the_models_say():
    assert build_scenario_page() == PAGE, "`make docs` rewrites it"


def test_every_key_of_every_block_is_on_the_page():
    keys = {child_path(path, key) for path, model in _all_blocks(Scenario, "") for key in list_keys(model)}
    assert {row.path for row in ROWS} == keys
    assert [key for key in keys if f"| `{key}` |" not in PAGE] == []


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.path}-{row.default}")
def test_every_key_has_a_meaning_a_default_and_what_is_allowed(row):
    assert row.meaning
    assert row.default
    assert row.allowed
    assert "class" not in row.allowed


@pytest.mark.parametrize(
    "line",
    [
        "| `tick_ms` | a whole number from 1 to 1000 | milliseconds | 100 | tick: time between message exchanges, "
        "a multiple of 4 |",
        "| `agents[].vehicle.avoidance` | one of none, 2d or 3d |  | none | obstacle avoidance: none, around "
        "obstacles at its height (2d), or also over and under them (3d) |",
        "| `wind.max_time_s` | a number greater than 0 | seconds | 120 | auto, built_in | latest end of a solve "
        "without `end_time_s` |",
        "| `gas.sources[].release.on_s` | a number greater than 0 | seconds | 10 | intermittent | time of release |",
        "| `gas.define[].mox[].b` | a number of at most 0 |  | required | exponent |",
        "| `environment.layout.corridor_m` | a number greater than 0 | metres | 2 | office | width of the corridor |",
    ],
)
def test_a_row_says_what_the_model_says(line):
    assert f"\n{line}\n" in PAGE
