"""Reference data that others have published, where a machine has it: `GSLCOSIM_REFERENCE` names its folder."""

import os
from pathlib import Path

import pytest

REFERENCE = Path(os.environ.get("GSLCOSIM_REFERENCE", Path(__file__).parents[3] / "shared" / "reference"))
GSL_BENCH = REFERENCE / "gsl-bench"
ENVIRONMENTS = GSL_BENCH / "environments"
MEASURED = REFERENCE / "measured"

needs_environments = pytest.mark.skipif(
    not ENVIRONMENTS.is_dir(), reason=f"GSLCOSIM_REFERENCE: expected environments of GSL-Bench in {ENVIRONMENTS}"
)
needs_measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason=f"GSLCOSIM_REFERENCE: expected measured data in {MEASURED}"
)
