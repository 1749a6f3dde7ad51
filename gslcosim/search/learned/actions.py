"""Actions of a policy as commands: the same in training and in a run."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from gslcosim.agent_kit import Briefing, Command, DriveSetpoint, Observation
from gslcosim.base.errors import UsageError

# How far waypoints keep from the walls of the room.
MARGIN_M = 0.5
N_HEADINGS = 8


class ActionKind(ABC):
    """Kind of actions, and how they become commands.

    `n_numbers` numbers between -1 and 1 make an action, or, where `n_choices` is not 0, one whole number below that.

    Args:
        briefing: Of the agent.
        step_m: The longest leg of waypoints [m].
        speed_m_s: The highest speed of velocities and drives [m/s].
        hold_s: How long a waypoint is held and a velocity kept before the agent is asked again [s]; absent: the
            briefing's.
    """

    n_numbers = 0
    n_choices = 0

    def __init__(self, briefing: Briefing, *, step_m: float, speed_m_s: float, hold_s: float | None) -> None:
        self.step_m, self.speed_m_s, self.hold_s = step_m, speed_m_s, hold_s
        self._low_m = np.array(briefing.bounds.min_m) + MARGIN_M
        self._high_m = np.maximum(np.array(briefing.bounds.max_m) - MARGIN_M, self._low_m)
        self._height_m = briefing.search_height_m

    @abstractmethod
    def command(self, observation: Observation, action: Any) -> Command:
        """Return the command of an action, in answer to an observation."""

    def _leg(self, observation: Observation, offset_m: np.ndarray) -> Command:
        x_m, y_m, z_m = observation.position_world_m
        from_m = np.array([x_m, y_m, self._height_m if len(offset_m) == 2 else z_m])
        from_m[: len(offset_m)] += offset_m
        end_m = np.clip(from_m, self._low_m, self._high_m)
        if len(offset_m) == 2:
            end_m[2] = self._height_m
        x_m, y_m, z_m = (float(part) for part in end_m)
        return Command(tick=observation.tick, kind="waypoint", position_world_m=(x_m, y_m, z_m), hold_s=self.hold_s)


class Waypoints(ActionKind):
    """The next waypoint, as an offset in the plane in units of `step_m`; the height is the briefing's."""

    n_numbers = 2

    def command(self, observation: Observation, action: Any) -> Command:
        """Fly there; see `ActionKind`."""
        return self._leg(observation, self.step_m * np.asarray(action, dtype=np.float64))


class SpaceWaypoints(Waypoints):
    """The next waypoint, as an offset in space in units of `step_m`."""

    n_numbers = 3


class Headings(ActionKind):
    """One of eight directions, counter-clockwise from world x, for a leg of `step_m`; the ninth choice is to hold."""

    n_choices = N_HEADINGS + 1

    def command(self, observation: Observation, action: Any) -> Command:
        """Fly a leg or hold; see `ActionKind`."""
        choice = int(action)
        if choice == N_HEADINGS:
            return Command(tick=observation.tick, kind="hold", hold_s=self.hold_s)
        heading_rad = 2 * math.pi * choice / N_HEADINGS
        return self._leg(observation, self.step_m * np.array([math.cos(heading_rad), math.sin(heading_rad)]))


class Velocities(ActionKind):
    """A velocity in the plane in units of `speed_m_s`."""

    n_numbers = 2

    def command(self, observation: Observation, action: Any) -> Command:
        """Take the velocity; see `ActionKind`."""
        velocity = self.speed_m_s * np.asarray(action, dtype=np.float64)
        x_m_s, y_m_s, z_m_s = (float(part) for part in np.resize(np.append(velocity, 0.0), 3))
        return Command(
            tick=observation.tick, kind="velocity", velocity_world_m_s=(x_m_s, y_m_s, z_m_s), hold_s=self.hold_s
        )


class SpaceVelocities(Velocities):
    """A velocity in space in units of `speed_m_s`."""

    n_numbers = 3


class Drives(ActionKind):
    """Speed along the nose in units of `speed_m_s`, and rate of turn in radians per second, for a vehicle on wheels."""

    n_numbers = 2

    def command(self, observation: Observation, action: Any) -> Command:
        """Drive; see `ActionKind`."""
        speed, yaw_rate = (float(part) for part in action)
        drive = DriveSetpoint(speed_m_s=self.speed_m_s * speed, yaw_rate_rad_s=yaw_rate)
        return Command(tick=observation.tick, kind="drive", drive=drive, hold_s=self.hold_s)


ACTIONS: dict[str, Callable[..., ActionKind]] = {
    "waypoint": Waypoints,
    "waypoint_3d": SpaceWaypoints,
    "heading": Headings,
    "velocity": Velocities,
    "velocity_3d": SpaceVelocities,
    "drive": Drives,
}


def action_kind(
    name: str, briefing: Briefing, *, step_m: float = 1.0, speed_m_s: float = 1.0, hold_s: float | None = None
) -> ActionKind:
    """Return a kind of actions by its name, for the agent of a briefing; see `ActionKind`.

    Raises:
        UsageError: there is no such kind.
    """
    if name not in ACTIONS:
        raise UsageError(f"action: expected one of {', '.join(ACTIONS)}, was {name!r}.")
    return ACTIONS[name](briefing, step_m=step_m, speed_m_s=speed_m_s, hold_s=hold_s)
