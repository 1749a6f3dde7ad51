"""One bit of a file is flipped: what is read is equal, or it is refused with a sentence."""

import dataclasses
import random
import shutil

import numpy as np
import pytest

from gslcosim.base.checksums import CHECKSUMS_FILE, write_checksums
from gslcosim.base.errors import GslCosimError, SnapshotError
from gslcosim.base.kernel_cache import OWNER_VARIABLE
from gslcosim.base.untrusted_input import MalformedFileError
from gslcosim.environment.model import with_wind
from gslcosim.environment.store import load_environment, save_environment
from gslcosim.recordings.run_summary import read_run_summary
from gslcosim.runtime.replay.past_run import PastRun, find_snapshot_before
from gslcosim.runtime.replay.snapshot import ObservationLog, SnapshotPart, read_observations, save_part
from gslcosim.runtime.run import run_scenario
from gslcosim.runtime.run_dir import RunDir
from gslcosim.scenario import load_scenario
from gslcosim.scenario.serialization import plain_values
from gslcosim_bench.store import (
    REQUIRED_COLUMNS,
    SERIES,
    TRIAL_COLUMNS,
    Journal,
    JournalEntry,
    ResultsFolder,
    build_tables,
    pack_tracks,
)
from gslcosim_data.fork import check_inputs
from gslcosim_services.fields.tape import GasTape

N_FLIPS = 200


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "cache"))
    # Else the key is that of the compiled kernels.
    monkeypatch.delenv(OWNER_VARIABLE, raising=False)
    return tmp_path / "cache"


def flip(path, random_):
    content = bytearray(path.read_bytes())
    content[random_.randrange(len(content))] ^= 1 << random_.randrange(8)
    path.write_bytes(content)


def read_flipped(folder, read, *, files=None, n=N_FLIPS):
    """Flip a bit of each file in turn and return how often it was refused; what is read otherwise is as it was."""
    random_, expected, refusals = random.Random(46), read(folder), []
    files = files or sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    for i in range(n):
        # Of the same name, which is signed.
        copy = folder.parent / f"copy_{i}" / folder.name
        shutil.copytree(folder, copy)
        place = files[i % len(files)]
        flip(copy / place, random_)
        try:
            found = read(copy)
        except (GslCosimError, SnapshotError) as error:
            refusals.append(error)
        else:
            assert found == expected, place
    # The text of the second is a reason after "it is".
    assert all("expected" in str(error) or isinstance(error, SnapshotError) for error in refusals)
    return len(refusals)


def describe(value):
    """Return something that is equal for equal values, arrays too."""
    if isinstance(value, np.ndarray):
        return (value.dtype.str, value.shape, value.tobytes())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return [describe(getattr(value, field.name)) for field in dataclasses.fields(value)]
    if isinstance(value, (list, tuple)):
        return [describe(part) for part in value]
    return value


@pytest.fixture
def room(make_room):
    made = make_room(wind_m_s=((0.3, 0.1, 0.0), (0.2, 0.0, 0.1)))
    return with_wind(made, made.wind)


def read_room(folder):
    return describe(load_environment(folder, with_meshes=True))


def test_rooms(room, tmp_path):
    save_environment(room, tmp_path / "rooms" / "room", notices=("A notice.",))
    assert read_flipped(tmp_path / "rooms" / "room", read_room) > N_FLIPS / 4


def test_rooms_without_checksums_are_known_by_their_content(room, tmp_path):
    """Another program has written them, with any hash: no two rooms have one."""
    folder = tmp_path / "room"
    save_environment(room, folder)
    (folder / CHECKSUMS_FILE).unlink()
    assert load_environment(folder).content_hash == room.content_hash
    header = (folder / "environment.yaml").read_text()
    (folder / "environment.yaml").write_text(header.replace(room.content_hash, "f" * 32))
    assert load_environment(folder).content_hash == room.content_hash
    wind = np.load(folder / "wind.npy")
    wind[0, 0, 0, 0] += 1.0
    np.save(folder / "wind.npy", wind)
    assert load_environment(folder).content_hash not in (room.content_hash, "f" * 32)


