"""Folders of results in `gslcosim runs`."""

import json

from gslcosim.cli.main import main


def test_damaged_results_are_a_row_beside_others(capsys, tmp_path, tmp_path_factory):
    run = tmp_path / "run_0"
    (run / "logs").mkdir(parents=True)
    (run / "manifest.json").write_text('{"run_id": "run_0"}')
    results = tmp_path_factory.mktemp("results")
    (results / "manifest.json").write_text("[" * 5000)
    (results / "rows.jsonl").write_text('{"row": {"trial": "a"}, "tracks": null}\n')
    assert main(["runs", str(results), str(tmp_path), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    (broken,) = [row for row in rows if row["folder"] == str(results)]
    assert broken["state"] == "broken"
    assert "rows.jsonl:1: row: expected the key" in broken["outcome"]
    assert len(rows) == 2
    assert main(["runs", "remove", str(results), str(tmp_path), "--where", "state=broken"]) == 0
    assert f"kept       {results}" in capsys.readouterr().out
