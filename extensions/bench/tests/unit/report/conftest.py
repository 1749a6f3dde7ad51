import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import synthetic

from gslcosim_bench.report.writer import write_report


@pytest.fixture(scope="session")
def usual(tmp_path_factory):
    """A folder of results of six entries with its report."""
    folder = synthetic.make_results(tmp_path_factory.mktemp("usual") / "results", synthetic.Plan())
    write_report(folder)
    return folder
