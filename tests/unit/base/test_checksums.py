"""Checksums of a folder: what is signed with the key of the cache, and what is not."""

import json

from gslcosim.base.checksums import CHECKSUMS_FILE, check_files, write_checksums


def test_what_somebody_else_says_of_files_is_not_signed_with_the_rest(tmp_path):
    """Else whoever sends results could have files of a room or a tape signed by a report of them."""
    folder = tmp_path / "received"
    folder.mkdir()
    for name in ("wind.npy", "report.json"):
        (folder / name).write_text(name)
    write_checksums(folder, "wind.npy")
    assert check_files(folder, "wind.npy")
    sums = json.loads((folder / CHECKSUMS_FILE).read_text())
    (folder / CHECKSUMS_FILE).write_text(json.dumps(sums | {"signature": "00" * 32}))
    assert not check_files(folder, "wind.npy")
    write_checksums(folder, "report.json")
    assert not check_files(folder, "wind.npy")
    assert not check_files(folder, "report.json")


def test_checksums_of_our_own_stay_signed_when_others_come_beside_them(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).write_text(name)
        write_checksums(tmp_path, name)
    assert check_files(tmp_path, "a", "b")
