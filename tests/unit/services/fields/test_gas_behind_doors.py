"""Gas stays behind a closed door, comes through an open one, and is seen by the walls that stand then."""

import numpy as np
import pytest
from built_messages import build_body

from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.messages import BodyPoses
from gslcosim.contract.participant import Episode
from gslcosim.environment.model import Cell
from gslcosim_services.fields.core import FieldsCore
from gslcosim_services.fields.sample_points import Beams

OPENS, CLOSES = "{what: door_opens, at_s: 10, door: gate}", "{what: door_closes, at_s: 20, door: gate}"
# Beside the door, which takes x from 3 to 3.25 m, and much mixing so that gas comes to it.
SOURCE = ("gas.sources[0].position_m=[3.4, 2, 1]", "gas.eddy_diffusivity_m2_s=0.02", "gas.warm_up_s=5")
BEFORE_IT_M = (2.8, 2.0, 1.0)


class Fields:
    """Fields whose doors move when the test says so."""

    def __init__(self, scenario, environment):
        self.environment = environment
        self.core = FieldsCore(scenario, environment)
        self.core.reset(Episode(seed=1))
        self.tick = -1

    def step(self, *events):
        self.tick += 1
        inbox = {keys.BODIES: BodyPoses(tick=self.tick, bodies=(body(),))}
        if self.tick:
            inbox[EVENTS] = EventsBeginning(tick=self.tick - 1, beginning=events)
        return self.core.step(self.tick, inbox)

    def run(self, n_ticks):
        for _ in range(n_ticks):
            self.step()

    @property
    def x_m(self):
        return self.core.gas.filaments.position_world_m[:, 0]

    @property
    def seen_ppm(self):
        return float(self.core.gas.mixing_ratio_ppm_at(np.array([BEFORE_IT_M]))[0, 0])


def body(position_m=(1.5, 2.0, 1.0)):
    return build_body("beetle", position_m)


@pytest.fixture
def fields(room_with_gate):
    return lambda *events: Fields(*room_with_gate(*events, changes=SOURCE))


def test_gas_stays_behind_a_door_until_it_opens(fields):
    gas = fields(OPENS)
    gas.run(100)
    assert gas.x_m.min() > 3.25
    assert gas.seen_ppm == 0.0
    gas.step(0)
    assert gas.seen_ppm > 0.0, "what is behind an open door is seen at once"
    gas.run(60)
    assert gas.x_m.min() < 3.0


def test_gas_in_the_place_of_a_door_that_closes_is_gone_and_none_passes_it(fields):
    gas = fields(OPENS, CLOSES)
    gas.step()
    gas.step(0)
    gas.run(80)
    is_in_it = (gas.x_m >= 3.0) & (gas.x_m < 3.25)
    n_before, n_in_it = len(gas.x_m), int(is_in_it.sum())
    assert n_in_it > 0
    gas.step(1)
    n_born = 2
    assert len(gas.x_m) <= n_before - n_in_it + n_born
    for _ in range(50):
        gas.step()
        cells = gas.environment.grid.cell_of(gas.core.gas.filaments.position_world_m.astype(float))
        assert not (gas.environment.occupancy[tuple(cells.T)] == Cell.SOLID).any()
    assert gas.seen_ppm == 0.0 or (gas.x_m < 3.0).any(), "only gas on this side is seen"


def test_a_reset_closes_what_has_been_opened(fields):
    gas = fields(OPENS)
    first = [gas.step() for _ in range(3)]
    gas.step(0)
    gas.core.reset(Episode(seed=1))
    gas.tick = -1
    assert [gas.step() for _ in range(3)] == first


def test_a_beam_ends_at_a_closed_door_and_passes_an_open_one(room_with_gate):
    tdlas = "agents[0].sensors=[{model: tdlas, name: beam, max_range_m: 10}]"
    scenario, environment = room_with_gate(OPENS, changes=[tdlas])
    beams, poses = Beams(scenario, environment), BodyPoses(tick=0, bodies=(body(),))
    key = ("beetle", "beam")
    assert beams.points_of(poses)[key][0] == pytest.approx(1.5, abs=0.05)
    beams.close_doors(())
    assert beams.points_of(poses)[key][0] == pytest.approx(4.5, abs=0.05)
