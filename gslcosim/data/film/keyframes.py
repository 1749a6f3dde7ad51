"""Keyframes of a film: the part of a run it shows, and poses between two ticks."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Quaternion
from gslcosim.data.run import RunData
from gslcosim.data.streams import RecordedTrack

FRAMES_PER_S = 25


@dataclass(frozen=True, kw_only=True)
class FilmSegment:
    """A part of a run [s of simulated time], shown `speed` times as fast as it was."""

    from_s: float
    to_s: float
    speed: float

    @classmethod
    def of(cls, run: RunData, *, from_s: float | None, to_s: float | None, speed: float) -> "FilmSegment":
        """Return the cut of a run; what is absent is its beginning or its end.

        Raises:
            UsageError: the part is empty, or after the end of the run.
        """
        end_s = max((float(track.time_s[-1]) for track in run.tracks.values() if len(track.time_s)), default=0.0)
        begin_s, stop_s = from_s or 0.0, end_s if to_s is None else min(to_s, end_s)
        if begin_s >= stop_s:
            raise UsageError(
                f"--from, --to: expected a part of the run, which ends at {end_s:g} s, was {begin_s:g} to "
                f"{stop_s if to_s is None else to_s:g} s."
            )
        return cls(from_s=begin_s, to_s=stop_s, speed=speed)

    @property
    def times_s(self) -> NDArray[np.float64]:
        """The simulated times of the frames [s]."""
        n_frames = max(1, math.floor((self.to_s - self.from_s) / self.speed * FRAMES_PER_S) + 1)
        return np.minimum(self.from_s + np.arange(n_frames) * self.speed / FRAMES_PER_S, self.to_s)


def interpolate_pose(track: RecordedTrack, time_s: float) -> tuple[Vec3, Quaternion]:
    """Return where a vehicle was at a time between ticks: on the straight line, and on the shortest turn."""
    i = int(np.clip(np.searchsorted(track.time_s, time_s, side="right") - 1, 0, len(track.time_s) - 1))
    k = min(i + 1, len(track.time_s) - 1)
    span_s = float(track.time_s[k] - track.time_s[i])
    share = min(max((time_s - float(track.time_s[i])) / span_s, 0.0), 1.0) if span_s > 0 else 0.0
    place_m = (1 - share) * track.position_world_m[i] + share * track.position_world_m[k]
    before, after = track.quaternion_wxyz[i], track.quaternion_wxyz[k]
    turn = (1 - share) * before + share * (after if before @ after >= 0 else -after)
    turn = turn / np.linalg.norm(turn)
    x_m, y_m, z_m = place_m.tolist()
    w, x, y, z = turn.tolist()
    return (x_m, y_m, z_m), (w, x, y, z)
