"""docs/get-started.md is true: a newcomer who types its commands in an empty folder gets what it says."""

import re
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from page_commands import type_block

PAGE = Path(__file__).parents[2] / "docs" / "get-started.md"
BLOCKS = re.findall(r"```sh\n(.*?)```", PAGE.read_text(), re.DOTALL)
(SUITE,) = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL)


@pytest.mark.end_to_end
@pytest.mark.slow
def test_the_page_leads_to_a_comparison(tmp_path):
    (tmp_path / "my_study.yaml").write_text(SUITE)
    assert BLOCKS[0].startswith("pip install")
    for block in BLOCKS[1:]:
        ended = type_block(block, tmp_path)
        assert ended.returncode == 0, f"{block}\n{ended.stdout}\n{ended.stderr}"
    assert {"track.pdf", "gas.pdf"} <= {path.name for path in (tmp_path / "figures").iterdir()}
    entries = pq.read_table(tmp_path / "results" / "my_study" / "trials.parquet").column("entry").to_pylist()
    assert set(entries) == {"my_agent", "surge_cast", "oracle", "random_walker"}