def test_a_room_whose_checksums_were_made_again_is_held_against_its_content_hash(room, tmp_path, monkeypatch):
    """Checksums of a stranger prove nothing: neither that the hash of a room is its own, which names tapes of gas."""
    folder = tmp_path / "room"
    save_environment(room, folder)
    header = folder / "environment.yaml"
    header.write_text(header.read_text().replace(room.content_hash, "f" * 32))
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "of_a_stranger"))
    write_checksums(folder, "environment.yaml", "occupancy.npy", "wind.npy")
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "cache"))
    with pytest.raises(GslCosimError, match=r"content_hash: expected f{32}"):
        load_environment(folder)


def build_tape(folder):
    """Write a tape as `record_tape` leaves it."""
    folder.mkdir(parents=True)
    random_ = np.random.default_rng(1)
    np.save(folder / "first.npy", np.array([0, 5, 11, 20]))
    np.save(folder / "filaments.npy", random_.random((20, 4), np.float32))
    np.save(folder / "sources.npy", random_.integers(0, 2, 20).astype(np.uint8))
    head = '{"format": "gslcosim/gas_tape/1", "n_frames": 3, "n_filaments": 20, "n_sources": 2}\n'
    (folder / "head.json").write_text(head)
    write_checksums(folder, "first.npy", "filaments.npy", "sources.npy", "head.json")


def test_tapes(tmp_path):
    build_tape(tmp_path / "tapes" / "tape")
    n = read_flipped(tmp_path / "tapes" / "tape", lambda folder: describe(GasTape(folder).arrays))
    assert n > N_FLIPS * 0.8


def test_a_tape_of_another_cache_or_of_another_name_is_not_played(tmp_path, monkeypatch):
    build_tape(tmp_path / "tape")
    shutil.copytree(tmp_path / "tape", tmp_path / "other")
    with pytest.raises(GslCosimError, match="not signed with the key of this cache"):
        GasTape(tmp_path / "other")
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "another"))
    with pytest.raises(GslCosimError, match="not signed with the key of this cache"):
        GasTape(tmp_path / "tape")


def build_part():
    state = {"nodes": [{"k": "list", "v": list(range(50))}]}
    return SnapshotPart(
        participant="world", tick=7, state=state, memory={"next": 8}, trails={"truth/bodies": {"ticks": []}},
        outputs=[("truth/bodies", b"payload")],
    )  # fmt: skip


def test_parts_of_snapshots(tmp_path):
    (tmp_path / "run").mkdir()
    save_part(RunDir(tmp_path / "run"), build_part())
    folder = tmp_path / "run" / "snapshots" / "000000007"

    def read(folder):
        path = folder / "world.snap"
        return describe(SnapshotPart.from_bytes(path.read_bytes(), path))

    assert read_flipped(folder, read) == N_FLIPS


def test_a_part_of_another_cache_place_or_tick_is_not_taken(tmp_path, monkeypatch):
    (tmp_path / "run").mkdir()
    save_part(RunDir(tmp_path / "run"), build_part())
    path = tmp_path / "run" / "snapshots" / "000000007" / "world.snap"
    data = path.read_bytes()
    assert SnapshotPart.from_bytes(data, path) == build_part()
    for other in (path.with_name("fields.snap"), tmp_path / "000000008" / "world.snap"):
        with pytest.raises(SnapshotError, match="not signed"):
            SnapshotPart.from_bytes(data, other)
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "another"))
    with pytest.raises(SnapshotError, match="not signed with the key of this cache"):
        SnapshotPart.from_bytes(data, path)
    # A service that died in a run goes on where it was.
    assert SnapshotPart.from_bytes(data, path, is_of_this_run=True) == build_part()


def test_observations(tmp_path):
    (tmp_path / "run").mkdir()
    log = ObservationLog(RunDir(tmp_path / "run"), "bee")
    payloads = [bytes([i]) * (i % 40) for i in range(200)]
    for payload in payloads:
        log.add(payload)
    log.flush()

    def read(folder):
        stream = read_observations(folder, "bee")
        return [next(stream) for _ in payloads]

    folder = tmp_path / "run" / "snapshots" / "told"
    assert read(folder) == payloads
    assert read_flipped(folder, read) > N_FLIPS * 0.9


