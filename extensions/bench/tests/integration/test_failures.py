"""A search for failures, flown: the same call ends the same, and each failure can be flown again."""

import json
from pathlib import Path

import pytest

from gslcosim.cli.main import main


@pytest.mark.end_to_end
@pytest.mark.slow
def test_a_search_is_resumed_to_the_same_and_its_worst_case_is_flown_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["bench", "failures", "random_walker", "--in", "tiny_room", "--budget", "32", "--jobs", "1", "--json"]
    folder = tmp_path / "results"
    assert main([*call, "--results", str(folder)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["n_runs"] <= 32
    assert found["failures"]
    tables = (folder / "trials.parquet").read_bytes()
    assert main([*call, "--results", str(folder), "--film", "1"]) == 0
    assert json.loads(capsys.readouterr().out) == found
    assert (folder / "trials.parquet").read_bytes() == tables
    assert (folder / "films" / f"{found['failures'][0]['case']}.webp").stat().st_size > 0
    trial = found["failures"][0]["trial"]
    assert main(["bench", "show", str(folder), "--trial", trial, "--no-view", "--json", "--trusted"]) == 0
    assert json.loads(capsys.readouterr().out)["equal"]
