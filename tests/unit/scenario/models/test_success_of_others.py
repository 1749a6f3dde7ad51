"""Criteria of installed packages: named, imported when asked for, refused when they are something else."""

import importlib
from typing import Literal

import pytest
from offering_packages import install_package

from gslcosim.scenario.models.scenario import RefereeSpec
from gslcosim.scenario.models.success import SUCCESS_ENTRY_POINTS, SuccessSpec


class Hover(SuccessSpec):
    of: Literal["hover"] = "hover"
    n_rounds: int = 3

    def task_text(self, gas: str) -> str:
        return f"Hover over {gas}"

    @property
    def summary_text(self) -> str:
        return "hovering"


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Install a package that offers a criterion."""
    install_package(monkeypatch, tmp_path, "somebodys_success", SUCCESS_ENTRY_POINTS, hover=Hover)
    yield
    monkeypatch.undo()
    importlib.invalidate_caches()


def test_a_scenario_may_name_the_criterion_of_a_package_and_keeps_its_settings(package):
    referee = RefereeSpec.model_validate({"success": {"of": "hover", "n_rounds": 5}})
    assert referee.success == Hover(n_rounds=5)
    assert RefereeSpec.model_validate_json(referee.model_dump_json(), strict=True) == referee
    assert RefereeSpec(success=Hover()).success.task_text("ethanol") == "Hover over ethanol"


@pytest.mark.parametrize(
    ("block", "line"),
    [
        ("{of: hover, n_rounds: many}", "n_rounds: expected a whole number, was 'many'."),
        ("{of: hover, n_round: 2}",
         "n_round: expected one of the keys within_m, of, n_rounds, was an unknown key. Did you mean n_rounds?"),
    ],
)  # fmt: skip
def test_problems_of_such_a_block_have_place_expected_found_and_remedy(package, problem_lines, block, line):
    assert problem_lines(("agents:", f"referee:\n  success: {block}\nagents:")) == [
        f"hall.yaml:9: referee.success.{line}"
    ]
