"""Gas models and wind solvers of installed packages: refused when they are something else, hashed with their code."""

import importlib
import sys

import pytest
from offering_packages import write_entry_points

from gslcosim.base.errors import ScenarioError
from gslcosim.environment.generation.cache import recipe_hash
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.models.gas import GasSpec
from gslcosim.scenario.models.scenario import EnvironmentSpec, LayoutSpec
from gslcosim_services.fields.gas_setup import GasSetup, build_gas_field_from_block

MODULE = """
from typing import Literal
from gslcosim.scenario.models.wind import SolverSpec

class BreezeSpec(SolverSpec):
    solver: Literal["breeze"] = "breeze"
    speed_m_s: float = 1.0

number = 42
"""
ENTRY_POINTS = """[gslcosim.gas_models]
number = somebodys_air:number
broken = somebodys_missing:x
[gslcosim.wind_solvers]
breeze = somebodys_air:BreezeSpec
misnamed = somebodys_air:BreezeSpec
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Install a package that offers a solver, things that are no gas models, and one that cannot be imported."""
    monkeypatch.delitem(sys.modules, "somebodys_air", raising=False)
    (tmp_path / "somebodys_air.py").write_text(MODULE)
    write_entry_points(monkeypatch, tmp_path, "somebodys_air", ENTRY_POINTS)
    yield tmp_path / "somebodys_air.py"
    monkeypatch.undo()
    sys.modules.pop("somebodys_air", None)
    importlib.invalidate_caches()


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("gas.model=number", "gas.model: expected somebodys_air:number to be a class for 'number' that derives from "
         "GasSpec, was 42. Correct the entry point of the package."),
        ("gas.model=broken", "gas.model: expected somebodys_missing:x to be imported for the gas model 'broken', was "),
        ("wind.solver=misnamed", "wind.solver: expected somebodys_air:BreezeSpec to be a class for 'misnamed' that "),
    ],
)  # fmt: skip
def test_what_cannot_be_used_has_place_expected_found_and_remedy(package, override, expected):
    with pytest.raises(ScenarioError) as refusal:
        load_scenario("tiny_room", overrides=[override])
    assert expected in str(refusal.value)


def test_a_block_without_a_builder_is_refused():
    class Nobody(GasSpec):
        model: str = "nobody"

    scenario = load_scenario("tiny_room").scenario
    with pytest.raises(ScenarioError, match="expected a builder for Nobody, was none"):
        build_gas_field_from_block(Nobody(sources=scenario.gas.sources), GasSetup(scenario=scenario, environment=None))


def test_settings_and_code_of_the_package_decide_its_environments(package):
    room = EnvironmentSpec(layout=LayoutSpec())

    def hash_of(speed_m_s: float) -> str:
        override = f"wind={{solver: breeze, speed_m_s: {speed_m_s}}}"
        return recipe_hash(room, load_scenario("tiny_room", overrides=[override]).scenario.wind)

    before = hash_of(1.0)
    assert hash_of(1.0) == before
    assert hash_of(2.0) != before
    package.write_text(MODULE + "\nanother = 1\n")
    assert hash_of(1.0) != before
