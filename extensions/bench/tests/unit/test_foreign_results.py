"""Results that others have made: what is written there changes nothing elsewhere, and waits for nothing."""

import os
import socket

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_bench.report.writer import write_report
from gslcosim_bench.store import TRIALS, ResultsFolder


def _link_file(path, victim):
    path.symlink_to(victim)


def _link_folder(path, victim):
    path.symlink_to(victim.parent)


def _make_pipe(path, _):
    os.mkfifo(path)


def _make_socket(path, _):
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


@pytest.mark.parametrize("make", [_link_file, _link_folder, _make_pipe, _make_socket])
@pytest.mark.parametrize(
    "name",
    [".lock", "rows.jsonl", "suite.yaml", "report.html", "tables", "tables/pairs.csv", "agents", "scenarios/a.yaml"],
)
def test_nothing_is_written_through_what_is_no_plain_file(tmp_path, monkeypatch, name, make):
    monkeypatch.chdir(tmp_path)  # so that addresses of sockets are short
    victim = tmp_path / "home" / "settings"
    folder = tmp_path / "received"
    victim.parent.mkdir()
    victim.write_text("keep")
    (folder / name).parent.mkdir(parents=True)
    make((folder / name).relative_to(tmp_path), victim)
    with pytest.raises(UsageError, match="expected a file or folder of these results"):
        write_report(folder)
    with pytest.raises(UsageError, match="expected a file or folder of these results"), ResultsFolder(folder).locked():
        pass
    assert [path.name for path in victim.parent.iterdir()] == ["settings"]
    assert victim.read_text() == "keep"


def test_recordings_may_be_kept_elsewhere(tmp_path):
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "recordings").symlink_to(tmp_path)
    with ResultsFolder(tmp_path / "results").locked():
        assert (tmp_path / "results" / ".lock").is_file()


def test_a_table_of_far_more_rows_than_any_suite_has_is_refused(tmp_path):
    """Rows of equal values take next to nothing in the file, and gigabytes in memory."""
    with pq.ParquetWriter(tmp_path / "trials.parquet", TRIALS, compression="zstd") as file:
        many = pa.table({field.name: pa.nulls(100_000, field.type) for field in TRIALS}, schema=TRIALS)
        for _ in range(10):
            file.write_table(many)
    with pytest.raises(UsageError, match="it unpacks to"):
        ResultsFolder(tmp_path).rows()
