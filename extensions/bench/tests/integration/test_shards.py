"""A suite that was run in parts: merged, it is what one run of it leaves; what does not fit together is refused."""

import json
import shutil
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gslcosim.base.checksums import CHECKSUMS_FILE
from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main
from gslcosim_bench.merge import merge_shards
from gslcosim_bench.report.writer import write_report
from gslcosim_bench.store import is_machine_dependent

pytestmark = pytest.mark.end_to_end
# Two cases in three parts: one of them is empty.
N = 3


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    """The bundled suite `smoke` by one run, and in parts."""
    root = tmp_path_factory.mktemp("shards")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        assert main(["bench", "run", "smoke", "--jobs", "1", "--no-report"]) == 0
        for i in range(1, N + 1):
            assert main(["bench", "run", "smoke", "--jobs", "1", "--shard", f"{i}/{N}"]) == 0
    return root / "results" / "smoke", [root / "results" / f"smoke-{i}-of-{N}" for i in range(1, N + 1)]


def change_json(path: Path, **values: Any) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))
    (path.parent / CHECKSUMS_FILE).unlink(missing_ok=True)


def take_clock_out(folder: Path) -> None:
    """Make a folder of results one that tells nothing of the machine, and its report anew."""
    table = pq.read_table(folder / "trials.parquet")
    for i, column in enumerate(table.schema):
        if is_machine_dependent(column.name):
            table = table.set_column(i, column, pa.nulls(table.num_rows, column.type))
    pq.write_table(table, folder / "trials.parquet", compression="zstd")
    manifest = json.loads((folder / "manifest.json").read_text())
    for key in ("machine", "wall", "sessions", "recordings", "shards"):
        manifest.pop(key, None)
    (folder / "manifest.json").write_text(json.dumps(manifest))
    (folder / CHECKSUMS_FILE).unlink()
    write_report(folder)


def contents_of(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != ".lock"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files if "recordings" not in path.parts}


def test_merged_shards_are_one_run_to_the_byte(
    folders: tuple[Path, list[Path]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    contents = []
    for name in ("whole", "parts"):
        (tmp_path / name).mkdir()
        # The report names its folder.
        monkeypatch.chdir(tmp_path / name)
        if name == "whole":
            shutil.copytree(folders[0], "results")
        else:
            words = ["bench", "merge", *map(str, reversed(folders[1])), "--out", "results"]
            assert main(words) == 0
            assert Path("results/report.html").is_file()
        take_clock_out(Path("results"))
        contents.append(contents_of(Path("results")))
    whole, parts = contents
    assert whole.keys() == parts.keys()
    assert len(whole) > 8
    assert [name for name in whole if whole[name] != parts[name]] == []


def test_a_merged_folder_is_gone_on_with(
    folders: tuple[Path, list[Path]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Recordings, and shards that never came, are made by a run in the merged folder."""
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "merge", *map(str, folders[1][:2]), "--out", "merged", "--partial", "--no-report"]) == 0
    assert "6 of 12 trials, from 2 of 3 shards.\nMissing: 3/3" in capsys.readouterr().out
    assert main(["bench", "run", "smoke", "--results", "merged", "--jobs", "1", "--json", "--no-report"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["n_flown_before"], printed["n_flown"]) == (6, 6)
    recorded = [
        sorted(path.name for path in (folder / "recordings").iterdir()) for folder in (folders[0], Path("merged"))
    ]
    assert recorded[0] == recorded[1] != []
    with pytest.raises(UsageError, match="has other contents than merged shards"):
        merge_shards(folders[1], Path("merged"))


def test_an_earlier_merge_is_replaced(folders: tuple[Path, list[Path]], tmp_path: Path) -> None:
    merge_shards(folders[1][:2], tmp_path / "merged", is_partial=True)
    summary = merge_shards([*folders[1], folders[1][1]], tmp_path / "merged")
    assert (summary.n_trials, summary.n_chosen, summary.missing) == (12, 12, ())
    tracks = [(folder / "tracks.parquet").read_bytes() for folder in (tmp_path / "merged", folders[0])]
    assert tracks[0] == tracks[1]


def test_missing_shards_and_trials_are_named(folders: tuple[Path, list[Path]], tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"all 3 shards of suite smoke, 1/3, 3/3 are missing"):
        merge_shards(folders[1][1:2], tmp_path / "merged")
    shutil.copytree(folders[1][1], tmp_path / "stopped")
    table = pq.read_table(tmp_path / "stopped" / "trials.parquet")
    pq.write_table(table.slice(2), tmp_path / "stopped" / "trials.parquet")
    (tmp_path / "stopped" / CHECKSUMS_FILE).unlink()
    parts = [folders[1][0], tmp_path / "stopped", folders[1][2]]
    with pytest.raises(UsageError, match=r"stopped: expected all 6 trials of shard 2/3, 2 have no row"):
        merge_shards(parts, tmp_path / "merged")
    assert not (tmp_path / "merged").exists()
    assert merge_shards(parts, tmp_path / "merged", is_partial=True).n_trials == 10


def test_what_is_no_shard_of_the_same_run_is_refused(folders: tuple[Path, list[Path]], tmp_path: Path) -> None:
    whole, parts = folders
    out = tmp_path / "merged"
    with pytest.raises(UsageError, match=r"expected results of a shard \(shard.json\)"):
        merge_shards([whole], out)
    with pytest.raises(UsageError, match="has other contents than merged shards"):
        merge_shards(parts, whole)
    other = tmp_path / "other"

    def refused(file: str, values: dict[str, Any], match: str) -> None:
        shutil.rmtree(other, ignore_errors=True)
        shutil.copytree(parts[2], other)
        change_json(other / file, **values)
        with pytest.raises(UsageError, match=match):
            merge_shards([parts[0], parts[1], other], out)

    manifest = json.loads((parts[2] / "manifest.json").read_text())
    refused("manifest.json", {"suite_hash": "another"}, "was one of suite smoke with the hash another")
    refused(
        "manifest.json",
        {"software_hash": "another", "versions": manifest["versions"] | {"numpy": "1.0"}},
        r"was one by numpy 1.0 \(software another\)",
    )
    entries = [{**entry, "agent_hash": "another"} for entry in manifest["entries"]]
    refused("manifest.json", {"entries": entries}, "other parameters of dung_beetle, ")
    refused("shard.json", {"count": 5, "index": 3}, "expected one of the 3 shards of 12 trials, .* was shard 3/5")
    refused("shard.json", {"index": 10**9, "count": 10**18}, "expected an index from 1 to count")
    refused("shard.json", {"only": [["entry", ["oracle"]]], "n_chosen": 4}, "was shard 3/3 of 4 trials")
    assert not out.exists()


def test_a_trial_that_came_out_differently_is_refused(folders: tuple[Path, list[Path]], tmp_path: Path) -> None:
    parts = folders[1]
    again = tmp_path / "again"
    shutil.copytree(parts[1], again)
    assert merge_shards([*parts, again], tmp_path / "same").n_trials == 12
    table = pq.read_table(again / "trials.parquet")
    i = table.schema.get_field_index("digest")
    pq.write_table(table.set_column(i, table.schema.field(i), [["0" * 32] * 6]), again / "trials.parquet")
    (again / CHECKSUMS_FILE).unlink()
    with pytest.raises(UsageError, match=r"again: expected trial .* to have digest .*, as in .*, was 0{32}"):
        merge_shards([*parts, again], tmp_path / "merged")
