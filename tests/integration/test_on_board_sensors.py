"""The scenario with every on-board sensor, stepped in this process: what readings an agent gets, and when."""

import io

import numpy as np
import pytest
from built_runs import build_setup
from PIL import Image

from gslcosim.base.errors import ModelError
from gslcosim.contract import keys
from gslcosim.runtime.services import build_core, list_service_names
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, CameraSensorSpec, OnBoardSensorSpec
from gslcosim.scenario.serialization import plain_values
from gslcosim_services.sensing import SENSOR_MODELS

ON_BOARD_SENSORS = [name for name, block in SENSOR_BLOCKS.items() if issubclass(block, OnBoardSensorSpec)]
CAMERA_SENSORS = [name for name, block in SENSOR_BLOCKS.items() if issubclass(block, CameraSensorSpec)]
N_TICKS = 21
TICK_S = 0.1
# By name in the scenario: how many values, the shape of what is beside them, and the seconds between readings.
EXPECTED = {
    "imu": (6, (25, 6), 0.1),
    "gps": (6, None, 0.2),
    "barometer": (1, None, 0.1),
    "compass": (3, None, 0.1),
    "pose": (10, None, 0.1),
    "below": (1, None, 0.1),
    "around": (4, None, 0.1),
    "scan": (1, (1, 180), 0.2),
    "cloud": (1, (16, 360), 1.0),
    "bumper": (1, None, 0.1),
    "eye": (0, (64, 64, 3), 0.2),
    "depth": (0, (64, 64), 0.5),
}
PICTURES = ("eye", "depth")


@pytest.fixture(scope="module")
def loaded():
    """The bundled scenario, with nothing recorded."""
    return load_scenario("on_board_sensors", overrides=["recording.enabled=false"])


@pytest.fixture(scope="module")
def flown(loaded, tmp_path_factory):
    """The scenario as flown, without cameras where nothing can draw, and what the agent saw at each tick."""
    directory = tmp_path_factory.mktemp("flown")

    def observations(scenario):
        setup = build_setup(loaded, directory, scenario=scenario)
        names = [name for name in list_service_names(scenario) if name != "referee"]
        cores = [build_core(name, setup) for name in names]
        for core in cores:
            core.reset(setup.episode)
        for tick in range(N_TICKS):
            box = {}
            for core in cores:
                box |= core.step(tick, {read.port: box[read.port] for read in core.spec.reads if read.port in box})
            yield box[keys.observation("beetle")]
        for core in cores:
            getattr(core, "close", lambda: None)()

    try:
        return loaded.scenario, list(observations(loaded.scenario))
    except ModelError as error:
        if "expected EGL or OSMesa" not in str(error):
            raise
        blind = _without_cameras(loaded.scenario)
        return blind, list(observations(blind))


def _without_cameras(scenario):
    values = plain_values(scenario)
    sensors = values["agents"][0]["sensors"]
    values["agents"][0]["sensors"] = [sensor for sensor in sensors if sensor["model"] not in CAMERA_SENSORS]
    return Scenario.model_validate(values)


def test_the_scenario_has_every_on_board_sensor(loaded):
    models = {sensor.name: sensor.model for sensor in loaded.scenario.agents[0].sensors}
    assert {model for model in models.values() if SENSOR_MODELS[model].is_on_board} == set(ON_BOARD_SENSORS)
    assert {name for name, model in models.items() if model in ON_BOARD_SENSORS} == set(EXPECTED)


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.debian) if n in PICTURES else n for n in EXPECTED])
def test_a_sensor_has_the_documented_shape_unit_and_rate(flown, name):
    scenario, observations = flown
    (sensor,) = [s for s in scenario.agents[0].sensors if s.name == name] or pytest.skip("neither EGL nor OSMesa")
    kind, (n_values, shape, period_s) = SENSOR_MODELS[sensor.model], EXPECTED[name]
    readings = [observation.reading(name) for observation in observations]
    assert {(r.quantity, r.unit, len(r.values)) for r in readings} == {(kind.quantity, kind.unit, n_values)}
    assert (sensor.period_s or TICK_S) == period_s
    period_ticks = round(period_s / TICK_S)
    new_at = [tick for tick in range(N_TICKS) if tick % period_ticks == 0]
    if shape is None:
        assert all(r.array is None and r.image is None for r in readings)
        assert [readings[tick - tick % period_ticks].values for tick in range(N_TICKS)] == [r.values for r in readings]
    else:
        given = [tick for tick, r in enumerate(readings) if r.array or r.image]
        asked_at = [tick for tick, observation in enumerate(observations) if observation.awaiting_command]
        assert given == sorted({*new_at, *asked_at})
        assert {_shape(readings[tick]) for tick in given} == {shape}


def _shape(reading):
    return reading.array.shape if reading.array else np.array(Image.open(io.BytesIO(reading.image.data))).shape


def test_what_is_measured_is_where_the_vehicle_is(flown):
    _, observations = flown
    last = observations[-1]
    height_m = last.reading("pose").values[2]
    assert last.reading("below").values[0] == pytest.approx(height_m, abs=0.1)
    assert last.reading("gps").values[2] == pytest.approx(height_m, abs=0.2)
    assert (101325.0 - last.reading("barometer").values[0]) / 12.0 == pytest.approx(height_m, abs=0.5)
    force = np.array(last.reading("imu").values[:3])
    assert np.linalg.norm(force) == pytest.approx(9.81, abs=2.0)
    ranges_m = np.array(last.reading("around").values)
    assert ranges_m == pytest.approx([1.5, 2.5, 4.0, 2.5], abs=0.2)
