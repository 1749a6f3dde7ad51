"""The wind of a room while a service changes how fast it blows."""

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.record import Message
from gslcosim.contract.ventilation import WindShare
from gslcosim.environment.model import WindFrames


class DrivenWind:
    """A room's frames of wind times a share, 1 until it is set.

    u(x, t) = share(t) u_frame(x, t)
    [m/s] = [1] [m/s]

    Our derivation: without viscosity the equations of motion stay the same when all velocities are multiplied by a
    share and times divided by it, so a flow at a high Reynolds number keeps its shape. The time to follow is left out.
    Arrays are read-only and valid until the share or the frame changes.
    """

    def __init__(self, wind: WindFrames) -> None:
        self._wind = wind
        self._frames = np.asarray(wind.velocity_m_s).view()
        self._frames.flags.writeable = False
        self._share = 1.0
        self._scaled: NDArray[np.float32] | None = None
        self._scaled_frame = -1

    def reset(self) -> None:
        """Blow as the room's wind does."""
        self.set_share(1.0)

    def set_share(self, share: float) -> None:
        """Blow `share` [1] times as fast from now on."""
        if share != self._share:
            self._share, self._scaled_frame = share, -1

    def take(self, message: Message | None) -> None:
        """Obey what a service says on `truth/wind`, if it says anything."""
        if isinstance(message, WindShare):
            self.set_share(message.share)

    def at(self, time_s: float) -> NDArray[np.float32]:
        """Return the wind at a time [s], (nx, ny, nz, 3), cell centres, world frame [m/s]."""
        i_frame = self._wind.frame_at(time_s)
        if self._share == 1.0:
            return self._frames[i_frame]
        scaled = self._scaled
        if scaled is None or i_frame != self._scaled_frame:
            scaled = np.asarray(self._frames[i_frame] * np.float32(self._share), np.float32)
            scaled.flags.writeable = False
            self._scaled, self._scaled_frame = scaled, i_frame
        return scaled
