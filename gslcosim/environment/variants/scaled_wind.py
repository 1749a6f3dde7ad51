"""Scaled wind: frames of wind times a share that a service sets, in the variant that events have brought."""

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.environment_messages import WIND, WindShare
from gslcosim.contract.participant import Inbox
from gslcosim.contract.record import Message
from gslcosim.environment.model import Environment
from gslcosim.environment.variants.dynamic_environment import DynamicEnvironment
from gslcosim.scenario.due_events import find_due_events
from gslcosim.scenario.models.events import WindChangesSpec
from gslcosim.scenario.models.scenario import Scenario


class ScaledWind:
    """A room's frames of wind times a share, 1 until it is set.

    u(x, t) = share(t) u_frame(x, t)
    [m/s] = [1] [m/s]

    Our derivation: without viscosity the equations of motion stay the same when all velocities are multiplied by a
    share and times divided by it, so a flow at a high Reynolds number keeps its shape. The time to follow is left out.
    The share is that of a service times that of the last event about the wind, which also says whose frames they are:
    the room's own, or those that were made for the event. Where a door has moved they are those of the room since.
    Arrays are read-only and valid until share, frames or frame change.
    """

    def __init__(self, environment: Environment, scenario: Scenario) -> None:
        """Blow as the room's wind does.

        Raises:
            ModelError: the environment lacks a room that an event brings.
        """
        self._scenario = scenario
        self.room = DynamicEnvironment(environment, scenario)
        self._frames = {key: _read_only(room.wind.velocity_m_s) for key, room in self.room.rooms.items()}
        self._share = self._event_share = 1.0
        self._scaled: NDArray[np.float32] | None = None
        self._scaled_frame = -1

    def reset(self) -> None:
        """Blow as the room's wind does."""
        self.room.reset()
        self._event_share, self._scaled_frame = 1.0, -1
        self.set_share(1.0)

    def set_share(self, share: float) -> None:
        """Blow `share` [1] times as fast from now on."""
        if share != self._share:
            self._share, self._scaled_frame = share, -1

    def take(self, message: Message | None) -> None:
        """Obey what a service says on `truth/wind`, if it says anything."""
        if isinstance(message, WindShare):
            self.set_share(message.share)

    def obey(self, inbox: Inbox) -> bool:
        """Take what a service and events say of this tick, and return whether a door has moved."""
        self.take(inbox.get(WIND))
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, WindChangesSpec):
                self._event_share, self._scaled_frame = event.share, -1
        before = self.room.variant
        has_moved = self.room.obey(inbox)
        if self.room.variant != before:
            self._scaled_frame = -1
        return has_moved

    def at(self, time_s: float) -> NDArray[np.float32]:
        """Return the wind at a time [s], (nx, ny, nz, 3), cell centres, world frame [m/s]."""
        i_frame = self.room.now.wind.frame_at(time_s)
        frames, share = self._frames[self.room.variant], self._share * self._event_share
        if share == 1.0:
            return frames[i_frame]
        scaled = self._scaled
        if scaled is None or i_frame != self._scaled_frame:
            scaled = np.asarray(frames[i_frame] * np.float32(share), np.float32)
            scaled.flags.writeable = False
            self._scaled, self._scaled_frame = scaled, i_frame
        return scaled


def _read_only(velocity_m_s: NDArray[np.float32]) -> NDArray[np.float32]:
    frames = np.asarray(velocity_m_s).view()
    frames.flags.writeable = False
    return frames
