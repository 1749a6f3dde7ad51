"""Manifest of a results folder: how its results were made."""

import json
import os
import platform
import statistics
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gslcosim
from gslcosim.base.code_identity import COMPUTING_PACKAGES
from gslcosim.bench.cases.models import LOWER_ANCHOR, UPPER_ANCHOR
from gslcosim.bench.cases.plan import Plan
from gslcosim.bench.store.folder import RESULTS_SCHEMA


def build_manifest(plan: Plan, sessions: list[dict[str, Any]], *, recorded: Sequence[str]) -> dict[str, Any]:
    """Return the content of `manifest.json`.

    Args:
        plan: What was to be run.
        sessions: The wall times of each call that flew some of it.
        recorded: The trials that have a recording.
    """
    suite = plan.loaded.suite
    names = {entry.spec.name for entry in plan.entries}
    anchors = {"lower": LOWER_ANCHOR, "upper": UPPER_ANCHOR}
    titles = {trial.scenario: trial.family for trial in plan.trials}
    return {
        "schema": RESULTS_SCHEMA,
        "suite": suite.name,
        "title": suite.title,
        "question": suite.question,
        "seed": suite.seed,
        "suite_hash": plan.suite_hash,
        "software_hash": plan.software_hash,
        "sandbox": "required" if plan.loaded.demands_sandbox else "optional",
        "versions": {
            "gslcosim": gslcosim.__version__,
            "python": sys.version.split()[0],
            **{name: version(name) for name in COMPUTING_PACKAGES},
        },
        "machine": _machine(sessions),
        "entries": [
            {
                "name": entry.spec.name,
                "title": entry.card.title if entry.card else entry.spec.name,
                "family": entry.card.family if entry.card else "",
                "agent_hash": entry.agent_hash,
                "language": "python" if entry.spec.start.python else "command",
                "parameters": json.loads(entry.spec.model_dump_json())["parameters"],
                "robots": entry.spec.robots,
            }
            for entry in plan.entries
        ],
        "scenarios": [{"name": name, "family": family, "title": name} for name, family in titles.items()],
        "n_planned": len(plan.trials),
        "n_dropped": len(plan.dropped),
        "dropped": [{"case": each.case, "reason": each.reason} for each in plan.dropped],
        "moved": [{"case": m.case, "agent": m.agent, "from_m": m.from_m, "to_m": m.to_m} for m in plan.moved],
        "anchors": {side: name for side, name in anchors.items() if name in names},
        "wall": _totals(sessions),
        "sessions": sessions,
        "recordings": {trial: f"recordings/{trial}" for trial in recorded},
    }


def _machine(sessions: list[dict[str, Any]]) -> dict[str, Any]:
    loops_s = [each["reference_loop_s"] for each in sessions if each.get("reference_loop_s")]
    return {
        "cpu": _cpu_name(),
        "cores": os.cpu_count(),
        "platform": platform.platform(),
        "reference_loop_s": statistics.median(loops_s) if loops_s else None,
    }


def _totals(sessions: list[dict[str, Any]]) -> dict[str, Any]:
    if not sessions:
        return {}
    totals: dict[str, Any] = {
        key: sum(each.get(key) or 0.0 for each in sessions)
        for key in ("total_s", "preparing_s", "flying_s", "n_trials")
    }
    for key in ("busy_share", "flying_share"):
        weighted = sum((each.get(key) or 0.0) * (each.get("flying_s") or 0.0) for each in sessions)
        totals[key] = weighted / totals["flying_s"] if totals["flying_s"] else None
    return {
        "started_at": sessions[0]["started_at"],
        **totals,
        "jobs": sessions[-1]["jobs"],
        "peak_worker_mb": max(each.get("peak_worker_mb") or 0.0 for each in sessions),
    }


def _cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown")
