import pytest
from contract_examples import EXAMPLES
from surroundings import surroundings_in

from gslcosim.base.rng import stream
from gslcosim.contract.messages import GasAmount, MountSample
from gslcosim.scenario.models.sensors import SENSORS, make_sensor_spec
from gslcosim_services.sensing import SENSOR_MODELS


def test_scenarios_know_the_same_sensors():
    assert tuple(SENSOR_MODELS) == SENSORS


@pytest.mark.parametrize("name", sorted(SENSOR_MODELS))
def test_every_model_reads_what_its_row_promises(name, make_room):
    kind = SENSOR_MODELS[name]
    spec = make_sensor_spec(model=name, name="s")
    truth = MountSample(
        agent="a", sensor="s", gases=(GasAmount(gas="ethanol", mixing_ratio_ppm=5.0),), wind_world_m_s=(1.0, 0.0, 0.0)
    )

    if kind.is_on_board:
        truth = surroundings_in(make_room(), images={"s": EXAMPLES["images"].frames[0].image})

    def readings(seed):
        sensor = kind.build(spec, 0.1, stream(seed, "test"))
        return [sensor.read(truth, (0.0, 0.0, 0.0)) for _ in range(3)]

    assert kind.name == name
    assert kind.description
    assert {(r.sensor, r.quantity, r.unit) for r in readings(1)} == {("s", kind.quantity, kind.unit)}
    assert readings(1) == readings(1)
