"""`gslcosim bench run measured`: table, JSON, and one sentence for each wrong call."""

import json

import pytest

from gslcosim.cli.main import main


def test_entries_are_listed_with_what_they_found(yard, tmp_path, capsys):
    call = ["bench", "run", "measured", "--data", str(yard), "--results", str(tmp_path / "out"), "--no-report"]
    assert main([*call, "--only", "entry=leak_*"]) == 0
    out = capsys.readouterr().out
    assert "our_yard   leak_network   1 of 1" in out
    assert "measured.md" in out
    assert main([*call, "--only", "entry=leak_*", "--json"]) == 0
    (found, oracle) = json.loads(capsys.readouterr().out)["figures"]
    assert (found["entry"], found["exact"]["value"], found["n_false_events"]) == ("leak_network", 1.0, 0)
    assert oracle["entry"] == "oracle"


def said(arguments, capsys):
    assert main(["bench", *arguments]) == 2
    return capsys.readouterr().err


def test_data_is_asked_for_by_the_name_of_its_option(capsys, monkeypatch):
    monkeypatch.delenv("GSLCOSIM_REFERENCE", raising=False)
    assert "--data: expected a folder of measured data" in said(["run", "measured"], capsys)


def test_the_reference_folder_is_the_default(yard, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("GSLCOSIM_REFERENCE", str(tmp_path / "nowhere"))
    assert "nowhere" in said(["run", "measured"], capsys)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--shard", "1/2"], "--shard: expected a suite that is flown, was measured"),
        (["--only", "case=x"], "--only case: expected entry=NAME with the suite measured"),
        (["--only", "entry=nobody"], "--only entry=nobody: expected one of leak_network"),
    ],
)
def test_options_of_flown_suites_are_refused(yard, capsys, options, sentence):
    assert sentence in said(["run", "measured", "--data", str(yard), *options], capsys)


def test_data_belongs_to_this_suite_alone(yard, capsys):
    assert "--data: expected the suite measured, was smoke" in said(["run", "smoke", "--data", str(yard)], capsys)


def test_agents_belong_to_this_suite_alone(yard, capsys):
    assert "--agents: expected the suite measured, was smoke" in said(["run", "smoke", "--agents", "pmfs"], capsys)
    wrong = ["run", "measured", "--data", str(yard), "--agents", "pmsf"]
    assert "--agents pmsf: expected a bundled agent" in said(wrong, capsys)


def test_data_of_formats_without_logs_is_refused(tmp_path, capsys):
    (tmp_path / "published.json").write_text('{"entries": []}')
    text = said(["run", "measured", "--data", str(tmp_path)], capsys)
    formats = "mast_network, laser_paths, room_sensors"
    assert f"--data: expected a log of a format that makes trials ({formats}), found no set" in text
