"""Compact tracks: what the player of a site reads, a few hundred bytes a flight."""

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gslcosim_bench.report.report_data import Floats, Ints, ReportData

QUANTUM_M, QUANTUM_S = 0.05, 0.1
"""Resolution of places and times in the player."""

GAS_COLUMNS = 40
GAS_DECADES = 3.0
"""A gas trace has a level in so many equal parts of the flight, on a logarithmic scale of so many decades."""

_LEVELS = 15
_MAX_AGENTS = 10
# What a player shows may be off by so much; the least that keeps all tracks within the budget counts.
_TOLERANCES_M = (0.1, 0.2, 0.4, 0.8)
_MAX_BYTES = 1_300_000
_MAX_SAMPLED = 200


@dataclass(frozen=True, kw_only=True)
class AgentTrack:
    """Track of an agent, (m,) each: times [s], places in the world frame (m, 2) [m], true gas at its nose [ppm]."""

    t_s: Floats
    xy_m: Floats
    gas_ppm: Floats


@dataclass(frozen=True, kw_only=True)
class TrackFormat:
    """Resolution of tracks: a place may be off by `tolerance_m`, and each `every`th repetition has a track."""

    tolerance_m: float
    every: int


def read_tracks(material: ReportData) -> Mapping[int, Sequence[AgentTrack]]:
    """Return the tracks of the agents of each row that has some, ten of a team at most."""
    if material.tracks is None:
        return {}
    index = {trial: row for row, trial in enumerate(material.rows["trial"].tolist())}
    found: dict[int, list[AgentTrack]] = {}
    names = ["t_s", "x_m", "y_m", "gas_ppm"]
    for batch in material.tracks.select(["trial", *names]).to_batches(max_chunksize=512):
        for k, trial in enumerate(batch.column(0).to_pylist()):
            team = found.setdefault(index[trial], []) if trial in index else []
            if trial not in index or len(team) >= _MAX_AGENTS:
                continue
            t, x, y, gas = (np.asarray(batch.column(i + 1)[k].values, dtype=np.float64) for i in range(len(names)))
            n = min(map(len, (t, x, y, gas)))
            series = np.stack([t[:n], x[:n], y[:n], np.nan_to_num(gas[:n], posinf=0.0, neginf=0.0)])
            series = series[:, np.isfinite(series).all(axis=0)]
            # The player looks up places by time.
            rising = np.concatenate([[True], np.diff(series[0]) > 0]) if series.shape[1] else np.zeros(0, dtype=bool)
            series = series[:, rising]
            if series.shape[1] > 1:
                team.append(AgentTrack(t_s=series[0], xy_m=series[1:3].T, gas_ppm=series[3]))
    return {row: team for row, team in found.items() if team}


def choose_format(tracks: Mapping[int, Sequence[AgentTrack]]) -> TrackFormat:
    """Return the finest format in which all tracks fit into the budget, estimated from a sample of them."""
    agents = [agent for team in tracks.values() for agent in team]
    sample = agents[:: max(1, len(agents) // _MAX_SAMPLED)]
    n_bytes = 0.0
    for tolerance_m in _TOLERANCES_M:
        n_bytes = sum(len(encode_track(agent, tolerance_m)) for agent in sample) / max(1, len(sample)) * len(agents)
        if n_bytes <= _MAX_BYTES:
            return TrackFormat(tolerance_m=tolerance_m, every=1)
    return TrackFormat(tolerance_m=_TOLERANCES_M[-1], every=-int(-n_bytes // _MAX_BYTES))


def encode_track(track: AgentTrack, tolerance_m: float) -> str:
    """Return a track as text: steps of time, x and y as zigzag varints in base64.

    Args:
        tolerance_m: How far a place that is interpolated between two kept ones may be off at any time [m].
    """
    keep = _kept(track.t_s, track.xy_m, tolerance_m)
    points = np.concatenate([track.t_s[keep, None] / QUANTUM_S, track.xy_m[keep] / QUANTUM_M], axis=1)
    steps = np.diff(np.round(points).astype(np.int64), axis=0, prepend=np.zeros((1, 3), dtype=np.int64))
    return base64.b64encode(bytes(_varints(steps.reshape(-1)))).decode()


# By halving, as Douglas and Peucker do, with the distance at the same time in place of that to the line.
def _kept(t_s: Floats, xy_m: Floats, tolerance_m: float) -> Ints:
    keep, open_parts = {0, len(t_s) - 1}, [(0, len(t_s) - 1)]
    while open_parts:
        first, last = open_parts.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        share = (t_s[inner] - t_s[first]) / (t_s[last] - t_s[first])
        off_m = np.hypot(*(xy_m[inner] - xy_m[first] - share[:, None] * (xy_m[last] - xy_m[first])).T)
        worst = int(np.argmax(off_m))
        if off_m[worst] > tolerance_m:
            middle = first + 1 + worst
            keep.add(middle)
            open_parts += [(first, middle), (middle, last)]
    return np.array(sorted(keep), dtype=np.int64)


def _varints(values: Ints) -> Iterator[int]:
    for value in values.tolist():
        rest = 2 * value if value >= 0 else -2 * value - 1
        while rest > 127:
            yield rest & 127 | 128
            rest >>= 7
        yield rest


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
