"""The text that tells a file with ten faults of ten kinds: file, line, place, expected, found and remedy of each."""

from pathlib import Path

import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario import load_scenario

FILE = Path(__file__).parent / "ten_faults.yaml"


def test_a_file_with_ten_faults_is_reported_in_one_error(golden):
    with pytest.raises(ScenarioError) as refusal:
        load_scenario(FILE)
    golden("ten_faults.txt", str(refusal.value).replace(str(FILE), FILE.name) + "\n")
