"""Rate, delay, noise and warm-up have their effect in every row of the table of sensors, so also in the next one."""

import math
import re

import numpy as np
import pytest
from contract_examples import EXAMPLES
from surroundings import at_rest, surroundings_in

from gslcosim.base.rng import stream
from gslcosim.contract.messages import GasAmount, MountSample
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, make_sensor_spec
from gslcosim_services.sensing import SENSOR_MODELS
from gslcosim_services.sensing.models import build_sensor

TICK_NS = 100_000_000
NAMES = sorted(SENSOR_MODELS)
# A bumper tells 0 or 1 and pictures are exact: docs/sensors.md says so.
WITHOUT_NOISE = {"bump", "camera", "depth_camera"}
PICTURE = EXAMPLES["images"].frames[0].image


@pytest.fixture
def read(make_room):
    """Read a sensor once for each moment of a flight: 0 and 1 are two places with different gas, wind and pictures."""
    room = make_room()

    def on_board(moment):
        turn_rad = 0.3 * moment
        return surroundings_in(
            room,
            position_world_m=(3.0 + moment, 4.0, 2.0 + moment),
            quaternion_wxyz=(math.cos(turn_rad / 2), 0.0, 0.0, math.sin(turn_rad / 2)),
            inertial=at_rest() * (1.0 + moment) + moment,
            contacts=("wall_west",) if moment else (),
            images={"s": PICTURE.model_copy(update={"taken_tick": 7 + moment})},
        )

    def in_air(moment):
        gases = (GasAmount(gas="ethanol", mixing_ratio_ppm=2000.0 * moment),)
        wind_m_s = (1.0 + moment, 0.5 * moment, 0.2)
        return MountSample(agent="beetle", sensor="s", gases=gases, wind_world_m_s=wind_m_s, beam_m=2.0)

    def readings(name, moments, *, seed=1, **settings):
        kind, many_hits = SENSOR_MODELS[name], {"hits_per_s_per_ppm": 10.0} if name == "hit_counter" else {}
        spec = make_sensor_spec(**{"model": name, "name": "s", **many_hits, **settings})
        sensor = build_sensor(kind, spec, TICK_NS, stream(seed, "test"))
        look = on_board if kind.is_on_board else in_air
        return [sensor.read(look(moment), (0.1 * moment, 0.0, 0.0)) for moment in moments]

    return readings


def without_own_noise(name):
    """Return the settings of a model, of those that its block has, that take its noise and wandering away."""
    block = getattr(make_sensor_spec(model=name, name="s"), name, None)
    keys = [key for key in type(block).model_fields if re.search("noise|walk|bias|drift", key)] if block else []
    own = [key for key in SENSOR_BLOCKS[name].model_fields if re.search("noise|walk|spread", key)]
    silent = dict.fromkeys(own, 0.0)
    return {**silent, name: dict.fromkeys(keys, 0.0)} if keys else silent


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("delay_s", [0.0, 0.2])
def test_nothing_is_noticed_before_the_delay_is_over(read, name, delay_s):
    still, moved = (read(name, [0] * 5 + [moment] * 10, delay_s=delay_s) for moment in (0, 1))
    noticed = [a == b for a, b in zip(still, moved, strict=True)].index(False) - round(delay_s / 0.1)
    assert noticed == 5 if SENSOR_MODELS[name].is_on_board else 5 <= noticed <= 7


@pytest.mark.parametrize("name", NAMES)
def test_between_readings_the_last_one_stands(read, name):
    moments = [tick // 3 % 2 for tick in range(12)]
    shown = read(name, moments, period_s=0.3)
    assert shown == [shown[tick - tick % 3] for tick in range(12)]
    # A bumper tells what was since the last reading.
    assert shown[3] != shown[0] if name != "bump" else shown[6] != shown[0]


@pytest.mark.parametrize("name", NAMES)
def test_until_it_is_warm_every_sensor_says_so(read, name):
    assert [reading.is_warming_up for reading in read(name, [0] * 5, warm_up_s=0.3)] == [True] * 3 + [False] * 2


@pytest.mark.parametrize("name", sorted(set(NAMES) - WITHOUT_NOISE))
def test_noise_has_an_effect_and_belongs_to_the_stream(read, name):
    silent = without_own_noise(name)
    has_own = name in silent or name in {"anemometer", "anemometer_3d"}
    noisy = {} if has_own else {"noise_std": 0.05}
    # What compares shows noise only near its threshold.
    noisy |= {"threshold_ppm": 2000.0} if name == "binary" else {}
    moments = [1] * 8
    one, again, other = (read(name, moments, seed=seed, **noisy) for seed in (1, 1, 2))
    assert one == again != other
    if name != "hit_counter":  # counts by chance
        assert read(name, moments, seed=1, **silent) == read(name, moments, seed=2, **silent)


@pytest.mark.parametrize("name", NAMES)
def test_readings_are_what_the_row_of_their_sensor_says(read, name):
    kind = SENSOR_MODELS[name]
    described = re.search(r"values = \(([^)]*)\)", kind.description)
    (reading,) = read(name, [1])
    assert (kind.name, reading.sensor, reading.quantity, reading.unit) == (name, "s", kind.quantity, kind.unit)
    assert len(reading.values) == (len([v for v in described[1].split(",") if v.strip()]) if described else 0)
    assert (reading.image is None) == bool(described)
    assert all(np.isfinite(reading.values))
