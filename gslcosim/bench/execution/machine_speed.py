"""Speed of this machine: the measured pace of suites, and a reference loop that makes machines comparable."""

import json
import math
import time
from pathlib import Path
from typing import TypedDict

from gslcosim.base.kernel_cache import get_cache_root
from gslcosim.base.untrusted_json import MalformedFileError, read_json

# Simulated seconds a worker flies in one by the clock, where nothing has been measured yet.
DEFAULT_PACE = 120.0
# What a trial costs beside flying: starting cores and agents, judging, storing [s].
OVERHEAD_S = 0.1
ROOM_S, PLUME_S = 60.0, 10.0
BYTES_PER_TRIAL = 9_000


class _Pace(TypedDict):
    sim_s_per_s: float


def measured_pace() -> float:
    """Return how many simulated seconds a worker flies in a second here, as last measured."""
    try:
        measured = read_json(_file(), _Pace)["sim_s_per_s"]
    except MalformedFileError:
        return DEFAULT_PACE
    return measured if 0.0 < measured < math.inf else DEFAULT_PACE


def save_pace(*, sim_s: float, busy_s: float) -> None:
    """Remember what was measured; a cache that cannot be written is no reason to fail."""
    if sim_s < 1000.0 or busy_s <= 0.0:
        return
    try:
        _file().parent.mkdir(parents=True, exist_ok=True)
        _file().write_text(json.dumps({"sim_s_per_s": sim_s / busy_s}), encoding="utf-8")
    except OSError:
        return


def _file() -> Path:
    return get_cache_root() / "bench_pace.json"


_N = 200_000


def reference_loop_s() -> float:
    """Return how long the loop takes now, by the clock [s]: about 0.02 s on a machine of 2023."""
    began = time.perf_counter()
    total = 0
    for i in range(_N):
        total += i * i & 0xFF
    assert total > 0, "the loop is not optimised away"
    return time.perf_counter() - began
