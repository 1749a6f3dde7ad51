"""A valid scenario to spoil in one place, and the problems that then are reported."""

import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario.loader import load_scenario

VALID = """\
schema: gslcosim/scenario/1
name: hall
environment:
  layout: {kind: warehouse_empty, size_m: [15, 10, 8]}
gas:
  sources:
    - {position_m: [5, 1, 2]}
agents:
  - name: beetle
    start: {python: dung_beetle}
    vehicle: {start_m: [12, 9, 0.2]}
    sensors:
      - {model: tgs2600, name: nose}
"""


@pytest.fixture
def scenario_file(tmp_path):
    """Write a scenario: the valid one with pieces of its text replaced."""

    def write(*replacements, name="hall.yaml"):
        text = VALID
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


@pytest.fixture
def problem_lines(scenario_file, tmp_path):
    """Return the lines of the error of the valid scenario with pieces replaced, without the folder's name."""

    def tell(*replacements, **options):
        with pytest.raises(ScenarioError) as refusal:
            load_scenario(scenario_file(*replacements), **options)
        return str(refusal.value).replace(f"{tmp_path}/", "").splitlines()

    return tell
