"""Cases of a suite: the suite file expanded into cases and trials; pure, nothing runs here."""

from gslcosim.base.bundled import bundled_suites
from gslcosim_bench.cases.models import Case, DroppedCase, Suite, Trial
from gslcosim_bench.cases.plan import Plan, build_plan
from gslcosim_bench.cases.suite_files import LoadedSuite, load_suite

__all__ = ["Case", "DroppedCase", "LoadedSuite", "Plan", "Suite", "Trial", "build_plan", "bundled_suites", "load_suite"]