def build_row(i):
    empty = {"string": "x", "int64": i, "double": 0.5, "bool": True}
    row = {
        column.name: empty[str(column.type)] if column.name in REQUIRED_COLUMNS else None for column in TRIAL_COLUMNS
    }
    return row | {"trial": f"trial_{i}", "time_to_source_s": 1.0 / (i + 1)}


def build_entry(i):
    series = {key: np.arange(5, dtype=np.float32) + i for key in SERIES}
    return JournalEntry(build_row(i), pack_tracks({"bee": series}))


def read_results(folder):
    results = ResultsFolder(folder)
    entries = {trial: (entry.row, entry.tracks) for trial, entry in results.entries().items()}
    tables = [table.to_pylist() for table in results.tables()]
    return entries, tables, *(results.read_json(path) for path in (results.manifest, results.maps, results.shard))


@pytest.fixture
def results(tmp_path):
    results = ResultsFolder(tmp_path / "results" / "suite")
    results.path.mkdir(parents=True)
    results.write_tables(*build_tables([build_entry(i) for i in range(20)]))
    results.write_json(results.manifest, {"suite": "x", "seed": 4, "entries": [{"name": "a", "title": "A"}]})
    results.write_json(results.maps, {"maps": [{"scenario": "a", "varied": "{}"}]})
    results.write_json(results.shard, {"index": 0, "count": 1, "only": [], "n_chosen": 20, "trials": {"trial_1": 1}})
    return results


def test_results(results):
    assert read_flipped(results.path, read_results, n=300) > 200


def test_rows_of_a_suite_that_runs(tmp_path):
    results = ResultsFolder(tmp_path / "results" / "suite")
    results.path.mkdir(parents=True)
    with Journal(results.journal) as journal:
        for i in range(10):
            journal.append(build_entry(i))
    assert read_flipped(results.path, lambda folder: list(ResultsFolder(folder).entries().items())) > N_FLIPS * 0.8


def test_files_that_are_written_again_and_folders_that_are_not_finished_can_be_read(results):
    """A machine that stops between checksums and file leaves the file before or the new one."""
    before = results.manifest.read_bytes()
    results.write_json(results.manifest, {"suite": "y"})
    assert results.read_json(results.manifest) == {"suite": "y"}
    results.manifest.write_bytes(before)
    assert results.read_json(results.manifest)["suite"] == "x"
    results.manifest.write_bytes(before.replace(b"4", b"5"))
    with pytest.raises(
        MalformedFileError, match=r"suite/manifest\.json: expected the file as it was written, was changed"
    ):
        results.read_json(results.manifest)
    (results.path / CHECKSUMS_FILE).unlink()
    assert results.read_json(results.manifest)["seed"] == 5


CHANGES = {"recording.enabled": False, "snapshots.every_s": 1.0, "referee.stop.time_limit_s": 3.0}


@pytest.fixture
def run(tmp_path):
    loaded = load_scenario("tiny_room", overrides=[f"{path}={value}" for path, value in CHANGES.items()])
    return run_scenario(loaded, runs_dir=tmp_path / "runs", processes="one").run_dir


def read_run(folder):
    past = PastRun.load(folder)
    check_inputs(past)
    summary = read_run_summary(folder)
    if summary.state != "ended" or not summary.scenario:
        raise MalformedFileError("expected a run that has ended, was a broken one")
    facts = dataclasses.replace(summary, folder="", age_h=0.0)
    snapshot, reason = find_snapshot_before(past, 25)
    if snapshot is None or snapshot.tick != 20:
        assert "it is" in reason or (snapshot is not None and snapshot.tick == 10)
        raise SnapshotError("it is an earlier one")
    states = [describe(snapshot.part(name)) for name in ("world", "fields", "sensing", "referee")]
    return (
        past.commands,
        past.digest,
        plain_values(past.scenario),
        past.last_tick,
        facts,
        states,
        list(snapshot.read_observations()),
    )


@pytest.mark.slow
def test_runs(run):
    files = ["scenario.yaml", "setup.json", "manifest.json", "digest.json", "inputs.log", "result.json", CHECKSUMS_FILE]
    assert (run / CHECKSUMS_FILE).is_file()
    assert read_flipped(run, read_run, files=files) > N_FLIPS * 0.8
    shutil.rmtree(run.parent)
