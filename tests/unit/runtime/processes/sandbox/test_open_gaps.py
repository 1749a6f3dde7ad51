"""Where a kernel lacks something, the result and `gslcosim doctor` say what is open."""

import pytest

from gslcosim.cli.doctor_checks import check_sandbox
from gslcosim.runtime.processes.sandbox import confinement, selection
from gslcosim.runtime.processes.sandbox.bubblewrap import find_bubblewrap_failure
from gslcosim.runtime.processes.sandbox.selection import describe_sandboxes, is_sandboxed, list_open_gaps
from gslcosim.scenario import load_scenario


@pytest.mark.parametrize(("version", "n_open"), [(1, 3), (2, 3), (3, 2), (4, 1), (5, 1), (6, 0), (7, 0)])
def test_each_version_of_landlock_closes_more(version, n_open):
    assert len(confinement.list_missing_protections(version)) == n_open


def test_the_result_says_what_an_older_kernel_leaves_open(monkeypatch):
    """In words that still say that there was a sandbox."""
    scenario = load_scenario("tiny_room", overrides=["agents[0].sandbox=landlock"]).scenario
    monkeypatch.setattr(confinement, "can_filter", lambda: True)
    monkeypatch.setattr(confinement, "read_landlock_version", lambda: 5)
    described = describe_sandboxes(scenario, is_one_process=False)["beetle"]
    assert described.startswith("landlock 5 (open: other processes of the user can be signalled")
    assert is_sandboxed(described)
    monkeypatch.setattr(confinement, "read_landlock_version", lambda: 6)
    assert describe_sandboxes(scenario, is_one_process=False)["beetle"] == "landlock 6"


def test_bubblewrap_has_no_filter_on_rare_processors(monkeypatch):
    assert list_open_gaps("bubblewrap") == []
    monkeypatch.setattr(confinement, "can_filter", lambda: False)
    assert "io_uring" in list_open_gaps("bubblewrap")[0]


def test_doctor_says_what_is_open(monkeypatch):
    find_bubblewrap_failure.cache_clear()
    monkeypatch.setattr(selection, "find_bubblewrap_failure", lambda: "bubblewrap is not installed")
    monkeypatch.setattr(confinement, "can_filter", lambda: True)
    monkeypatch.setattr(confinement, "read_landlock_version", lambda: 3)
    (found,) = check_sandbox()
    assert "landlock, as bubblewrap is not installed; open: with door: tcp any port can be reached" in found.text
    assert "sockets of other programs that have a path" in found.text
