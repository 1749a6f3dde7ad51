"""Blocks of success: what each accepts, and what is reported of it."""

import pytest

from gslcosim.scenario.models.scenario import RefereeSpec
from gslcosim.scenario.models.success import CRITERIA, SourceSuccess


@pytest.mark.parametrize(
    ("block", "line"),
    [
        ("{of: sauce}",
         "of: expected one of source, declaration, all_sources or map, was 'sauce'. Did you mean source?"),
        ("{of: source, mass_at_least: 0.5}",
         "mass_at_least: expected one of the keys within_m, of, horizontal, was an unknown key. "
         "mass_at_least belongs to of: map."),
        ("{of: map, horizontal: true}",
         "horizontal: expected one of the keys within_m, of, mass_at_least, was an unknown key. "
         "horizontal belongs to of: source, declaration, all_sources."),
        ("{of: map, mass_at_least: 1.5}", "mass_at_least: expected a number greater than 0 to 1, was 1.5."),
        ("{of: all_sources, within_m: 0}", "within_m: expected a number greater than 0 in metres, was 0."),
    ],
)  # fmt: skip
def test_what_means_nothing_for_a_criterion_is_a_problem_with_place_and_remedy(problem_lines, block, line):
    assert problem_lines(("agents:", f"referee:\n  success: {block}\nagents:")) == [
        f"hall.yaml:9: referee.success.{line}"
    ]


def test_no_block_at_all_is_one_problem_too(problem_lines):
    (line,) = problem_lines(("agents:", "referee: {success: near}\nagents:"))
    assert "expected a block with the key of, one of source, declaration, all_sources or map, was 'near'" in line


@pytest.mark.parametrize(
    ("block", "task"),
    [
        ({}, "Find the source of ethanol in the room: come within 1 m of it"),
        ({"horizontal": True}, "Find the source of ethanol in the room: come within 1 m of it in the plane"),
        ({"of": "declaration", "within_m": 0.5},
         "Find the source of ethanol in the room: declare a position within 0.5 m of it"),
        ({"of": "all_sources", "horizontal": True},
         "Find all sources of ethanol in the room: come within 1 m of each in the plane"),
        ({"of": "map", "mass_at_least": 0.8},
         "Find the source of ethanol in the room: send a belief with a probability of at least 0.8 within 1 m of it"),
    ],
)  # fmt: skip
def test_the_task_says_what_has_to_be_done(block, task):
    assert RefereeSpec.model_validate({"success": block}).success.task_text("ethanol") == task


def test_without_a_word_success_is_the_vehicle_at_the_source():
    assert RefereeSpec().success == RefereeSpec.model_validate({"success": {}}).success == SourceSuccess()


@pytest.mark.parametrize("name", CRITERIA)
def test_a_block_is_written_and_read_back_equal(name):
    referee = RefereeSpec.model_validate({"success": {"of": name, "within_m": 0.7}})
    assert RefereeSpec.model_validate_json(referee.model_dump_json()) == referee
    assert list(referee.success.model_dump())[:2] == ["within_m", "of"]
