import pytest
from pydantic import ValidationError

from gslcosim.scenario.models.sensors import SensorSpec


@pytest.mark.parametrize(
    ("model", "settings", "key"),
    [
        ("gps", {"imu": {"rate_hz": 100}}, "imu"),
        ("imu", {"noise_std": 0.1}, "noise_std"),
        ("lidar_2d", {"bias": 0.1}, "bias"),
        ("barometer", {"mount_rpy_rad": (0, 0.1, 0)}, "mount_rpy_rad"),
        ("tgs2600", {"lidar": {"n_azimuths": 4}}, "lidar"),
    ],
)
def test_settings_that_a_model_does_not_have_are_refused(model, settings, key):
    with pytest.raises(ValidationError, match=f"settings that a sensor of model {model} has, was {key}"):
        SensorSpec.model_validate({"model": model, "name": "s", **settings})


def test_usual_errors_are_left_to_scalars():
    assert SensorSpec(model="lidar_3d", name="s", noise_std=0.02).noise_std == 0.02
    assert SensorSpec(model="barometer", name="s", bias=-20.0).bias == -20.0
