"""The way of docs/benchmark/submit.md, walked as it stands there: from `agent new` to a row in the table."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import PROCESS_S

from gslcosim.bench.verification_marks import find_mark

PAGE = Path(__file__).parents[2] / "docs" / "benchmark" / "submit.md"
COMMANDS = re.findall(r"```sh\n(.*?)```", PAGE.read_text(), re.DOTALL)
(SUITE,) = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL)


@pytest.mark.end_to_end
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("go") is None, reason="needs Go: apt-get install golang-go")
@pytest.mark.debian
def test_the_page_leads_to_a_row_in_the_table(tmp_path: Path) -> None:
    (tmp_path / "my_submission.yaml").write_text(SUITE)
    paths = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    for block in COMMANDS:
        ended = subprocess.run(
            ["sh", "-e", "-c", block], cwd=tmp_path, env={**os.environ, "PATH": paths}, capture_output=True, text=True,
            timeout=PROCESS_S, check=False,
        )  # fmt: skip
        assert ended.returncode == 0, f"{block}\n{ended.stdout}\n{ended.stderr}"
    leaderboard = json.loads((tmp_path / "results" / "ranked" / "leaderboard.json").read_text())
    entries = {row["entry"] for row in leaderboard["views"][0]["rows"]}
    assert entries == {"my_method", "dung_beetle", "oracle", "random_walker"}
    mark = find_mark(tmp_path / "results" / "my_submission")
    assert mark is not None
    assert mark.same == mark.sample == 5
    assert mark.n_missing == 0
