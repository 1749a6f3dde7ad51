"""The wind of a room while a service changes how fast it blows, and events change which wind it is."""

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.participant import Inbox
from gslcosim.contract.record import Message
from gslcosim.contract.ventilation import WIND, WindShare
from gslcosim.environment.model import Environment
from gslcosim.errors import ModelError
from gslcosim.scenario.due_events import due_events
from gslcosim.scenario.models.event_kinds import WindChangesSpec
from gslcosim.scenario.models.scenario import Scenario

_OWN = -1


class DrivenWind:
    """A room's frames of wind times a share, 1 until it is set.

    u(x, t) = share(t) u_frame(x, t)
    [m/s] = [1] [m/s]

    Our derivation: without viscosity the equations of motion stay the same when all velocities are multiplied by a
    share and times divided by it, so a flow at a high Reynolds number keeps its shape. The time to follow is left out.
    The share is that of a service times that of the last event about the wind, which also says whose frames they are:
    the room's own, or those that were made for the event.
    Arrays are read-only and valid until share, frames or frame change.
    """

    def __init__(self, environment: Environment, scenario: Scenario | None = None) -> None:
        """Blow as the room's wind does.

        Raises:
            ModelError: an event brings a wind that is not there.
        """
        self._events = scenario
        self._winds = {_OWN: environment.wind, **environment.later_winds}
        lacking = [
            i
            for i, event in enumerate(scenario.events if scenario else ())
            if isinstance(event, WindChangesSpec) and event.inlet_velocity_m_s is not None and i not in self._winds
        ]
        if lacking:
            raise ModelError(f"wind: expected the wind that events[{lacking[0]}] brings, found none.")
        self._frames = {i: _read_only(wind.velocity_m_s) for i, wind in self._winds.items()}
        self._i_wind = _OWN
        self._share = self._event_share = 1.0
        self._scaled: NDArray[np.float32] | None = None
        self._scaled_frame = -1

    def reset(self) -> None:
        """Blow as the room's wind does."""
        self._i_wind, self._event_share, self._scaled_frame = _OWN, 1.0, -1
        self.set_share(1.0)

    def set_share(self, share: float) -> None:
        """Blow `share` [1] times as fast from now on."""
        if share != self._share:
            self._share, self._scaled_frame = share, -1

    def take(self, message: Message | None) -> None:
        """Obey what a service says on `truth/wind`, if it says anything."""
        if isinstance(message, WindShare):
            self.set_share(message.share)

    def obey(self, inbox: Inbox) -> None:
        """Take what a service and events say of this tick."""
        self.take(inbox.get(WIND))
        for i, event in due_events(self._events, inbox) if self._events is not None else ():
            if isinstance(event, WindChangesSpec):
                self._i_wind = _OWN if event.inlet_velocity_m_s is None else i
                self._event_share, self._scaled_frame = event.share, -1

    def at(self, time_s: float) -> NDArray[np.float32]:
        """Return the wind at a time [s], (nx, ny, nz, 3), cell centres, world frame [m/s]."""
        i_frame = self._winds[self._i_wind].frame_at(time_s)
        frames, share = self._frames[self._i_wind], self._share * self._event_share
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
