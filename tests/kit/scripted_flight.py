"""All messages of a run without any core: a vehicle flies a circle through a cloud that shakes."""

import io
import math

import numpy as np
from built_messages import build_body, build_observation
from built_scenarios import build_agent, build_scenario
from PIL import Image

from gslcosim.base.rng import stream
from gslcosim.contract import keys
from gslcosim.contract.messages import (
    AgentResult,
    AgentScore,
    Belief,
    BeliefScore,
    BodyPoses,
    CameraImage,
    Command,
    ConcentrationSlice,
    FieldSamples,
    FilamentCloud,
    GasAmount,
    MountSample,
    Note,
    Reading,
    RefereeEvent,
    Score,
    Verdict,
)
from gslcosim.contract.record import NumericArray
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, CameraSensorSpec, OnBoardSensorSpec
from gslcosim_services.sensing.models import sensor_kind

ON_BOARD_SENSORS = [name for name, block in SENSOR_BLOCKS.items() if issubclass(block, OnBoardSensorSpec)]
CAMERA_SENSORS = [name for name, block in SENSOR_BLOCKS.items() if issubclass(block, CameraSensorSpec)]
CLOUD_EVERY_TICKS = 10
WAYPOINT_EVERY_TICKS = 30
SOURCE_M = (5.0, 1.0, 2.0)


NOSE_AND_VANE = ({"model": "tgs2600", "name": "nose"}, {"model": "anemometer", "name": "vane"})
# One of each on-board sensor, each named after its model.
ON_BOARD = tuple({"model": model, "name": model} for model in ON_BOARD_SENSORS)
N_VALUES = {"imu": 6, "gps": 6, "magnetometer": 3, "pose": 10, "four_range_finders": 4, "anemometer_3d": 3}
LIDAR_SHAPES = {"lidar_2d": (1, 360), "lidar_3d": (16, 360)}
CAMERA_EVERY_TICKS = 2


def scenario(n_agents=1, channels=(), sensors=NOSE_AND_VANE, sources=({"position_m": SOURCE_M},)):
    """Return a scenario of agents with the same sensors each."""
    agents = [build_agent(f"agent_{i}", (9.0 - i, 4.0, 0.2), sensors=sensors) for i in range(n_agents)]
    return build_scenario(*agents, name="scripted", gas={"sources": sources}, channels=channels)


class ScriptedFlight:
    """A run of `n_ticks` ticks; the last one carries the verdict.

    `plans` are the paths planned at its ticks, `contacts` what is touched at them. All agents have the same `sensors`.
    """

    def __init__(
        self,
        *,
        n_ticks=40,
        n_filaments=50,
        n_agents=1,
        channels=(),
        plans=(),
        contacts=(),
        sensors=NOSE_AND_VANE,
        believers=(),
        noters=(),
    ):
        self.n_ticks = n_ticks
        self._plans = plans
        self._believers = believers
        self._noters = noters
        self._contacts = contacts
        self.scenario = scenario(n_agents, channels, sensors)
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

    def yaw_rad(self, tick):
        """Where every vehicle looks."""
        return 0.1 * tick

    def world_m(self, tick, points_body_m):
        """Return where (..., 3) points of the first vehicle's body are at a tick."""
        cosine, sine = math.cos(self.yaw_rad(tick)), math.sin(self.yaw_rad(tick))
        world_from_body = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return np.array(self.position_m(tick)) + np.asarray(points_body_m) @ world_from_body.T

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
                belief = belief_of(tick) if name in self._believers else None
                note = note_of(tick) if name in self._noters else None
                command = Command(tick=tick, kind="waypoint", position_world_m=waypoint_m, belief=belief, note=note)
                messages[keys.command(name)] = command
        if tick == self.n_ticks - 1:
            messages[keys.VERDICT] = self._verdict(tick)
        return messages

    def _body(self, tick, i):
        return build_body(
            self._names[i],
            self.position_m(tick, i),
            quaternion_wxyz=(math.cos(self.yaw_rad(tick) / 2), 0.0, 0.0, math.sin(self.yaw_rad(tick) / 2)),
            path_length_m=0.04 * tick,
            contacts=self._contacts[tick] if tick < len(self._contacts) else (),
            tracking_error_m=0.01 * (tick + i),
            planned_path_world_m=self._plans[tick] if tick < len(self._plans) else (),
        )

    def _samples(self, tick):
        gases = (GasAmount(gas="ethanol", mixing_ratio_ppm=1.0 + math.sin(0.1 * tick)),)
        return tuple(
            MountSample(
                agent=agent.name,
                sensor=sensor.name,
                gases=gases,
                wind_world_m_s=(0.3, 0.4, 0.0),
                beam_m=1.0 + 0.01 * tick if sensor.model == "tdlas" else None,
            )
            for agent in self.scenario.agents
            for sensor in agent.sensors
            if sensor.model not in ON_BOARD_SENSORS
        )

    def _observation(self, tick, i):
        return build_observation(
            tick,
            agent=self._names[i],
            position_world_m=self.position_m(tick, i),
            status="flying",
            awaiting_command=False,
            readings=tuple(_reading(sensor, tick) for sensor in self.scenario.agents[i].sensors),
        )

    def _score(self, tick):
        standings = tuple(
            AgentScore(
                agent=name,
                distance_to_source_m=math.dist(self.position_m(tick, i), SOURCE_M),
                path_length_m=0.04 * tick,
                n_commands=tick // WAYPOINT_EVERY_TICKS,
                belief=self._belief_score(tick) if name in self._believers else None,
            )
            for i, name in enumerate(self._names)
        )
        events = [RefereeEvent(agent=name, kind="take_off", text="takes off") for name in self._names if tick == 3]
        return Score(tick=tick, agents=standings, events=tuple(events), is_final=tick == self.n_ticks - 1)

    # News with each waypoint only.
    def _belief_score(self, tick):
        mass = 0.25 + 0.01 * (tick // WAYPOINT_EVERY_TICKS)
        return BeliefScore(expected_distance_m=10.0 * mass, mass_near_frac=mass, cell_frac=0.1, entropy_bits=3.0)

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
                name=name, success=True, outcome="success", time_to_source_s=0.1 * tick, steps=7, path_length_m=27.0,
                straight_line_m=9.0, shortest_path_m=12.0, movement_overhead=1.25, directness=0.4,
                final_distance_m=0.95, declared_error_m=None,
            )
            for name in self._names
        )  # fmt: skip
        return Verdict(tick=tick, end_reason="success", agents=results)


