"""How fast this machine has flown suites, so that plans can say how long they will take."""

import json
import math
from pathlib import Path
from typing import TypedDict

from gslcosim._kernel_cache import cache_root
from gslcosim.foreign_json import ForeignFileError, read_json

# Simulated seconds a worker flies in one by the clock, where nothing has been measured yet.
USUAL_PACE = 120.0
# What a trial costs beside flying: starting cores and agents, judging, storing [s].
OVERHEAD_S = 0.1
ROOM_S, PLUME_S = 60.0, 10.0
BYTES_PER_TRIAL = 9_000


class _Pace(TypedDict):
    sim_s_per_s: float


def pace() -> float:
    """Return how many simulated seconds a worker flies in a second here, as last measured."""
    try:
        measured = read_json(_file(), _Pace)["sim_s_per_s"]
    except ForeignFileError:
        return USUAL_PACE
    return measured if 0.0 < measured < math.inf else USUAL_PACE


def keep_pace(*, sim_s: float, busy_s: float) -> None:
    """Remember what was measured; a cache that cannot be written is no reason to fail."""
    if sim_s < 1000.0 or busy_s <= 0.0:
        return
    try:
        _file().parent.mkdir(parents=True, exist_ok=True)
        _file().write_text(json.dumps({"sim_s_per_s": sim_s / busy_s}), encoding="utf-8")
    except OSError:
        return


def _file() -> Path:
    return cache_root() / "bench_pace.json"
