"""The report of a folder of results: a page, tables, a leaderboard for machines, a summary, and pictures for papers."""

from pathlib import Path

from gslcosim.benchmark.report.analysis import analyse
from gslcosim.benchmark.report.figures import write_figures
from gslcosim.benchmark.report.page import page_of
from gslcosim.benchmark.report.reading import read_material
from gslcosim.benchmark.report.tables import leaderboard_json, summary_of, write_tables
from gslcosim.benchmark.store.verification_marks import VerificationMark
from gslcosim.machine import machine_error

PAGE = "report.html"


def write_report(results_dir: Path, *, figures: bool = False, mark: VerificationMark | None = None) -> Path:
    """Write the report of a folder of results into it, and return the page.

    It writes `report.html`, `tables/*.csv`, `leaderboard.json` and `summary.md`; what stood there before is replaced.

    Args:
        results_dir: Folder with `manifest.json` and `trials.parquet`; `suite.yaml`, `maps.json` and `tracks.parquet`
            add to the report where they are there.
        figures: Whether to write `figures/*.svg` and `*.pdf` too, by matplotlib.
        mark: What was found out by running a sample again; absent: what this user's state has of it.

    Raises:
        UsageError: the folder holds no results, a file is damaged, or matplotlib is missing.
        MachineError: a file cannot be written.
    """
    analysis = analyse(read_material(results_dir, mark))
    page = results_dir / PAGE
    try:
        write_tables(analysis, results_dir / "tables")
        (results_dir / "leaderboard.json").write_text(leaderboard_json(analysis), encoding="utf-8")
        (results_dir / "summary.md").write_text(summary_of(analysis), encoding="utf-8")
        if figures:
            write_figures(analysis, results_dir / "figures")
        page.write_text(page_of(analysis), encoding="utf-8")
    except OSError as error:
        raise machine_error(error, str(results_dir), "a folder that can be written") from error
    return page
