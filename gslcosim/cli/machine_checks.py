"""What a scenario asks of this machine, checked before anything starts."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.scenario.problems import Problem

if TYPE_CHECKING:
    from gslcosim.scenario import Scenario

PROBE_LIMIT_S = 60.0


def problems_of_drawing(scenario: "Scenario", directory: Path) -> Iterator[Problem]:
    """Yield a problem for each camera where nothing can be drawn.

    Args:
        scenario: Its agents' sensors.
        directory: Not needed.
    """
    del directory
    reason = why_nothing_can_be_drawn() if scenario.cameras else ""
    if not reason:
        return
    cameras = {(agent.name, sensor.name) for agent, sensor in scenario.cameras}
    for i, agent in enumerate(scenario.agents):
        for j, sensor in enumerate(agent.sensors):
            if (agent.name, sensor.name) in cameras:
                yield Problem(
                    path=f"agents[{i}].sensors[{j}].model",
                    expected=f"no {sensor.model} on a machine without EGL and OSMesa, which draw its pictures",
                    found=f"'{sensor.model}'",
                    remedy=reason,
                )


def why_nothing_can_be_drawn() -> str:
    """Return why no pictures can be drawn here and what helps; empty where they can. Takes half a second."""
    call = [sys.executable, "-P", "-m", "gslcosim.cameras.offscreen"]
    try:
        done = subprocess.run(call, capture_output=True, text=True, timeout=PROBE_LIMIT_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"The driver did not answer: {error}. `gslcosim doctor` tells more."
    if not done.returncode:
        return ""
    said = [line for line in done.stderr.splitlines() if line.strip()]
    return said[-1] if done.returncode > 0 and said else "The driver crashed; `gslcosim doctor` tells more."
