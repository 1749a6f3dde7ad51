"""All messages of a flight without any core: a vehicle flies a circle through a cloud that shakes."""

import math

import numpy as np

from gslcosim.contract import keys
from gslcosim.contract.arrays import NumericArray
from gslcosim.contract.messages import (
    AgentResult,
    AgentScore,
    BodyPoses,
    BodyState,
    Command,
    ConcentrationSlice,
    FieldSamples,
    FilamentCloud,
    GasAmount,
    MountSample,
    Observation,
    Reading,
    RefereeEvent,
    Score,
    Verdict,
)
from gslcosim.rng import stream
from gslcosim.scenario.models import Scenario

CLOUD_EVERY_TICKS = 10
WAYPOINT_EVERY_TICKS = 30
SOURCE_M = (5.0, 1.0, 2.0)


def scenario(n_agents=1, channels=()):
    """Return a scenario of agents with a gas sensor and an anemometer each."""
    agents = [
        {
            "name": f"agent_{i}",
            "start": {"python": "dung_beetle"},
            "vehicle": {"start_m": (9.0 - i, 4.0, 0.2)},
            "sensors": [{"model": "tgs2600", "name": "nose"}, {"model": "anemometer", "name": "vane"}],
        }
        for i in range(n_agents)
    ]
    return Scenario.model_validate(
        {
            "schema": "gslcosim/scenario/1",
            "name": "scripted",
            "environment": {"layout": {}},
            "gas": {"sources": [{"position_m": SOURCE_M}]},
            "agents": agents,
            "channels": channels,
        }
    )


class ScriptedFlight:
    """A flight of `n_ticks` ticks; the last one carries the verdict. `plans` are the paths planned at its ticks."""

    def __init__(self, *, n_ticks=40, n_filaments=50, n_agents=1, channels=(), plans=()):
        self.n_ticks = n_ticks
        self._plans = plans
        self.scenario = scenario(n_agents, channels)
        self._names = [agent.name for agent in self.scenario.agents]
        rng = stream(0, "test.filaments")
        ages_s = rng.uniform(0.0, 150.0, n_filaments)
        sigmas_m = np.sqrt(0.01 + 0.001 * ages_s)
        offsets_m = np.stack([0.05 * ages_s, 0.04 * ages_s, 0.0 * ages_s], axis=-1)
        centres_m = SOURCE_M + offsets_m + rng.normal(size=(n_filaments, 3)) * sigmas_m[:, None]
        self._centres_m = centres_m.astype(np.float32)
        self._sigmas = NumericArray.from_array(sigmas_m.astype(np.float32))
        self._gas_index = NumericArray.from_array(np.zeros(n_filaments, np.uint8))
        self._slice = NumericArray.from_array(rng.uniform(0.0, 5.0, (60, 40)).astype(np.float32))

    def position_m(self, tick, agent=0):
        """Where the vehicle is."""
        angle = 0.02 * tick + agent
        return (7.0 + 2.0 * math.cos(angle), 4.0 + 2.0 * math.sin(angle), min(0.2 + 0.1 * tick, 2.0))

    def inbox(self, tick):
        """Return all messages of a tick."""
        messages = {
            keys.BODIES: BodyPoses(tick=tick, bodies=tuple(self._body(tick, i) for i in range(len(self._names)))),
            keys.SAMPLES: FieldSamples(tick=tick, samples=self._samples(tick)),
            keys.SCORE: self._score(tick),
        }
        if tick % CLOUD_EVERY_TICKS == 0:
            messages[keys.FILAMENTS] = self._cloud(tick)
        for i, name in enumerate(self._names):
            messages[keys.observation(name)] = self._observation(tick, i)
            if tick % WAYPOINT_EVERY_TICKS == 0:
                waypoint_m = self.position_m(tick + WAYPOINT_EVERY_TICKS, i)
                messages[keys.command(name)] = Command(tick=tick, kind="waypoint", position_world_m=waypoint_m)
        if tick == self.n_ticks - 1:
            messages[keys.VERDICT] = self._verdict(tick)
        return messages

    def _body(self, tick, i):
        return BodyState(
            agent=self._names[i],
            position_world_m=self.position_m(tick, i),
            quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
            velocity_world_m_s=(0.0, 0.0, 0.0),
            angular_velocity_body_rad_s=(0.0, 0.0, 0.0),
            phase="flying",
            awaiting_command=False,
            path_length_m=0.04 * tick,
            planned_path_world_m=self._plans[tick] if tick < len(self._plans) else (),
        )

    def _samples(self, tick):
        gases = (GasAmount(gas="ethanol", mixing_ratio_ppm=1.0 + math.sin(0.1 * tick)),)
        return tuple(
            MountSample(agent=name, sensor=sensor, gases=gases, wind_world_m_s=(0.3, 0.4, 0.0))
            for name in self._names
            for sensor in ("nose", "vane")
        )

    def _observation(self, tick, i):
        return Observation(
            tick=tick,
            agent=self._names[i],
            time_s=0.1 * tick,
            position_world_m=self.position_m(tick, i),
            yaw_rad=0.0,
            velocity_world_m_s=(0.0, 0.0, 0.0),
            status="flying",
            awaiting_command=False,
            readings=(
                Reading(sensor="nose", quantity="resistance", unit="ohm", values=(50_000.0 - tick,)),
                Reading(sensor="vane", quantity="wind", unit="m/s, rad", values=(0.5, 0.1)),
            ),
        )

    def _score(self, tick):
        standings = tuple(
            AgentScore(
                agent=name,
                distance_to_source_m=math.dist(self.position_m(tick, i), SOURCE_M),
                path_length_m=0.04 * tick,
                n_commands=tick // WAYPOINT_EVERY_TICKS,
            )
            for i, name in enumerate(self._names)
        )
        events = [RefereeEvent(agent=name, kind="take_off", text="takes off") for name in self._names if tick == 3]
        return Score(tick=tick, agents=standings, events=tuple(events), is_final=tick == self.n_ticks - 1)

    def _cloud(self, tick):
        layer = ConcentrationSlice(
            gas="ethanol", origin_m=(0.0, 0.0), cell_m=0.25, height_m=2.0, mixing_ratio_ppm=self._slice
        )
        return FilamentCloud(
            tick=tick,
            gases=("ethanol",),
            position_world_m=NumericArray.from_array(self._centres_m * np.float32(1.0 + 1e-3 * math.sin(tick))),
            sigma_m=self._sigmas,
            gas_index=self._gas_index,
            slices=(layer,),
        )

    def _verdict(self, tick):
        results = tuple(
            AgentResult(
                name=name,
                success=True,
                outcome="success",
                time_to_source_s=0.1 * tick,
                steps=7,
                path_length_m=27.0,
                straight_line_m=9.0,
                shortest_path_m=12.0,
                movement_overhead=1.25,
                directness=0.4,
                final_distance_m=0.95,
                declared_error_m=None,
            )
            for name in self._names
        )
        return Verdict(tick=tick, end_reason="success", agents=results)
