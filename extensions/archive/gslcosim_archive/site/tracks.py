"""Tracks and gas of a site's player, as fine as fits into it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gslcosim_bench.report.tracks import AgentTrack

GAS_COLUMNS = 40
GAS_DECADES = 3.0
"""A gas trace has a level in so many equal parts of the flight, on a logarithmic scale of so many decades."""

_LEVELS = 15
# What a player shows may be off by so much; the least that keeps all tracks within the budget counts.
_TOLERANCES_M = (0.1, 0.2, 0.4, 0.8)
_MAX_BYTES = 1_300_000
_MAX_SAMPLED = 200


@dataclass(frozen=True, kw_only=True)
class TrackFormat:
    """Resolution of tracks: a place may be off by `tolerance_m`, and each `every`th repetition has a track."""

    tolerance_m: float
    every: int


def choose_format(tracks: Mapping[int, Sequence[AgentTrack]]) -> TrackFormat:
    """Return the finest format in which all tracks fit into the budget, estimated from a sample of them."""
    agents = [agent for team in tracks.values() for agent in team]
    sample = agents[:: max(1, len(agents) // _MAX_SAMPLED)]
    n_bytes = 0.0
    for tolerance_m in _TOLERANCES_M:
        n_bytes = sum(len(agent.pack(tolerance_m)) for agent in sample) / max(1, len(sample)) * len(agents)
        if n_bytes <= _MAX_BYTES:
            return TrackFormat(tolerance_m=tolerance_m, every=1)
    return TrackFormat(tolerance_m=_TOLERANCES_M[-1], every=-int(-n_bytes // _MAX_BYTES))


def encode_gas(team: Sequence[AgentTrack], end_s: float, full_ppm: float) -> str:
    """Return the gas at the noses of a team over time as hexadecimal digits, 0 none to f full; empty without any.

    Args:
        end_s: End of the flight [s].
        full_ppm: What the highest level stands for [ppm].
    """
    most_ppm = np.zeros(GAS_COLUMNS)
    for agent in team:
        column = np.clip((agent.t_s / max(end_s, 1e-9) * GAS_COLUMNS).astype(np.int64), 0, GAS_COLUMNS - 1)
        np.maximum.at(most_ppm, column, agent.gas_ppm)
    if full_ppm <= 0.0 or not most_ppm.any():
        return ""
    share = 1.0 + np.log10(np.maximum(most_ppm / full_ppm, 1e-12)) / GAS_DECADES
    levels = np.round(_LEVELS * np.clip(share, 0.0, 1.0)).astype(np.int64)
    return "".join(f"{level:x}" for level in levels.tolist())
