"""Sweeps and tunings flown by real workers: the same however they are run, and resumed where they stopped."""

import contextlib
import io
import json
import re
import shlex
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as pq
import pytest

from gslcosim.cli.main import main
from gslcosim_bench.commands.workers import start_pool
from gslcosim_bench.execution.pool import Pool
from gslcosim_bench.store import ResultsFolder
from gslcosim_bench.studies.runner import StudyHost
from gslcosim_bench.studies.target import find_target, parse_ranges
from gslcosim_bench.studies.tuning import Tuner, TuningProgress, split_budget

PAGE = (Path(__file__).parents[4] / "docs" / "benchmark" / "sweeps.md").read_text()
FLOWN = [line for line in PAGE.splitlines() if line.startswith("gslcosim ") and "tiny_room" in line]
SWEEP, TUNE = (shlex.split(line)[1:] for line in FLOWN)


def trials_of(folder: Path) -> list[dict[str, Any]]:
    table = pq.read_table(folder / "trials.parquet")
    return table.select([name for name in table.schema.names if not name.startswith("wall_")]).to_pylist()


@pytest.mark.end_to_end
@pytest.mark.tour
def test_a_sweep_on_the_page_is_run_once_and_reported_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(SWEEP) == 0
    shown = capsys.readouterr().out
    folder = tmp_path / re.findall(r"^Results: (\S+)", shown, re.MULTILINE)[0]
    fields = json.loads((folder / "sweep.json").read_text())
    rows = trials_of(folder)
    assert {row["status"] for row in rows} == {"flown"}
    points = fields["points"]
    assert len(rows) == sum(point["n"] for point in points) == 2 * len(points)
    for point in points:
        own = [row for row in rows if row["entry"] == point["entry"]]
        assert point["score"]["value"] == pytest.approx(sum(row["score"] for row in own) / len(own))
        assert [(row["seed"], row["gas_seed"]) for row in own] == [
            (r["seed"], r["gas_seed"]) for r in rows[:: len(points)]
        ]
    assert "response_leg_m_score" in (folder / "report.html").read_text()
    files = {name: (folder / name).read_bytes() for name in ("sweep.json", "sweep.csv", "trials.parquet")}
    assert main([*SWEEP, "--json"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out) == fields
    assert output.err == ""
    assert {name: (folder / name).read_bytes() for name in files} == files


@pytest.fixture(scope="module")
def tuned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tuning on the page: ten settings with a run each, by one worker, without an interruption."""
    folder = tmp_path_factory.mktemp("tuned") / "results"
    with contextlib.redirect_stdout(io.StringIO()) as output:
        assert main([*TUNE, "--jobs", "1", "--results", str(folder)]) == 0
    (folder / "told.txt").write_text(output.getvalue())
    return folder


@pytest.mark.end_to_end
@pytest.mark.tour
@pytest.mark.extras
def test_a_tuning_keeps_to_its_budget_and_leaves_its_files(tuned: Path) -> None:
    fields = json.loads((tuned / "tuning.json").read_text())
    training, n_settings = trials_of(tuned / "training"), len(fields["settings"])
    assert fields["budget"]["used"] <= 12
    assert n_settings == fields["n_asked"] + 1 == 10
    assert len(training) == fields["budget"]["search"] == n_settings
    best = max(fields["settings"], key=lambda each: each["score"]["value"])
    assert fields["best"]["setting"] == best["setting"]
    assert len((tuned / "tuning.csv").read_text().splitlines()) == n_settings + 1
    assert (tuned / "study.log").is_file()
    if best["setting"] != "default":
        assert len(trials_of(tuned / "validation")) == fields["budget"]["validation"] == 2
    assert len({(row["seed"], row["gas_seed"]) for row in training}) == 1, "all settings fly the same"


@pytest.mark.end_to_end
@pytest.mark.extras
def test_an_interrupted_tuning_goes_on_and_ends_the_same(
    tuned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With another number of workers, too, which start once and end with the call."""
    subject = find_target("tiny_room", "dung_beetle")
    ranges = parse_ranges(["leg_m=0.2:2.0"], subject)

    def stop(stage: TuningProgress) -> None:
        if stage.n_settings > 5:
            raise KeyboardInterrupt

    pools: list[Pool] = []

    def start() -> Pool:
        pools.append(start_pool(Namespace(jobs=2, ray=None), subject.loaded.suite.limits))
        return pools[-1]

    children = set(psutil.Process().children(recursive=True))
    with pytest.raises(KeyboardInterrupt):
        Tuner(
            subject, ranges, split_budget(12, 1), seed=0, folder=tmp_path, tell=stop, host=StudyHost(start_pool=start),
        ).tune()  # fmt: skip
    assert len(pools) == 1
    assert not set(psutil.Process().children(recursive=True)) - children
    n_kept = len(ResultsFolder(tmp_path / "training").rows())
    assert 5 < n_kept < 10
    assert main([*TUNE, "--jobs", "2", "--results", str(tmp_path)]) == 0
    assert f"{n_kept} of these flights were there already." in capsys.readouterr().out
    for name in ("tuning.json", "tuning.csv"):
        assert (tmp_path / name).read_bytes() == (tuned / name).read_bytes()
    assert trials_of(tmp_path / "training") == trials_of(tuned / "training")
    assert not list(tmp_path.glob("*/earlier-*"))


@pytest.mark.end_to_end
@pytest.mark.extras
def test_a_finished_tuning_is_reported_again_without_a_run(
    tuned: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def no_pool(*_: object) -> Callable[[], None]:
        raise AssertionError("nothing is flown")

    monkeypatch.setattr("gslcosim_bench.commands.tune.start_pool", no_pool)
    before = (tuned / "tuning.json").read_bytes()
    assert main([*TUNE, "--results", str(tuned), "--json"]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    assert json.loads(output.out) == json.loads(before)
    assert (tuned / "tuning.json").read_bytes() == before
