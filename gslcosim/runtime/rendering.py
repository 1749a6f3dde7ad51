"""Rendering on this machine: whether pictures of a scenario's cameras can be drawn here."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

from gslcosim.base.problems import Problem
from gslcosim.base.processes import build_python_command
from gslcosim.scenario import Scenario

PROBE_LIMIT_S = 60.0


def find_rendering_problems(scenario: Scenario, directory: Path) -> Iterator[Problem]:
    """Yield a problem for each camera where nothing can be drawn."""
    del directory
    reason = rendering_unavailable_reason() if scenario.cameras else ""
    if not reason:
        return
    cameras = {(agent.name, sensor.name) for agent, sensor in scenario.cameras}
    for i, agent in enumerate(scenario.agents):
        for j, sensor in enumerate(agent.sensors):
            if (agent.name, sensor.name) in cameras:
                yield Problem(
                    where=f"agents[{i}].sensors[{j}].model",
                    expected=f"no {sensor.model} on a machine without EGL and OSMesa, which draw its pictures",
                    found=f"'{sensor.model}'",
                    remedy=reason,
                )


def rendering_unavailable_reason() -> str:
    """Return why no pictures can be drawn here and what helps; empty where they can. Takes half a second."""
    call = build_python_command("-m", "gslcosim_services.cameras.offscreen_renderer")
    try:
        done = subprocess.run(call, capture_output=True, text=True, timeout=PROBE_LIMIT_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"The driver did not answer: {error}. `gslcosim doctor` tells more."
    if not done.returncode:
        return ""
    said = [line for line in done.stderr.splitlines() if line.strip()]
    return said[-1] if done.returncode > 0 and said else "The driver crashed; `gslcosim doctor` tells more."
