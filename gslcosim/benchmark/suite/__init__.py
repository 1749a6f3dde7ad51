"""A suite: the file that says what is flown, turned into cases and trials; pure, nothing is flown here."""

from gslcosim.benchmark.suite.loading import LoadedSuite, bundled_suites, load_suite
from gslcosim.benchmark.suite.models import Suite
from gslcosim.benchmark.suite.planning import Plan, plan_of
from gslcosim.benchmark.suite.trials import Case, Dropped, Trial

__all__ = ["Case", "Dropped", "LoadedSuite", "Plan", "Suite", "Trial", "bundled_suites", "load_suite", "plan_of"]
