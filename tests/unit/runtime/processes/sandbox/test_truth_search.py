"""What an agent may not see: runs, results of suites, rooms, and files that hold the truth under any name."""

import bz2
import gzip
import io
import json
import lzma
import os
import tarfile
import zipfile

import pyarrow
import pytest

from gslcosim.base.files import remove_tree
from gslcosim.runtime.processes.sandbox import selection
from gslcosim.runtime.processes.sandbox.selection import TooMuchToSearchError, find_exposed_truth, is_truth_folder

RUN = ("scenario.yaml", "manifest.json", "inputs.log", "logs/agent_x.log")
RESULTS = ("suite.yaml", "manifest.json", "trials.parquet", "tables/all.csv", "agents/mine/mine.py")
ROOM = ("environment.yaml", "occupancy.npy")


def made(folder, names):
    """Make a folder with empty files."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return folder


def test_folders_of_truth_are_found_whole_however_they_are_named(tmp_path):
    run, results, room = (
        made(tmp_path / name, names) for name, names in (("a", RUN), ("b", RESULTS), ("deep/er/c", ROOM))
    )
    made(tmp_path / "mine", ("agent.py", "notes.yaml"))
    assert sorted(find_exposed_truth([tmp_path])) == sorted([run, results, room])


def test_a_folder_in_which_runs_are_made_is_hidden_whole(tmp_path):
    """Others may be made there while the agent looks."""
    made(tmp_path / "runs" / "a", RUN)
    made(tmp_path, ("agent.py",))
    assert find_exposed_truth([tmp_path]) == [tmp_path / "runs"]
    assert find_exposed_truth([tmp_path / "runs"]) == [tmp_path / "runs" / "a"]


def test_single_files_of_truth_are_found_by_what_they_hold(tmp_path):
    texts = {
        "a.yaml": "schema: gslcosim/scenario/1",
        "b.json": '{"schema": "gslcosim/results/1"}',
        "c.json": '{"schema": "gslcosim/maps/1"}',
        "d.yml": "format: gslcosim/environment/1",
        "mine.yaml": "gain: 3",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    assert {path.name for path in find_exposed_truth([tmp_path])} == {"a.yaml", "b.json", "c.json", "d.yml"}


def test_what_lies_in_a_folder_of_truth_is_truth_but_for_the_programs_that_results_keep(tmp_path):
    run, results = made(tmp_path / "a", RUN), made(tmp_path / "b", RESULTS)
    assert is_truth_folder(run)
    assert is_truth_folder(run / "logs")
    assert is_truth_folder(results / "tables")
    assert not is_truth_folder(results / "agents" / "mine")
    assert not is_truth_folder(results / "suites" / "included" / "agents" / "mine")
    assert not is_truth_folder(results / "suites" / "outer" / "suites" / "inner" / "agents" / "mine")
    assert is_truth_folder(results / "suites" / "included" / "scenarios")
    assert is_truth_folder(results / "suites" / "agents")
    assert not is_truth_folder(tmp_path)
    (tmp_path / "link").symlink_to(run)
    assert is_truth_folder(tmp_path / "link")


LONG = "# " + "x" * (3 << 20) + "\n"
SCHEMA = "schema: gslcosim/scenario/1\n"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("notes.txt", SCHEMA),
        ("room.yaml.bak", SCHEMA),
        ("room", SCHEMA),
        ("long.yaml", LONG + SCHEMA),
        ("escaped.json", json.dumps({"schema": "gslcosim/scenario/1"}).replace("/", "\\/")),
        ("hexadecimal.yaml", 'schema: "gslcosim\\x2fscenario\\u002f1"'),
        ("folded.yaml", 'schema: "gslcosim/\\\n  scenario/1"'),
        ("wide.yaml", SCHEMA.encode("utf-16")),
        ("a/b/c/d/e/f/g/deep.yaml", SCHEMA),
        ("recording.rrd", b"whatever"),
        ("copy_of_recording", b"RRF2\0\0\0\0"),
        ("bag.mcap", b""),
        ("one.secret.json", b'{"schema": "gslcosim/seal/1", "seed": 1}'),
        ("id_ed25519", b"-----BEGIN OPENSSH PRIVATE KEY-----\nb3Bl"),
        ("filaments.csv", '"tick","time_s","x_m","y_m","z_m","sigma_m"'),
        ("lookup", "x_m,y_m,z_m,mixing_ratio_ppm\n1,2,3,0.5\n"),
        ("spreadsheet.txt", "x_m;y_m;z_m;wind_x_m_s;wind_y_m_s"),
        ("dictionary.csv", "file,column,unit,type,meaning"),
        ("words.json", '{"run_id": "tiny_room-seed1", "seed": 1}'),
        ("plot.png", b"\x89PNG\r\n\x1a\n....tEXtSoftware\0gslcosim plot"),
        ("table.dat", b"PAR1" + bytes(200_000) + b"\0x_m\0\0y_m\0\0z_m\0\0ethanol_ppm\0PAR1"),
        ("film.avi", b"\0\0\0\x20ftypisom"),
        ("certificate_key.pem", b"-----BEGIN RSA PRIVATE KEY-----\nMIIE"),
    ],
)
def test_copies_are_found_in_each_spelling_under_each_name(tmp_path, name, content):
    path = made(tmp_path, [name]) / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    made(tmp_path, ("agent.py", "readme.md"))
    assert find_exposed_truth([tmp_path]) == [path]


def zipped(name, data, method=zipfile.ZIP_DEFLATED):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", method) as archive:
        archive.writestr(f"folder/{name}", data)
    return packed.getvalue()


def taped(name, data, mode="w"):
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode=mode) as tape:
        for each, content in (("readme.md", b"# Old" + bytes(100_000)), (name, data)):
            member = tarfile.TarInfo(each)
            member.size = len(content)
            tape.addfile(member, io.BytesIO(content))
    return packed.getvalue()


PACKINGS = {
    "a.gz": lambda name, data: gzip.compress(data),
    "b.bz2": lambda name, data: bz2.compress(data),
    "c.xz": lambda name, data: lzma.compress(data),
    "d.lzma": lambda name, data: lzma.compress(data, format=lzma.FORMAT_ALONE),
    "e.zst": lambda name, data: pyarrow.compress(data, codec="zstd", asbytes=True),
    "f.zip": zipped,
    "g.zip": lambda name, data: zipped(name, data, zipfile.ZIP_STORED),
    "h.tar": taped,
    "i.tgz": lambda name, data: taped(name, data, "w:gz"),
    "j.tar.xz": lambda name, data: taped(name, data, "w:xz"),
    "weights.bin": lambda name, data: zipped("inner.tar.gz", taped(name, data, "w:gz")),
}
TRUTHS = {
    "filaments.csv": b"tick,time_s,x_m,y_m,z_m\n" + b"1,0.1,1,2,3\n" * 20_000,
    "gas.parquet": b"PAR1" + os.urandom(200_000) + b"\0x_m\0\0y_m\0\0z_m\0\0ethanol_ppm\0PAR1",
    "room.yaml": SCHEMA.encode(),
    "dictionary": b'\xef\xbb\xbf{"run_id": "tiny_room-seed1", "seed": 1}',
}


@pytest.mark.parametrize("truth", TRUTHS)
@pytest.mark.parametrize("packing", PACKINGS)
def test_copies_are_found_in_compressed_files_and_archives(tmp_path, packing, truth):
    (tmp_path / packing).write_bytes(PACKINGS[packing](truth, TRUTHS[truth]))
    assert find_exposed_truth([tmp_path]) == [tmp_path / packing]
    (tmp_path / packing).write_bytes(PACKINGS[packing]("layers", b"weights of a network" * 1000))
    assert find_exposed_truth([tmp_path]) == []


def test_archives_that_cannot_be_opened_here_are_hidden(tmp_path):
    (tmp_path / "old").write_bytes(b"7z\xbc\xaf\x27\x1c\0\4")
    assert find_exposed_truth([tmp_path]) == [tmp_path / "old"]


def test_what_unpacks_to_more_than_is_searched_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(selection, "MAX_BYTES", 4 << 20)
    (tmp_path / "bomb.gz").write_bytes(gzip.compress(b"PAR1" + bytes(64 << 20)))
    with pytest.raises(TooMuchToSearchError):
        find_exposed_truth([tmp_path])


@pytest.mark.slow
def test_folders_of_any_depth_are_searched(tmp_path):
    """Paths may have 4096 bytes, and Python a thousand levels of calls."""
    folder = tmp_path
    for _ in range(1100):
        folder = folder / "d"
        folder.mkdir()
    (folder / "room.yaml").write_text(SCHEMA)
    try:
        assert find_exposed_truth([tmp_path]) == [folder / "room.yaml"]
    finally:
        remove_tree(tmp_path / "d")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("makes_rooms.py", SCHEMA.encode()),
        ("program", b"\x7fELF" + SCHEMA.encode()),
        ("start", b"#!/bin/sh\n" + SCHEMA.encode()),
        ("method.yaml", b"schema: gslcosim/method/1"),
        ("weights.npz", b"PK\3\4"),
        ("unit.fmu", b'PK\3\4modelDescription.xml <Float64 name="gas_ppm" unit="m" label="x_m" file="y_m"/>'),
        ("weights.h5", b"\x89HDF\r\n\x1a\n layer_1 kernel bias"),
        ("places.csv", b"x_m,y_m,z_m\n1,2,3\n"),
        ("readme.md", b"# Tables\n\nThey have tick, time_s, x_m, y_m and z_m.\n"),
        ("logo.png", b"\x89PNG\r\n\x1a\n"),
    ],
)
def test_files_of_a_program_stay(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    assert find_exposed_truth([tmp_path]) == []


def test_what_is_run_is_found_under_its_other_names(tmp_path):
    """A hard link has no content of its own to be known by, a symbolic link leads to what is hidden."""
    source = tmp_path / "elsewhere" / "room.obj"
    source.parent.mkdir()
    source.write_text("o floor")
    (tmp_path / "mine").mkdir()
    os.link(source, tmp_path / "mine" / "linked.py")
    (tmp_path / "mine" / "named").symlink_to(source)
    mine = tmp_path / "mine"
    assert find_exposed_truth([mine], [source]) == [mine / "linked.py", mine / "named", source]


def test_earlier_versions_are_hidden_whole(tmp_path):
    made(tmp_path, (".git/objects/ab/cdef", "agent.py"))
    assert find_exposed_truth([tmp_path]) == [tmp_path / ".git"]


def test_nothing_but_plain_files_is_opened(tmp_path):
    """A pipe would be waited for, for ever."""
    os.mkfifo(tmp_path / "x.yaml")
    (tmp_path / "y.yaml").symlink_to("x.yaml")
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    assert find_exposed_truth([tmp_path]) == []


@pytest.mark.parametrize("bound", [{"MAX_ENTRIES": 3}, {"MAX_BYTES": 30}])
def test_a_folder_with_too_much_is_refused_and_not_searched_in_part(tmp_path, monkeypatch, bound):
    for i in range(4):
        (tmp_path / f"{i}.txt").write_text("something of ten")
    assert find_exposed_truth([tmp_path]) == []
    for name, value in bound.items():
        monkeypatch.setattr(selection, name, value)
    with pytest.raises(TooMuchToSearchError, match=str(tmp_path)):
        find_exposed_truth([tmp_path])


def test_the_libraries_of_an_installed_program_are_not_searched(tmp_path):
    made(tmp_path, ("bin/python3", "lib/python/one.txt"))
    (tmp_path / "lib" / "python" / "one.txt").write_text(SCHEMA)
    (tmp_path / "room.yaml").write_text(SCHEMA)
    assert find_exposed_truth([tmp_path]) == [tmp_path / "room.yaml"]
