import pytest
from surroundings import surroundings_in

from gslcosim.base.rng import stream
from gslcosim.scenario.models.sensors import make_sensor_spec
from gslcosim_services.sensing import SENSOR_MODELS
from gslcosim_services.sensing.models import build_sensor


@pytest.mark.parametrize(("period_s", "expected"), [(None, [0, 1, 0, 0, 0]), (0.2, [0, 0, 1, 1, 0])])
def test_a_touch_is_reported_once_it_is_read(make_room, period_s, expected):
    spec = make_sensor_spec(model="bump", name="bumper", period_s=period_s)
    bumper = build_sensor(SENSOR_MODELS["bump"], spec, 100_000_000, stream(1, "bump"))
    touches = [(), ("wall_west",), (), (), ()]
    around = [surroundings_in(make_room(), contacts=touch) for touch in touches]
    assert [bumper.read(item, (0.0, 0.0, 0.0)).values[0] for item in around] == expected
