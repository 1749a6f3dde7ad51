"""JSON of others is of the types that were asked for, or is reported in one sentence with its place."""

import json
import os
import zipfile
from pathlib import Path
from typing import Required, TypedDict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gslcosim.base.untrusted_input import (
    MAX_LEVELS,
    JsonObject,
    MalformedFileError,
    parse_json,
    read_json,
    read_json_lines,
    read_npz,
    validate_value,
)


class Agent(TypedDict, total=False):
    name: Required[str]
    path_m: float | None


class Result(TypedDict, total=False):
    ticks: int
    agents: list[Agent]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "r: expected JSON, was text that cannot be read (line 1, column 1: expecting value)."),
        ('{"ticks": 1,}', "r: expected JSON, was text that cannot be read (line 1, column 13: "),
        ("null", "r: expected a block, was nothing."),
        ("[]", "r: expected a block, was a list."),
        ('{"ticks": null}', "r: ticks: expected a whole number, was nothing."),
        ('{"ticks": 1.5}', "r: ticks: expected a whole number, was a number."),
        ('{"agents": [{"name": "a"}, {}]}', "r: agents[1]: expected the key name, was missing."),
        ('{"agents": [{"name": 3}]}', "r: agents[0].name: expected a text, was a whole number."),
        (
            '{"agents": [{"name": "a", "path_m": "x"}]}',
            "r: agents[0].path_m: expected a number or nothing, was a text.",
        ),
        ("[" * 100_000, f"r: expected lists and blocks at most {MAX_LEVELS} deep, was a deeper one."),
        ('{"a": ' * 100_000, f"r: expected lists and blocks at most {MAX_LEVELS} deep, was a deeper one."),
        (f'{{"ticks": {"9" * 5000}}}', "r: expected numbers of at most 20 digits, was a longer one."),
    ],
    ids=range(12),
)
def test_what_is_wrong_is_reported_with_its_place(text, expected):
    with pytest.raises(MalformedFileError) as refusal:
        parse_json(text, Result, place="r")
    assert str(refusal.value).startswith(expected)


def test_further_keys_and_brackets_in_texts_are_passed_over():
    shown = {
        "ticks": 2,
        "agents": [{"name": "[" * 1000 + '\\"', "path_m": None}],
        "other": {"a": [1e-300, 12345678901]},
    }
    assert parse_json(json.dumps(shown), Result, place="r") == shown
    assert parse_json(json.dumps(shown).encode(), JsonObject, place="r") == shown
    assert parse_json(b"\xef\xbb\xbf{}", JsonObject, place="r") == {}


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32", "latin-1"])
def test_other_encodings_are_refused(encoding):
    """Brackets that are hidden in them would not be counted."""
    with pytest.raises(MalformedFileError, match=r"expected (UTF-8 text|JSON)"):
        parse_json('{"ä": 1}'.encode(encoding), JsonObject, place="r")


@given(st.binary(max_size=40) | st.text(st.sampled_from('{}[]",:0"\\ null1e9.-'), max_size=40).map(str.encode))
def test_any_bytes_give_a_block_or_an_error(data):
    shown = "r: expected "
    try:
        assert isinstance(parse_json(data, JsonObject, place="r"), dict)
    except MalformedFileError as error:
        shown = str(error)
    assert shown.startswith("r: expected ")


def test_a_missing_file_of_this_folder_is_named_with_the_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MalformedFileError, match=f"^{tmp_path.name}: expected a folder with result.json, found none"):
        read_json(Path("result.json"), Result)


def test_a_file_is_named_with_what_helps(tmp_path):
    path = tmp_path / "result.json"
    with pytest.raises(MalformedFileError, match=r"expected a folder with result\.json, found none\.\nFile: /"):
        read_json(path, Result)
    path.write_text('{"ticks": "x"}')
    with pytest.raises(
        MalformedFileError, match=r"/result\.json: ticks: expected a whole number, was a text\. Fly again\.\nFile: /"
    ):
        read_json(path, Result, remedy="Fly again.")
    with pytest.raises(MalformedFileError, match=r"expected a file that can be read, was more than 3 bytes\. Take"):
        read_json(path, Result, max_bytes=3)
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(MalformedFileError, match="was a pipe and no file"):
        read_json(path, Result)


def test_lines_are_read_one_by_one(tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text('{"ticks": 1}\n{"ticks": 2}\n{"ticks": 3')
    assert [line["ticks"] for line in read_json_lines(path, Result)] == [1, 2]
    path.write_text('{"ticks": 1}\n{"ticks": []}\n')
    with pytest.raises(MalformedFileError, match=r"rows\.jsonl:2: ticks: expected a whole number, was a list\. Take"):
        list(read_json_lines(path, Result))
    path.write_text("{" + " " * 100 + "}\n")
    with pytest.raises(MalformedFileError, match=r"rows\.jsonl:1: expected at most 50 bytes, was more"):
        list(read_json_lines(path, Result, max_bytes=50))


def test_plain_values_are_checked_too():
    assert validate_value({"ticks": 1}, Result, place="r") == {"ticks": 1}
    with pytest.raises(MalformedFileError, match=r"^r: expected a block, was a list\.$"):
        validate_value([], JsonObject, place="r")


def test_half_of_a_surrogate_pair_is_no_text():
    with pytest.raises(MalformedFileError, match=r"^here: expected text, was half of a surrogate pair"):
        parse_json('{"\\ud800": 1}', Result, place="here")


def test_arrays_are_counted_before_they_are_unpacked(tmp_path):
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, a=np.zeros(1 << 20), b=np.arange(3))
    assert path.stat().st_size < 1 << 16
    assert read_npz(path)["b"].tolist() == [0, 1, 2]
    with pytest.raises(ValueError, match="expected at most 4 MB of arrays, was 8 MB"):
        read_npz(path, max_bytes=4 << 20)


@pytest.mark.parametrize(
    "content", [b"", b"PK\x03\x04", b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'shape': (9" + b"9" * 40]
)
def test_what_holds_no_arrays_is_a_value_error(tmp_path, content):
    path = tmp_path / "x.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", content)
    with pytest.raises(ValueError, match=r"."):
        read_npz(path)
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"."):
        read_npz(path)
