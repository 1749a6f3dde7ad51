"""A suite's hold in flight: the same after each leg, for methods that ask for none and for those that ask for one."""

import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from deadlines import PROCESS_S

SUITE = """
schema: gslcosim/suite/1
name: walks
scenarios: [tiny_room]
anchors: []
{hold}set: {{referee.stop.time_limit_s: 40, referee.success.within_m: 0.05, referee.stop.on_collision: false}}
entries:
  - {{name: hasty, start: {{python: persistent_walk}}, parameters: {{hold_s: 0}}}}
  - {{name: patient, start: {{python: persistent_walk}}, parameters: {{hold_s: 2}}}}
"""


def run_suite(folder: Path, hold: str) -> dict[str, tuple[int, float]]:
    """Return the number of steps and the length of the path of each entry's only run."""
    folder.mkdir()
    (folder / "suite.yaml").write_text(SUITE.format(hold=hold))
    command = [sys.executable, "-m", "gslcosim", "bench", "run", "suite.yaml"]
    options = ["--results", "results", "--jobs", "1", "--no-report"]
    subprocess.run([*command, *options], cwd=folder, capture_output=True, timeout=PROCESS_S, check=True)
    rows = pq.read_table(folder / "results" / "trials.parquet").to_pylist()
    assert {row["status"] for row in rows} == {"flown"}
    return {row["entry"]: (row["steps"], row["path_length_m"]) for row in rows}


@pytest.mark.slow
def test_walks_that_ask_for_other_holds_are_the_same_under_a_suites_hold(tmp_path: Path) -> None:
    as_asked, held = run_suite(tmp_path / "asked", ""), run_suite(tmp_path / "held", "hold_s: 2\n")
    assert as_asked["hasty"][0] > 1.3 * as_asked["patient"][0]
    assert held["hasty"] == held["patient"]
    assert held["hasty"][0] == as_asked["patient"][0]
