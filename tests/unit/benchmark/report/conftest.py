import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import synthetic

from gslcosim.benchmark.report.writing import write_report


@pytest.fixture(scope="session")
def usual(tmp_path_factory):
    """A folder of results of six entries with its report."""
    folder = synthetic.make_results(tmp_path_factory.mktemp("usual") / "results", synthetic.Plan())
    write_report(folder)
    return folder


@pytest.fixture
def benchmark_clock():
    """Hold what is done within to a time of the process: what else the machine does does not count."""

    @contextmanager
    def within(limit_s):
        begun_s = time.process_time()
        yield
        assert time.process_time() - begun_s < limit_s

    return within
