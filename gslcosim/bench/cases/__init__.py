"""Cases of a suite: the suite file expanded into cases and trials; pure, nothing runs here."""

from gslcosim.bench.cases.models import Suite
from gslcosim.bench.cases.plan import Plan, build_plan
from gslcosim.bench.cases.suite_files import LoadedSuite, bundled_suites, load_suite
from gslcosim.bench.cases.trials import Case, DroppedCase, Trial

__all__ = ["Case", "DroppedCase", "LoadedSuite", "Plan", "Suite", "Trial", "build_plan", "bundled_suites", "load_suite"]
