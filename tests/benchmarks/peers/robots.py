"""What the contestants with robots have in common; needs nothing but Python, so it runs beside any package.

A contestant builds its robots, steps them once, says what it is, and then steps them for as many seconds of processor
time as each line of its standard input asks for. Building and compiling are thus left out.
"""

import json
import sys
import time
from collections.abc import Callable


def answer(step: Callable[[], float], version: str) -> None:
    """Say that all is ready, and answer each line of standard input with robot-seconds and seconds of processor time.

    Args:
        step: Steps all robots, and returns the simulated time of all together [s].
        version: Name and version of what is measured.
    """
    step()
    _say({"version": version})
    for line in sys.stdin:
        enough_s, robot_s = float(line), 0.0
        started = time.process_time()
        while (cpu_s := time.process_time() - started) < enough_s:
            robot_s += step()
        _say({"robot_s": robot_s, "cpu_s": cpu_s})


def _say(figures: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(figures) + "\n")
    sys.stdout.flush()
