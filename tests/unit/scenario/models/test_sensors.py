"""Each model of a sensor has the settings of its block, and no others."""

import pytest
from pydantic import ValidationError

from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, SENSORS, make_sensor_spec

EVERY_KEY = sorted({key for block in SENSOR_BLOCKS.values() for key in block.model_fields} - {"model", "name"})
# Values that differ from all defaults.
VALUES = {
    "mount_m": (0.1, 0.0, 0.0), "mount_rpy_rad": (0.0, 0.1, 0.0), "beam_body": (0.0, 0.0, -1.0),
    "response_s": (3.0, 4.0), "recovery_s": (5.0, 6.0), "imu": {"rate_hz": 50.0}, "gps": {"correlation_s": 9.0},
    "barometer": {"noise_std_pa": 3.0}, "magnetometer": {"correlation_s": 9.0}, "pose": {"position_noise_m": 0.5},
    "lamp_ev": 10.6, "lidar": {"n_azimuths": 4}, "camera": {"width_px": 32},
}  # fmt: skip


@pytest.mark.parametrize("model", SENSORS)
def test_the_settings_of_a_model_are_kept(model):
    settings = {key: VALUES.get(key, 7.0) for key in EVERY_KEY if key in SENSOR_BLOCKS[model].model_fields}
    sensor = make_sensor_spec(model=model, name="s", **settings)
    assert sensor.model_dump(exclude_unset=True) == {"model": model, "name": "s", **settings}


@pytest.mark.parametrize("model", SENSORS)
def test_the_settings_of_other_models_are_refused(model):
    others = {key: VALUES.get(key, 7.0) for key in EVERY_KEY if key not in SENSOR_BLOCKS[model].model_fields}
    with pytest.raises(ValidationError) as refusal:
        make_sensor_spec(model=model, name="s", **others)
    refused = {(error["type"], error["loc"]) for error in refusal.value.errors()}
    assert refused == {("extra_forbidden", (model, key)) for key in others}


@pytest.mark.parametrize(
    ("model", "settings"),
    [
        ("lidar_2d", {"lidar": {"n_elevations": 4}}),
        ("depth_camera", {"camera": {"encoding": "jpeg"}}),
        ("imu", {"noise_std": 0.1}),
        ("lidar_2d", {"bias": 0.1}),
        ("pid", {"threshold_ppm": 0.1}),
    ],
)
def test_a_setting_without_a_meaning_is_refused_even_at_its_default(model, settings):
    with pytest.raises(ValidationError):
        make_sensor_spec(model=model, name="s", **settings)
