"""Suites that demand a sandbox for agents: told before anything is flown, and looked for in the rows."""

from collections.abc import Iterable, Mapping
from typing import Any

from gslcosim.benchmark.suite.planning import Plan
from gslcosim.errors import UsageError
from gslcosim.runtime.sandbox.choosing import is_sandboxed, strongest_sandbox, why_there_is_no


def check_sandbox(plan: Plan) -> None:
    """Refuse to fly a suite that demands a sandbox on a machine without one.

    Raises:
        UsageError: there is none here.
    """
    if plan.loaded.demands_sandbox and strongest_sandbox() == "none":
        reasons = "; ".join(why_there_is_no(kind) for kind in ("bubblewrap", "landlock"))
        raise UsageError(
            f"{plan.loaded.shown_path}: sandbox: expected a machine that has a sandbox for agents, was one without "
            f"({reasons}). Install bubblewrap, or fly the suite on another machine."
        )


def outside_a_sandbox(rows: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the rows of flights whose agents were not all in a sandbox; those without a flight have none."""
    return [row for row in rows if row["digest"] and not is_sandboxed(row["sandbox"])]
