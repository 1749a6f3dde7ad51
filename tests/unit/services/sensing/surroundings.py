"""Sensors by their models, and the truth around a vehicle that they are read with."""

import numpy as np
from built_messages import build_body
from built_scenarios import build_agent, build_scenario

from gslcosim.base.rng import stream
from gslcosim.contract.record import NumericArray
from gslcosim.scenario.models.sensors import make_sensor_spec
from gslcosim_services.sensing import SENSOR_MODELS
from gslcosim_services.sensing.models.base import Surroundings
from gslcosim_services.sensing.ray_scene import RayScene

G = 9.81
IMU = [{"model": "imu", "name": "imu"}]


def at_rest(n_rows=25):
    return np.tile([0.0, 0.0, G, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], (n_rows, 1))


def body(agent="beetle", inertial=None, **changes):
    felt = NumericArray.from_array(at_rest() if inertial is None else inertial)
    return build_body(agent, **{"position_world_m": (1.0, 2.0, 3.0), "inertial_body": felt, **changes})


def scenario_of(*models):
    agents = (
        build_agent(name, (1.0 + i, 1.0, 0.1), mode="lockstep", sensors=IMU, vehicle={"model": model})
        for i, (name, model) in enumerate(zip(("beetle", "moth", "ant"), models, strict=False))
    )
    return build_scenario(*agents)


def surroundings_in(environment, *others, models=("iris", "iris", "iris"), images=None, **changes):
    return Surroundings(body(**changes), RayScene(scenario_of(*models), environment), others, images or {})


def make_sensor(model, *, tick_s=0.1, seed=1, **settings):
    spec = make_sensor_spec(**{"model": model, "name": "s", **settings})
    return SENSOR_MODELS[model].build(spec, tick_s, stream(seed, "test"))
