import numpy as np
import pytest

from gslcosim.contract.messages import Command
from gslcosim.contract.participant import Episode
from gslcosim.vehicles import get_vehicle
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.core import WorldCore
from gslcosim_services.world.scene import build_scene


@pytest.fixture
def iris_constants(make_room):
    """One record of the iris's constants at 4 ms."""
    iris = get_vehicle("iris")
    scene = build_scene(make_room(), [("beetle", iris)], 0.004)
    constants = np.zeros(1, vehicle_records.CONSTANTS)
    vehicle_records.set_constants(constants[0], iris, scene.model, "beetle/", 0.004)
    return constants


class Pilot:
    """Steps a world tick by tick and keeps what it wrote; commands are given for the next tick."""

    def __init__(self, core):
        self.core = core
        core.reset(Episode(seed=0))
        self.tick = -1
        self.log = []
        self.step()

    def step(self, **commands):
        self.tick += 1
        inbox = {
            f"command/{agent}": Command(tick=max(0, self.tick - 1), **fields) for agent, fields in commands.items()
        }
        self.log.append(self.core.step(self.tick, inbox)["truth/bodies"])
        return self.body()

    def body(self, i=0):
        return self.log[-1].bodies[i]

    def run(self, n_ticks):
        for _ in range(n_ticks):
            self.step()
        return self.body()

    def run_until(self, condition, *, at_most=600):
        """Step until the first vehicle's state meets a condition."""
        for _ in range(at_most):
            if condition(self.step()):
                return self.body()
        raise AssertionError(f"not within {at_most} ticks: {self.body()}")

    def run_until_asked(self):
        return self.run_until(lambda body: body.awaiting_command)

    def fly(self, command):
        """Give the first vehicle a command and step until it asks for the next."""
        self.step(agent_0=command)
        return self.run_until_asked()

    def touched(self):
        """Return the names of all that vehicles have touched in flight, but for the floor."""
        return {name for message in self.log[1:] for body in message.bodies for name in body.contacts} - {"floor"}


@pytest.fixture
def make_pilot(make_room, make_scenario):
    def build(*vehicles, mode="on_request", **room):
        return Pilot(WorldCore(make_scenario(*vehicles, mode=mode), make_room(**room)))

    return build


@pytest.fixture
def asked_pilot(make_pilot):
    """A pilot whose first vehicle awaits its first command."""

    def build(*vehicles, **options):
        pilot = make_pilot(*vehicles, **options)
        pilot.run_until_asked()
        return pilot

    return build


@pytest.fixture
def hovering_pilot(make_pilot):
    """A pilot in lockstep whose vehicles have risen to their height."""

    def build(*vehicles, **options):
        pilot = make_pilot(*vehicles, mode="lockstep", **options)
        pilot.run(45)
        return pilot

    return build
