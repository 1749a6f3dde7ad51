from pathlib import Path

import gsl_bench_writers as gsl_bench
import pytest


@pytest.fixture
def gsl_bench_folder(tmp_path) -> Path:
    """Return a folder with one frame in GSL-Bench's layout."""
    gsl_bench.write_frame(tmp_path)
    return tmp_path
