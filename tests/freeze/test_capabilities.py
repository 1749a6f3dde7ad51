"""The list of capabilities has each kind of them, and what is gone, new or named is told from the rest."""

import capabilities
import pytest


@pytest.mark.slow
def test_the_list_has_commands_names_pages_keys_messages_and_entry_points():
    lines = capabilities.read_capabilities(None)
    expected = {
        "command up", "command up --seed N", "command bench sweep --vary PARAMETER=VALUES",
        # An old name, and the part of a family that needs no name.
        "command sweep --vary PARAMETER=VALUES", "command runs --where CONDITION",
        "name scenarios tiny_room", "name sensors tgs2600 bias", "name suites smoke", "page commands.md",
        "key agents[].vehicle agents[].vehicle.start_m", "message Observation tick", "contract asyncapi.yaml",
        "entry point gslcosim.sensors", "entry point gslcosim.default_services world", "script gslcosim", "extra plot",
        "python gslcosim.agent_kit Agent",
    }  # fmt: skip
    assert sorted(expected - set(lines)) == []
    assert lines == sorted(set(lines))


def test_what_is_gone_and_new_is_told_but_for_what_is_named():
    before, after = ["command a", "command b", "command c"], ["command b", "command d", "command e"]
    assert capabilities.compare(before, after, named=["- command c", "+ command e"]) == ["- command a", "+ command d"]
    assert capabilities.compare(before, before, named=[]) == []


def test_two_files_that_differ_are_a_failure(tmp_path, monkeypatch, capsys):
    for name, line in (("before", "command a"), ("after", "command b")):
        (tmp_path / name).write_text(f"{line}\n")
    monkeypatch.setattr("sys.argv", ["capabilities.py", "compare", str(tmp_path / "before"), str(tmp_path / "after")])
    assert capabilities.main() == 1
    assert capsys.readouterr().out == "- command a\n+ command b\n"
