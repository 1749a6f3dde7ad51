"""Truth around a vehicle that on-board sensors are read with."""

import numpy as np

from gslcosim.contract.messages import BodyState
from gslcosim.contract.record import NumericArray
from gslcosim.scenario.models.scenario import Scenario
from gslcosim_services.sensing.models.base import Surroundings
from gslcosim_services.sensing.ray_scene import RayScene

G = 9.81


def at_rest(n_rows=25):
    return np.tile([0.0, 0.0, G, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], (n_rows, 1))


def body(agent="beetle", inertial=None, **changes):
    return BodyState(
        **{
            "agent": agent,
            "position_world_m": (1.0, 2.0, 3.0),
            "quaternion_wxyz": (1.0, 0.0, 0.0, 0.0),
            "velocity_world_m_s": (0.0, 0.0, 0.0),
            "angular_velocity_body_rad_s": (0.0, 0.0, 0.0),
            "phase": "flying",
            "awaiting_command": False,
            "path_length_m": 0.0,
            "inertial_body": NumericArray.from_array(at_rest() if inertial is None else inertial),
            **changes,
        }
    )


def scenario_of(*models):
    agents = [
        {
            "name": name,
            "start": {"python": "dung_beetle"},
            "mode": "lockstep",
            "vehicle": {"model": model, "start_m": (1.0 + i, 1.0, 0.1)},
            "sensors": [{"model": "imu", "name": "imu"}],
        }
        for i, (name, model) in enumerate(zip(("beetle", "moth", "ant"), models, strict=False))
    ]
    return Scenario.model_validate(
        {
            "schema": "gslcosim/scenario/1",
            "name": "test",
            "environment": {"layout": {}},
            "gas": {"sources": [{"position_m": (5.0, 1.0, 2.0)}]},
            "agents": agents,
        }
    )


def surroundings_in(environment, *others, models=("iris", "iris", "iris"), images=None, **changes):
    return Surroundings(body(**changes), RayScene(scenario_of(*models), environment), others, images or {})
