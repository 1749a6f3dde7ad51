"""The way of docs/benchmark/submit.md, walked as it stands there: from `agent new` to a row in the table."""

import json
import re
import shutil
from pathlib import Path

import pytest
from page_commands import type_block

from gslcosim.runtime.processes.sandbox.selection import is_sandboxed
from gslcosim_bench import Results
from gslcosim_bench.verification_marks import find_mark

PAGE = Path(__file__).parents[4] / "docs" / "benchmark" / "submit.md"
BLOCKS = re.findall(r"```(sh|yaml)\n(.*?)```", PAGE.read_text(), re.DOTALL)
# Where the page says that its files lie.
FILES = {
    "gslcosim/method/1": "my_method/method.yaml",
    "gslcosim/submission/1": "my_method/submission.yaml",
    "gslcosim/suite/1": "my_submission.yaml",
}


@pytest.mark.end_to_end
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("go") is None, reason="needs Go: apt-get install golang-go")
@pytest.mark.debian
# A dozen commands in a row, of which four fly.
@pytest.mark.timeout(1800)
def test_the_page_leads_to_a_row_in_the_table(tmp_path: Path) -> None:
    for kind, block in BLOCKS:
        if kind == "yaml":
            (tmp_path / FILES[block.split()[1]]).write_text(block)
            continue
        ended = type_block(block, tmp_path)
        assert ended.returncode == 0, f"{block}\n{ended.stdout}\n{ended.stderr}"
    leaderboard = json.loads((tmp_path / "results" / "ranked" / "leaderboard.json").read_text())
    entries = {row["entry"] for row in leaderboard["views"][0]["rows"]}
    assert entries == {"my_method", "dung_beetle", "oracle", "random_walker"}
    mark = find_mark(tmp_path / "results" / "my_submission")
    assert mark is not None
    # Two places, with the rows of three entries.
    assert mark.same == mark.sample == 6
    assert mark.n_missing == 0
    flown = Results.load(tmp_path / "results" / "smoke_bundles")
    assert set(flown.entries) == {"my_method", "oracle", "random_walker"}
    assert all(is_sandboxed(sandbox) for sandbox in flown.trials["sandbox"].to_pylist())
