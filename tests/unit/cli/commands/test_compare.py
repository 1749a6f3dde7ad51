"""`gslcosim compare`"""

import json

import pytest

from gslcosim.cli.main import main
from gslcosim.runtime.digest import HashChain, RunDigest


@pytest.fixture
def save_digest(tmp_path):
    """Save the digest of a run whose messages at each tick are the given bytes."""

    def save(name, payloads):
        trail = HashChain()
        for tick, payload in enumerate(payloads):
            trail.append(tick, payload)
        (tmp_path / name).mkdir()
        digest = RunDigest(len(payloads) - 1, {"truth/bodies": "world"}, {"truth/bodies": trail})
        digest.save(tmp_path / name / "digest.json")
        return digest

    return save


def test_equal_runs_return_0(capsys, save_digest, tmp_path):
    digest = save_digest("a", [b"x", b"y"])
    save_digest("b", [b"x", b"y"])
    assert main(["compare", str(tmp_path / "a"), str(tmp_path / "b")]) == 0
    assert capsys.readouterr().out == f"Equal: digest {digest.hex}, final tick 1.\n"


def test_different_runs_return_5_and_say_where_they_part(capsys, save_digest, tmp_path):
    save_digest("a", [b"x", b"y", b"z"])
    save_digest("b", [b"x", b"!", b"z"])
    assert main(["compare", "a", "b", "--runs-dir", str(tmp_path)]) == 5
    first, *others = capsys.readouterr().out.splitlines()
    assert first == "Different from tick 1 on: participant world, port truth/bodies: the messages differ."
    assert [line.split()[-1] for line in others] == [str(tmp_path / "a"), str(tmp_path / "b")]


def test_json_has_the_divergence_or_none(capsys, save_digest, tmp_path):
    digests = [save_digest("a", [b"x"]), save_digest("b", [b"y"])]
    assert main(["compare", "a", "b", "--runs-dir", str(tmp_path), "--json"]) == 5
    printed = json.loads(capsys.readouterr().out)
    assert printed["equal"] is False
    assert printed["digests"] == [digest.hex for digest in digests]
    assert printed["divergence"] == {
        "tick": 0, "participant": "world", "port": "truth/bodies", "text": "the messages differ"
    }  # fmt: skip
    assert main(["compare", "a", "a", "--runs-dir", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["divergence"] is None


def test_a_file_that_is_no_digest_returns_2(capsys, tmp_path):
    (tmp_path / "digest.json").write_text("{}")
    assert main(["compare", str(tmp_path), str(tmp_path)]) == 2
    assert "expected gslcosim/digest/1, was 'None'" in capsys.readouterr().err
