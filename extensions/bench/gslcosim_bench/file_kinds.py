"""Kind of file that this package registers: suites, with their checks."""

import json

from gslcosim.base.bundled import SUITE_FILE, bundled_suites
from gslcosim.scenario.checks.registry import Check, FileKind, ValidFile

SUITE = FileKind(
    name="suite",
    words="suite",
    ending=SUITE_FILE,
    list_bundled=bundled_suites,
    validator="gslcosim_bench.file_kinds:validate_suite",
    has_seed=True,
    checks=(
        Check(name="scenarios", of="suite", finder="gslcosim_bench.cases.suite_checks:find_scenario_problems"),
        Check(name="entries", of="suite", finder="gslcosim_bench.cases.suite_checks:find_entry_problems"),
    ),
)


def validate_suite(path: str, seed: int | None) -> ValidFile:
    """Return the outcome of the check of a suite for `gslcosim validate`."""
    from gslcosim_bench.cases import build_plan, load_suite
    from gslcosim_bench.execution.verification import check_machine

    loaded = load_suite(path, seed=seed, is_flown=True)
    plan = build_plan(loaded)
    check_machine(plan)
    names = ", ".join(entry.spec.name for entry in plan.entries)
    return ValidFile(
        sentence=f"Suite {loaded.suite.name}: {len(plan.cases)} cases, {len(plan.trials)} trials, entries: {names}.",
        content={"suite": json.loads(loaded.suite.model_dump_json(by_alias=True, exclude_none=True))},
    )
