"""docs/success.md and docs/extend/success-criterion.md: every step is carried out, on a copy."""

import json
import re
from pathlib import Path

import pytest
import yaml

from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.models.success import CRITERIA

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "extend" / "success-criterion.md").read_text()
CRITERIA_PAGE = (ROOT / "docs" / "success.md").read_text()


@pytest.mark.parametrize("piece", re.findall(r"```yaml\n(.*?)```", CRITERIA_PAGE, re.DOTALL))
def test_pieces_of_scenarios_are_valid(piece, tmp_path):
    values = yaml.safe_load((ROOT / "scenarios" / "tiny_room.yaml").read_text()) | yaml.safe_load(piece)
    (tmp_path / "scenario.yaml").write_text(yaml.safe_dump(values))
    assert load_scenario(tmp_path / "scenario.yaml").scenario.referee.success.of in piece


def test_every_criterion_is_on_the_page():
    assert [name for name in CRITERIA if f"| `{name}` |" not in CRITERIA_PAGE] == []


@pytest.fixture(scope="module")
def package(lay_out_package, tmp_path_factory):
    return lay_out_package(PAGE, tmp_path_factory.mktemp("staying"))


@pytest.mark.slow
def test_the_criterion_of_a_package_is_run_reported_and_judged(package, gslcosim_with, tmp_path, find_words):
    words = find_words(PAGE)
    done = gslcosim_with(package, [*words, "--json"], tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    (result,) = tmp_path.glob("runs/*/result.json")
    (agent,) = json.loads(result.read_text())["agents"]
    assert agent["outcome"] == "success"
    assert agent["time_to_source_s"] == pytest.approx(1.0)
    (resolved,) = tmp_path.glob("runs/*/scenario.yaml")
    assert yaml.safe_load(resolved.read_text())["referee"]["success"] == {"within_m": 4.0, "of": "stay", "for_s": 1.0}
