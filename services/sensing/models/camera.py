"""Cameras of an agent: pictures with their calibration."""

import numpy as np

from gslcosim.base.errors import ModelError
from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import CameraImage, Reading
from gslcosim.scenario.models.onboard_sensors import CameraSensorSpec
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS
from gslcosim_services.sensing.models.base import SensorKind, Surroundings


class Camera:
    """Shows the last picture that was taken: `image`, no values; the cameras' own core renders it.

    State: the last picture. Draws nothing: pictures have no noise but that of their encoding.

    Held by:
        tests/unit/services/cameras/test_core.py
    """

    def __init__(self, spec: CameraSensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        del tick_s, rng
        self._spec = spec
        self._image: CameraImage | None = None

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the last picture; see `SensorModel.read`."""
        del mount_velocity_world_m_s
        self._image = sample.images.get(self._spec.name, self._image)
        if self._image is None:
            raise ModelError(f"sensing: expected a picture of {sample.body.agent}.{self._spec.name}, was none.")
        kind = CAMERAS_BY_NAME[self._spec.model]
        return Reading(sensor=self._spec.name, quantity=kind.quantity, unit=kind.unit, values=(), image=self._image)


def _kind(name: str, quantity: str, unit: str, description: str) -> SensorKind:
    return SensorKind(
        name=name,
        settings=SENSOR_BLOCKS[name],
        quantity=quantity,
        unit=unit,
        description=description,
        build=Camera,
        n_with_errors=0,
    )


CAMERA_KINDS = (
    _kind("camera", "picture", "1", "Colour camera: no values; image = PNG or JPEG with its calibration."),
    _kind("depth_camera", "depth", "mm", "Depth camera: no values; image = PNG of 16-bit depths, 0 out of range."),
)
CAMERAS_BY_NAME = {kind.name: kind for kind in CAMERA_KINDS}
