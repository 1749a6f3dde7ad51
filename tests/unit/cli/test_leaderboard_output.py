"""The leaderboard at the end of `bench run` is that of the report's summary."""

from gslcosim.cli.run_output import format_leaderboard

SUMMARY = """# A suite

6 flights of 2 entries, with a | in the text.

| # | Entry | Score | Success [%] | n |
|--:|---|--:|--:|--:|
| 1 | oracle | 0.85 | 100 (34 to 100) | 2 |
| 2 | dung\\_beetle | 0.55 | 50 (9 to 91) | 2 |

## Who beats whom

| not | this |
"""


def test_it_has_the_rows_of_the_summary_in_columns(tmp_path):
    (tmp_path / "summary.md").write_text(SUMMARY, encoding="utf-8")
    assert format_leaderboard(tmp_path).splitlines() == [
        "#   Entry         Score   Success [%]       n",
        "1   oracle        0.85    100 (34 to 100)   2",
        "2   dung_beetle   0.55    50 (9 to 91)      2",
    ]


def test_without_a_report_there_is_none(tmp_path):
    assert format_leaderboard(tmp_path) == ""
