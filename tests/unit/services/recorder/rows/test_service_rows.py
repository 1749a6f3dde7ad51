"""Curves of services' messages: what of them is recorded, and where."""

from gslcosim.contract.environment_messages import ProbeSample, ProbeSamples
from gslcosim.contract.messages import GasAmount
from gslcosim.scenario import load_scenario
from gslcosim_services.recorder.rows.columns import RecordingRows
from gslcosim_services.recorder.rows.events import ServiceRows


class RowsOnPaper:
    """What a recording file is sent."""

    def __init__(self):
        self.rows = {}

    def send(self, entity, ticks, columns):
        del columns
        self.rows[entity] = ticks


def test_each_gas_and_each_axis_of_the_wind_at_a_probe_is_a_curve():
    probes = "probes=[{name: inlet, position_m: [1, 1, 1]}, {name: outlet, position_m: [2, 2, 1]}]"
    file = RowsOnPaper()
    rows = RecordingRows(file)
    services = ServiceRows(rows, load_scenario("tiny_room", overrides=[probes]).scenario)
    for tick in (3, 4):
        samples = tuple(
            ProbeSample(
                probe=name,
                gases=(GasAmount(gas="ethanol", mixing_ratio_ppm=1.5),),
                wind_world_m_s=(0.5, 0.0, 0.0),
            )
            for name in ("inlet", "outlet")
        )
        services.add(tick, {"truth/probes": ProbeSamples(tick=tick, samples=samples)})
    rows.send()
    curves = ("ethanol_ppm", "wind_x_m_s", "wind_y_m_s", "wind_z_m_s")
    root = "plots/services/truth/probes"
    assert file.rows == {f"{root}/{name}/{curve}": [3, 4] for name in ("inlet", "outlet") for curve in curves}
