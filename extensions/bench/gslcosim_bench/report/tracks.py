"""Tracks of the runs of a report, and their compact form for pages: a few hundred bytes a run."""

import base64
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gslcosim_bench.report.curves import rows_by_entry
from gslcosim_bench.report.plans import PlanDrawing
from gslcosim_bench.report.report_data import Floats, Ints, ReportData, read_samples

QUANTA = (0.1, 0.05)
"""Resolution of times [s] and of places [m] on pages."""

_MOST_AGENTS = 10
_TOLERANCE_M = 0.1
_MOST_TRACKS, _MOST_OF_AN_ENTRY = 900, 36


@dataclass(frozen=True, kw_only=True)
class AgentTrack:
    """Track of an agent: (m,) times that grow [s], (m, 2) places, world frame [m], and (m,) true gas at its nose [ppm].

    The gas is empty where it was not asked for.
    """

    t_s: Floats
    xy_m: Floats
    gas_ppm: Floats

    def pack(self, tolerance_m: float) -> str:
        """Return times and places as text: their steps as zigzag varints in base64.

        Args:
            tolerance_m: How far a place that is interpolated between two kept ones may be off at any time [m].
        """
        keep = _kept(self.t_s, self.xy_m, tolerance_m)
        points = np.concatenate([self.t_s[keep, None] / QUANTA[0], self.xy_m[keep] / QUANTA[1]], axis=1)
        steps = np.diff(np.round(points).astype(np.int64), axis=0, prepend=np.zeros((1, 3), dtype=np.int64))
        return base64.b64encode(bytes(_varints(steps.reshape(-1)))).decode()


@dataclass(frozen=True, kw_only=True)
class DrawnTrack:
    """The way of an agent of a run in a room, packed for the page."""

    room: int
    row: int
    packed: str


def select_tracks(material: ReportData, rooms: Sequence[PlanDrawing]) -> tuple[DrawnTrack, ...]:
    """Return some tracks of each entry in each room: as many of each as fit on a page of bounded size."""
    everything = rows_by_entry(material, np.ones(len(material.rows), dtype=bool))
    each = max(2, min(_MOST_OF_AN_ENTRY, _MOST_TRACKS // max(1, len(rooms) * len(everything))))
    wanted: dict[int, int] = {}
    for i, room in enumerate(rooms):
        for _, flown in everything:
            some = np.intersect1d(flown, room.rows)
            picked = some[np.unique(np.linspace(0, some.size - 1, min(each, some.size)).round().astype(int))]
            wanted |= dict.fromkeys(picked.tolist(), i)
    teams = read_tracks(material, wanted)
    return tuple(
        DrawnTrack(room=room, row=row, packed=track.pack(_TOLERANCE_M))
        for row, room in wanted.items()
        for track in teams.get(row, ())
    )


def read_tracks(
    material: ReportData, rows: Iterable[int] | None = None, *, with_gas: bool = False
) -> Mapping[int, Sequence[AgentTrack]]:
    """Return the tracks of the agents of each row that has some, ten of a team at most.

    Args:
        rows: Those wanted; absent: all.
        with_gas: Whether they have the gas.
    """
    names = ("t_s", "x_m", "y_m", *(["gas_ppm"] if with_gas else []))
    found: dict[int, list[AgentTrack]] = {}
    for row, team in read_samples(material, names, rows).items():
        for samples in team[:_MOST_AGENTS]:
            samples = samples[:, np.isfinite(samples[:3]).all(axis=0)]
            # Pages look up places by time.
            latest = np.maximum.accumulate(samples[0])
            samples = samples[:, np.diff(latest, prepend=-np.inf) > 0.0]
            if samples.shape[1] > 1:
                gas_ppm = np.nan_to_num(samples[3], posinf=0.0, neginf=0.0) if with_gas else samples[0, :0]
                found.setdefault(row, []).append(AgentTrack(t_s=samples[0], xy_m=samples[1:3].T, gas_ppm=gas_ppm))
    return found


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
