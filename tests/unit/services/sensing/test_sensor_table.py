import pytest
from built_messages import build_sample
from contract_examples import EXAMPLES
from surroundings import surroundings_in

from gslcosim.base.quantities import GAS_QUANTITIES, POINT_GAS_QUANTITIES
from gslcosim.base.rng import stream
from gslcosim.methods.card import WIND_QUANTITY
from gslcosim.scenario.models.sensors import make_sensor_spec
from gslcosim_services.sensing import SENSOR_MODELS


@pytest.mark.parametrize("name", sorted(SENSOR_MODELS))
def test_every_model_reads_what_its_row_promises(name, make_room):
    kind = SENSOR_MODELS[name]
    spec = make_sensor_spec(model=name, name="s")
    truth = build_sample("a", "s", wind_m_s=(1.0, 0.0, 0.0), ethanol=5.0)
    if kind.is_on_board:
        truth = surroundings_in(make_room(), images={"s": EXAMPLES["images"].frames[0].image})

    def readings(seed):
        sensor = kind.build(spec, 0.1, stream(seed, "test"))
        return [sensor.read(truth, (0.0, 0.0, 0.0)) for _ in range(3)]

    assert kind.name == name
    assert kind.description
    assert {(r.sensor, r.quantity, r.unit) for r in readings(1)} == {("s", kind.quantity, kind.unit)}
    assert readings(1) == readings(1)


def test_each_sensor_that_is_given_the_air_and_does_not_report_the_wind_is_a_gas_sensor():
    """One table says so to validity, scores, the keyboard and methods; a laser was none for two of them."""
    given_air = {kind.quantity for kind in SENSOR_MODELS.values() if not kind.is_on_board}
    assert given_air - {WIND_QUANTITY} == set(GAS_QUANTITIES)
    assert set(GAS_QUANTITIES) - set(POINT_GAS_QUANTITIES) == {SENSOR_MODELS["tdlas"].quantity}
