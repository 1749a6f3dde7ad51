"""Digests are equal for equal runs, and name the first place where two runs differ."""

import re

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.runtime.digest import HashChain, RunDigest
from gslcosim.runtime.replay.compare import find_first_divergence

WRITERS = {"truth/bodies": "world", "referee/score": "referee", "command/beetle": "agent_beetle"}


def run(*, n_ticks=10, final_tick=8, changed=None):
    trails = {port: HashChain() for port in WRITERS}
    for port, trail in trails.items():
        for tick in range(n_ticks):
            trail.append(tick, b"x" if changed and port in changed and tick >= changed[port] else b"message")
    return RunDigest(final_tick, dict(WRITERS), {port: trail.until(final_tick) for port, trail in trails.items()})


def test_what_was_computed_past_the_verdict_does_not_count():
    assert run(n_ticks=10).hex == run(n_ticks=60).hex
    assert run(changed={"truth/bodies": 9}).hex == run().hex


def test_any_difference_before_the_verdict_counts():
    assert run(changed={"truth/bodies": 8}).hex != run().hex
    assert run(final_tick=7).hex != run().hex


def test_the_first_divergence_is_the_earliest_and_most_upstream():
    found = find_first_divergence(run(), run(changed={"referee/score": 4, "truth/bodies": 4}))
    assert (found.tick, found.participant, found.port) == (4, "world", "truth/bodies")
    found = find_first_divergence(run(), run(changed={"referee/score": 2, "truth/bodies": 4}))
    assert (found.tick, found.participant) == (2, "referee")
    assert find_first_divergence(run(), run()) is None


def test_an_agent_is_upstream_of_the_referee_that_judges_it():
    found = find_first_divergence(run(), run(changed={"referee/score": 4, "command/beetle": 4}))
    assert (found.tick, found.participant) == (4, "agent_beetle")


def test_a_longer_run_diverges_where_the_other_ends():
    assert find_first_divergence(run(final_tick=8), run(final_tick=5)).tick == 6


def test_a_saved_digest_loads_equal(tmp_path):
    run().save(tmp_path / "digest.json")
    assert RunDigest.load(tmp_path / "digest.json") == run()


DAMAGED = {
    "": "expected JSON",
    "{}": "expected gslcosim/digest/1, was 'None'",
    '{"schema": "gslcosim/digest/9"}': "expected gslcosim/digest/1, was 'gslcosim/digest/9'",
    "[1]": "expected a block, was a list",
    '{"schema": "gslcosim/digest/1", "final_tick": 1}': "expected the key ports, was missing",
    '{"schema": "gslcosim/digest/1", "final_tick": -1, "ports": {}}': "final_tick: expected a whole number >= 0",
    '{"schema": "gslcosim/digest/1", "final_tick": 1, "ports": {"a": {"participant": "b", "ticks": [1], "links": ""}}}':
        "expected ticks with a link each, was 0 bytes of links for 1 ticks",
    '{"schema": "gslcosim/digest/1", "final_tick": 1, "ports": {"a": {"participant": "b", "ticks": [], "links": "a"}}}':
        "expected ticks with a link each",
}  # fmt: skip


@pytest.mark.parametrize(("content", "expected"), DAMAGED.items())
def test_a_file_that_is_no_digest_is_refused(tmp_path, content, expected):
    path = tmp_path / "digest.json"
    path.write_text(content)
    with pytest.raises(UsageError, match=re.escape(expected)):
        RunDigest.load(path)
    with pytest.raises(UsageError, match="found none"):
        RunDigest.load(tmp_path / "none.json")