def note_of(tick):
    """Return what a method writes down with its answer to the observation of a tick: it surges once, then casts."""
    return Note(mode="casting" if tick else "surging", values={"entropy_bits": 4.0 - 0.01 * tick})


def belief_of(tick):
    """Return a belief of 3 x 2 cells that is half in one of them."""
    p = np.full((3, 2), 0.1, np.float32)
    p[tick // WAYPOINT_EVERY_TICKS % 3, 1] = 0.5
    return Belief(origin_m=(1.0, 2.0, 2.0), cell_m=0.5, probability=NumericArray.from_array(p))


def _reading(sensor, tick):
    kind = sensor_kind(sensor.model)
    reading = Reading(sensor=sensor.name, quantity=kind.quantity, unit=kind.unit, values=_values(sensor.model, tick))
    if sensor.model in LIDAR_SHAPES:
        ranges_m = np.linspace(1.0, 40.0, math.prod(LIDAR_SHAPES[sensor.model])).reshape(LIDAR_SHAPES[sensor.model])
        array = NumericArray.from_array((ranges_m + 0.01 * tick).astype(np.float32))
        return reading.model_copy(update={"array": array})
    if sensor.model in CAMERA_SENSORS:
        return reading.model_copy(update={"image": _image(sensor.model, tick)})
    return reading


def _values(model, tick):
    if model in CAMERA_SENSORS:
        return ()
    if model == "tgs2600":
        return (50_000.0 - tick,)
    if model == "anemometer":
        return (0.5, 0.1)
    return tuple(1.0 + 0.1 * i + 0.01 * tick for i in range(N_VALUES.get(model, 1)))


# A new picture every other tick, told at every tick.
def _image(model, tick):
    taken_tick = tick - tick % CAMERA_EVERY_TICKS
    file = io.BytesIO()
    if model == "depth_camera":
        Image.fromarray(np.full((8, 8), 1000 + taken_tick, np.uint16)).save(file, "PNG")
    else:
        Image.fromarray(np.full((8, 8, 3), taken_tick % 256, np.uint8)).save(file, "PNG")
    return CameraImage(
        encoding="depth_png" if model == "depth_camera" else "png",
        width_px=8,
        height_px=8,
        focal_px=5.0,
        centre_px=(4.0, 4.0),
        position_body_m=(0.1, 0.0, 0.0),
        quaternion_body_wxyz=(0.5, -0.5, 0.5, -0.5),
        taken_tick=taken_tick,
        data=file.getvalue(),
    )
