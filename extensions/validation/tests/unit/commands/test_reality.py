"""`gslcosim reality`: the table, JSON, the page, and what is told of wrong calls."""

import json

import pytest

from gslcosim.cli.main import main

LAYOUT = {
    "instrument_m": [60, 0, 1.6],
    "reflectors_m": {"reflector_1": [60, 60, 1.6], "reflector_2": [10, -50, 1.6]},
    "sources": {"source_5": {"place_m": [30, 30, 0.3], "rate_kg_s": 4e-4}},
}
COLUMNS = (
    "release,clock_time,wind_x_m_s,wind_y_m_s,wind_z_m_s,wind_x_std_m_s,wind_y_std_m_s,wind_z_std_m_s,"
    "air_temperature_k,pressure_pa,tan_gamma_horizontal,tan_gamma_vertical,ch4_beam_1_ppm,ch4_beam_2_ppm"
)


@pytest.fixture
def field(tmp_path):
    """Return a folder of one small set of lasers: gas in the first half hour, none in the second."""
    folder = tmp_path / "our_field"
    folder.mkdir()
    (folder / "layout.json").write_text(json.dumps(LAYOUT))
    rows = [
        f"r1,2030-01-01T10:{minute:02d}:00,{2 if minute < 30 else -2},0,0,.5,.5,.3,290,101325,.2,.1,"
        f"{3.5 if minute < 30 else 2.0},2.0"
        for minute in range(60)
    ]
    (folder / "minutes_source_5.csv").write_text("\n".join([COLUMNS, *rows]) + "\n")
    return folder


def test_a_table_of_goals_for_data_of_any_name(field, capsys):
    assert main(["reality", "--data", str(field), "--only", "laser-forward"]) == 0
    out = capsys.readouterr().out
    assert "our_field   source_5: FAC2 of 30 beam minutes" in out
    assert "goals are met." in out


def test_results_as_json_and_as_a_page(field, tmp_path, capsys):
    folder = tmp_path / "page"
    words = ["reality", "--data", str(field), "--only", "laser-forward", "--quick", "--out", str(folder), "--json"]
    assert main(words) == 0
    stored = json.loads(capsys.readouterr().out)
    assert [result["case"] for result in stored] == ["laser-forward"]
    assert stored[0]["rows"][0]["goal"] == "≥ 0.5"
    assert "our_field" in (folder / "reality.md").read_text(encoding="utf-8")


def test_data_that_no_chosen_case_can_use_is_told(tmp_path, capsys):
    (tmp_path / "published.json").write_text('{"entries": []}')
    assert main(["reality", "--data", str(tmp_path), "--only", "laser-forward"]) == 2
    said = capsys.readouterr().err
    assert "--data: expected what a case needs (laser-forward: laser_paths), found no set." in said


def test_a_bad_file_is_told_before_any_case_runs(field, capsys):
    path = field / "minutes_source_5.csv"
    path.write_text(path.read_text().replace("pressure_pa", "pressure_hpa"))
    assert main(["reality", "--data", str(field)]) == 2
    said = capsys.readouterr().err
    assert "expected a column pressure_pa, was pressure_hpa. Convert column pressure_hpa and rename it." in said
    assert "running" not in said


def test_an_unknown_case_is_a_wrong_call(field, capsys):
    assert main(["reality", "--data", str(field), "--only", "windmill"]) == 2
    assert ", was windmill" in capsys.readouterr().err
