"""Writer of the whole report: page, tables, leaderboard, summary and figures."""

from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import build_machine_error
from gslcosim_bench.report.analysis import analyse
from gslcosim_bench.report.page import render_page
from gslcosim_bench.report.report_data import load_report_data
from gslcosim_bench.report.tables import (
    Leaderboard,
    build_leaderboard_json,
    build_leaderboard_table,
    write_summary,
    write_tables,
)
from gslcosim_bench.store import ResultsFolder
from gslcosim_bench.verification_marks import VerificationMark

PAGE = "report.html"


@dataclass(frozen=True, kw_only=True)
class WrittenReport:
    """A report: its page, and the leaderboard of its summary as headings and rows; no rows where nothing was flown."""

    page: Path
    leaderboard: Leaderboard


def write_report(results_dir: Path, *, figures: bool = False, mark: VerificationMark | None = None) -> WrittenReport:
    """Write the report of a folder of results into it, and return where it is.

    It writes `report.html`, `tables/*.csv`, `leaderboard.json` and `summary.md`; what stood there before is replaced.

    Args:
        results_dir: Folder with `manifest.json` and `trials.parquet`; `suite.yaml`, `maps.json` and `tracks.parquet`
            add to the report where they are there.
        figures: Whether to write `figures/*.svg` and `*.pdf` too, by matplotlib.
        mark: What was found out by running a sample again; absent: what this user's state has of it.
    """
    ResultsFolder(results_dir).check_writable_entries()
    analysis = analyse(load_report_data(results_dir, mark))
    page = results_dir / PAGE
    try:
        write_tables(analysis, results_dir / "tables")
        (results_dir / "leaderboard.json").write_text(build_leaderboard_json(analysis), encoding="utf-8")
        (results_dir / "summary.md").write_text(write_summary(analysis), encoding="utf-8")
        if figures:
            # It draws with what reads recordings, which takes longer to load than most reports to make.
            from gslcosim_bench.report.figures import write_figures

            write_figures(analysis, results_dir / "figures")
        page.write_text(render_page(analysis), encoding="utf-8")
    except OSError as error:
        raise build_machine_error(error, str(results_dir), "a folder that can be written") from error
    return WrittenReport(page=page, leaderboard=build_leaderboard_table(analysis))
