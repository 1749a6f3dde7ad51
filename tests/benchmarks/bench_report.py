"""What the report of ten thousand trials costs: processor time, beside its limit, and the size of the page."""

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "kit"))

import synthetic

from gslcosim_bench.report.writer import write_report

LIMIT_S = 30.0


def main() -> None:
    """Write one report and print what it took."""
    plan = synthetic.Plan(n_scenarios=6, n_families=3, repetitions=22, controls_frac=0.4, n_points=150)
    with tempfile.TemporaryDirectory(prefix="gslcosim-bench-report-") as scratch:
        folder = synthetic.make_results(Path(scratch) / "results", plan)
        began_s = time.process_time()
        page = write_report(folder).page
        taken_s, size_mb = time.process_time() - began_s, page.stat().st_size / 1e6
    verdict = "PASS" if taken_s <= LIMIT_S else "MISS"
    sys.stdout.write(f"report of 10,000 trials: {taken_s:.1f} s, limit {LIMIT_S:g} s  {verdict}; {size_mb:.1f} MB\n")


if __name__ == "__main__":
    main()
