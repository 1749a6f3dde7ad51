"""The page on vehicles names all there is: models, settings, commands, and the lines of the report."""

import importlib.util
import re
import sys
from pathlib import Path

import yaml

from gslcosim.contract.messages import AGENT_KINDS
from gslcosim.scenario.models.scenario import VehicleSpec
from gslcosim.vehicles import list_vehicle_names

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "vehicles.md").read_text()


def test_every_model_and_every_setting_is_on_the_page():
    assert [name for name in list_vehicle_names() if f"| `{name}` |" not in PAGE] == []
    assert [name for name in VehicleSpec.model_fields if f"`{name}`" not in PAGE] == []


def test_every_command_is_on_the_page():
    told_elsewhere = {"noop", "declare_source"}
    assert [kind for kind in AGENT_KINDS if f"`{kind}`" not in PAGE and kind not in told_elsewhere] == []


def test_pieces_of_scenarios_are_valid():
    for piece in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL):
        fields = yaml.safe_load(piece)["vehicle"]
        VehicleSpec.model_validate({**fields, "start_m": tuple(fields["start_m"])})


def test_the_report_on_the_page_has_the_lines_of_the_report():
    """Names and targets; figures are those of one machine."""
    spec = importlib.util.spec_from_file_location("robot_accuracy", ROOT / "docs" / "studies" / "robot_accuracy.py")
    study = importlib.util.module_from_spec(spec)
    sys.modules["robot_accuracy"] = study
    spec.loader.exec_module(study)
    block = PAGE.split("```\naccuracy")[1].split("```")[0]
    shown = [re.match(r"(.{36}) +\S+ +(\S+)", line) for line in block.splitlines()[1:]]
    assert [(line[1].rstrip(), float(line[2])) for line in shown] == [(f.name, f.target) for f in study.figures()]
