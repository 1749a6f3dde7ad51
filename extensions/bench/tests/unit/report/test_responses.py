"""Responses to parameters on the page and in figures: the numbers of the rows, joined where that says something."""

import json
import math

import pytest
import synthetic
from page_content import data_of

from gslcosim.base.errors import UsageError
from gslcosim_bench.report.analysis import analyse
from gslcosim_bench.report.charts import build_line_charts
from gslcosim_bench.report.curves import limit_s
from gslcosim_bench.report.report_data import load_report_data
from gslcosim_bench.report.writer import write_report

CHARTS = ("success", "score", "time_s")


def varied(folder, values, units=None, defaults=None):
    """Return results whose entries are settings of one method."""
    methods = tuple(synthetic.Method(name=f"e_{i}", success=(i + 1) / (len(values) + 1)) for i in range(len(values)))
    plan = synthetic.Plan(
        methods=(*methods, synthetic.WALKER), n_scenarios=1, n_families=1, starts_m=synthetic.STARTS_M[:3],
        repetitions=3, maps=False, tracks=False,
    )  # fmt: skip
    synthetic.make_results(folder, plan)
    manifest = json.loads((folder / "manifest.json").read_text())
    named = {f"e_{i}": each for i, each in enumerate(values)}
    group = {"title": "A method", "units": units or dict.fromkeys(values[0], "1"), "values": named}
    manifest["settings"] = [group | {"defaults": defaults or {}}]
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def charts_of(folder):
    material = load_report_data(folder)
    charts = build_line_charts(analyse(material).everything, limit_s(material.rows))
    return {name: chart for name, chart in charts.items() if name.startswith("response")}, material


def test_one_parameter_is_a_line_with_the_figures_of_the_rows(tmp_path):
    folder = varied(tmp_path, [{"leg_m": 1.6}, {"leg_m": 0.4}, {"leg_m": 0.8}], {"leg_m": "m"}, {"leg_m": 0.8})
    charts, material = charts_of(folder)
    assert list(charts) == [f"response_leg_m_{name}" for name in CHARTS]
    rows = material.rows
    for chart in charts.values():
        (line,) = chart.lines
        assert (line.label, line.x.tolist(), chart.is_joined) == ("A method", [0.4, 0.8, 1.6], True)
        assert (chart.x.label, chart.x.default, chart.x.is_log) == ("leg_m [m]", 0.8, False)
    for at, entry in enumerate((1, 2, 0)):
        some = (rows.entry == entry) & ~rows.is_control
        means = rows["success"][some].mean(), rows.score[some].mean(), rows.time_s[some].mean()
        shown = [charts[f"response_leg_m_{name}"].lines[0].value[at] for name in CHARTS]
        assert shown == pytest.approx(means)
    assert charts["response_leg_m_score"].lines[0].n == 27


def test_settings_that_differ_in_one_parameter_alone_are_joined(tmp_path):
    grid = [{"leg_m": x, "wall": y} for x in (0.4, 0.8, 1.2) for y in ("bounce", "random")]
    charts, _ = charts_of(varied(tmp_path, grid))
    by_leg, by_wall = (charts[f"response_{name}_score"] for name in ("leg_m", "wall"))
    assert [(line.label, line.x.tolist()) for line in by_leg.lines] == [
        ("wall bounce", [0.4, 0.8, 1.2]), ("wall random", [0.4, 0.8, 1.2]),
    ]  # fmt: skip
    assert by_leg.is_joined
    assert [line.label for line in by_wall.lines] == ["leg_m 0.4", "leg_m 0.8", "leg_m 1.2"]
    assert not by_wall.is_joined, "between words there is nothing"
    assert by_wall.x.ticks == ((0.0, "bounce"), (1.0, "random"))


def test_settings_of_a_search_are_points(tmp_path):
    charts, _ = charts_of(varied(tmp_path, [{"x": 0.1 * i, "y": 1.0 / (i + 1)} for i in range(5)]))
    for chart in charts.values():
        (line,) = chart.lines
        assert (line.label, len(line.x), chart.is_joined) == ("A method", 5, False)


def test_values_that_span_much_are_placed_by_their_logarithms(tmp_path):
    charts, _ = charts_of(varied(tmp_path, [{"x": 0.002}, {"x": 0.02}, {"x": 0.2}]))
    axis = charts["response_x_score"].x
    assert axis.is_log
    assert axis.low < 0.002 < 0.2 < axis.high
    assert [word for _, word in axis.ticks] == ["0.002", "0.005", "0.01", "0.02", "0.05", "0.1", "0.2"]


def test_a_setting_that_has_not_flown_or_has_no_value_is_left_out(tmp_path):
    folder = varied(tmp_path, [{"x": 1.0}, {"x": 2.0}, {"x": None}])
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["settings"][0]["values"]["never"] = {"x": 3.0}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    charts, _ = charts_of(folder)
    assert charts["response_x_score"].lines[0].x.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("damage", [{"units": None}, {"values": {"e_0": {}}}, {"values": [1]}, {"defaults": 3}])
def test_damaged_settings_are_named(tmp_path, damage):
    folder = varied(tmp_path, [{"x": 1.0}, {"x": 2.0}])
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["settings"][0] |= damage
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(UsageError, match=r"manifest\.json: expected settings of entries, was a damaged file"):
        charts_of(folder)


@pytest.mark.slow
def test_page_and_figures_have_the_response(tmp_path):
    folder = varied(tmp_path, [{"x": 0.123456}, {"x": 2.0}, {"x": 8.0}])
    page = write_report(folder, figures=True).page.read_text(encoding="utf-8")
    chart = data_of(page)["views"][0]["charts"]["response_x_score"]
    assert chart["has_points"]
    assert chart["is_joined"]
    assert chart["shared_x"] == [0.123456, 2, 8]
    assert all(math.isfinite(value) for value in chart["lines"][0]["value"])
    for name in CHARTS:
        assert f'data-chart="response_x_{name}"' in page
        assert (folder / "figures" / f"response_x_{name}.svg").is_file()
