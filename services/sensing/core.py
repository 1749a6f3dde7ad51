"""Sensing core: from the true fields and poses to the observations of each agent, with faults of sensors."""

from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from gslcosim.base import elementary
from gslcosim.base.errors import ModelError
from gslcosim.base.frames import world_from_body_rotation, yaw_from_quaternion
from gslcosim.base.quantities import GAS_QUANTITIES, Vec3
from gslcosim.base.rng import stream
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract import keys
from gslcosim.contract.messages import (
    BodyPoses,
    BodyState,
    CameraFrames,
    CameraImage,
    FieldSamples,
    MountSample,
    Observation,
    RadioTraffic,
    Reading,
)
from gslcosim.contract.participant import Episode, Inbox, Outbox
from gslcosim.contract.record import build_unchecked_constructor
from gslcosim.environment.model import Environment
from gslcosim.environment.variants import DynamicEnvironment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import (
    SensorBiasedSpec,
    SensorDriftsSpec,
    SensorDropsOutSpec,
    SensorEventSpec,
    SensorRecoversSpec,
    SensorSticksSpec,
)
from gslcosim.scenario.models.scenario import find_due_events, list_event_reads
from gslcosim.scenario.models.sensors import PoseSensorSpec, SensorSpec
from gslcosim.validity.conduct import SENSOR_STATES_KEY
from gslcosim_services.sensing.briefing import build_briefing, find_sensor_kind
from gslcosim_services.sensing.models import SensorModel, build_sensor
from gslcosim_services.sensing.models.base import Estimator, ImperfectSensor, Surroundings
from gslcosim_services.sensing.ray_scene import RayScene
from gslcosim_services.sensing.service import sensing_spec

_Key = tuple[str, str]

_new_observation = build_unchecked_constructor(Observation)
_Samples = dict[tuple[str, str], MountSample]
_SILENCE = build_unchecked_constructor(RadioTraffic)(tick=0)  # where the scenario has no channels


@dataclass(frozen=True, kw_only=True)
class _Fault:
    event: SensorEventSpec
    since_tick: int


class SensorFaults:
    """Faults of all sensors of a run; the instruments behind them continue as if there were none.

    A drifting or biased value v becomes v + bias + drift_per_s t, t the time since the event, and never falls below
    the least value of its kind of sensor; values that have no errors of an instrument, such as a direction behind a
    speed, stay as they are.

    State: the last event of each sensor that has one, and the reading that it showed before.
    Held by: tests/unit/services/sensing/test_core.py
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._faults: dict[_Key, _Fault] = {}
        self._models = {
            (agent.name, sensor.name): sensor.model for agent in scenario.agents for sensor in agent.sensors
        }

    def reset(self) -> None:
        """Clear all faults."""
        self._faults = {}

    def obey(self, tick: int, inbox: Inbox) -> None:
        """Apply what takes effect in this tick."""
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, SensorRecoversSpec):
                self._faults.pop((event.agent, event.sensor), None)
            elif isinstance(event, SensorEventSpec):
                self._faults[event.agent, event.sensor] = _Fault(event=event, since_tick=tick)

    def shown(self, agent: str, reading: Reading, before: Reading | None, tick: int) -> Reading:
        """Return the reading that a sensor shows at the end of a tick.

        Args:
            reading: The new reading.
            before: The reading of the previous tick.
        """
        fault = self._faults.get((agent, reading.sensor))
        if fault is None:
            return reading
        match fault.event:
            case SensorSticksSpec():
                return before or reading
            case SensorDropsOutSpec():
                lost = {"is_warming_up": True, "is_saturated": False, "array": None, "image": None}
                return (before or reading).model_copy(update=lost)
            case SensorBiasedSpec(bias=bias):
                return self._shifted(agent, reading, bias)
            case SensorDriftsSpec(drift_per_s=drift_per_s):
                since_s = seconds_from_ticks(tick - fault.since_tick, self._scenario.tick_ns)
                return self._shifted(agent, reading, drift_per_s * since_s)
            case _:
                return reading

    def _shifted(self, agent: str, reading: Reading, by: float) -> Reading:
        kind = find_sensor_kind(self._scenario, self._models[agent, reading.sensor])
        n = len(reading.values) if kind.n_with_errors is None else kind.n_with_errors
        values = [max(value + by, kind.least_value) for value in reading.values[:n]]
        return reading.model_copy(update={"values": (*values, *reading.values[n:])})


@dataclass(frozen=True, kw_only=True)
class _Instrument:
    spec: SensorSpec
    model: SensorModel
    is_on_board: bool
    estimate: Estimator | None
    measures_gas: bool

    def look(self, body: BodyState, surroundings: Surroundings | None, samples: "_Samples", tick: int) -> Reading:
        """Return the reading at the end of the tick."""
        sample: Any = surroundings if self.is_on_board else samples.get((body.agent, self.spec.name))
        if sample is None:
            raise ModelError(f"sensing: expected a sample for {body.agent}.{self.spec.name} in tick {tick}, was none.")
        return self.model.read(sample, mount_velocity_world_m_s(body, self.spec.mount_m))


@dataclass
class _AgentInstruments:
    """The instruments of one agent, their last readings, and the states of its gas sensors over time.

    `state_changes` has (tick, is_saturated, is_warming_up) by sensor, whenever either changed.
    """

    instruments: tuple[_Instrument, ...]
    faults: SensorFaults | None
    last: list[Reading | None] = field(init=False)
    state_changes: dict[str, list[tuple[int, bool, bool]]] = field(init=False)

    def __post_init__(self) -> None:
        self.last = [None] * len(self.instruments)
        self.state_changes = {each.spec.name: [] for each in self.instruments if each.measures_gas}
        # An instrument that measures by itself, not by samples of the fields: other vehicles may show in it.
        self.sees_others = any(each.is_on_board for each in self.instruments)
        shows_pose = (i for i, each in enumerate(self.instruments) if isinstance(each.spec, PoseSensorSpec))
        self._i_pose = next(shows_pose, None)

    def read(
        self, body: BodyState, surroundings: Surroundings | None, samples: _Samples, tick: int
    ) -> tuple[Reading, ...]:
        sent, estimates = list[Reading](), list[Reading]()
        for i, (instrument, before) in enumerate(zip(self.instruments, self.last, strict=True)):
            reading = instrument.look(body, surroundings, samples, tick)
            if self.faults is not None:
                reading = self.faults.shown(body.agent, reading, before, tick)
            self.last[i] = reading
            is_known = reading is before and not body.awaiting_command
            sent.append(_without_payload(reading) if is_known else reading)
            if instrument.measures_gas:
                changes, state = self.state_changes[instrument.spec.name], (reading.is_saturated, reading.is_warming_up)
                if not changes or changes[-1][1:] != state:
                    changes.append((tick, *state))
            if instrument.estimate is not None:
                # Its owner has calibrated this unit in clean air.
                model = instrument.model
                nominal = model.calibrated(reading) if isinstance(model, ImperfectSensor) else reading
                estimates.append(instrument.estimate(nominal))
        return (*sent, *estimates)

    # Last pose of the first pose sensor.
    @property
    def pose(self) -> Reading | None:
        return None if self._i_pose is None else self.last[self._i_pose]


def _without_payload(reading: Reading) -> Reading:
    if reading.array is None and reading.image is None:
        return reading
    return reading.model_copy(update={"array": None, "image": None})


class SensingCore:
    """Core that reads all instruments every tick and gives each agent what its own show.

    Reads `truth/bodies`, `truth/samples` and, where agents have channels, `truth/radio`, where they have cameras,
    `truth/images` of the same tick, and where sensors or doors have events `truth/events` of the last one. Writes a
    briefing for each agent once and `agents/<id>/observation` every tick. The pose in an observation is exact, unless
    the vehicle has a `pose` sensor: then it is the last reading of the first of them.

    Arrays and images come with the tick at which they are new, and again where a command is awaited.

    The estimates follow the readings of all sensors: the mixing ratio of the gas searched for that a MOX sensor's
    resistance suggests, under the sensor's name with `_ppm` behind.

    State: the instruments, new at each reset; each draws from its own stream `sensing.<agent>.<sensor>`.
    Raises ModelError when a pose or sample is missing; the runtime then ends the run as invalid.
    """

    def __init__(self, scenario: Scenario, environment: Environment) -> None:
        """Prepare the instruments of a scenario."""
        self._scenario = scenario
        self._environment = environment
        self.spec = sensing_spec(scenario)
        self._room = DynamicEnvironment(environment, scenario)
        self._scenes = {closed: RayScene(scenario, room) for closed, room in self._room.by_doors().items()}
        self._faults = SensorFaults(scenario) if list_event_reads(scenario, SensorEventSpec) else None
        # Built once already, to refuse incompatible parts here and not in the run.
        self._panels = self._new_panels(scenario.seed)

    def reset(self, episode: Episode) -> Outbox:
        """Switch all instruments on and return the agents' briefings."""
        if self._faults is not None:
            self._faults.reset()
        self._room.reset()
        self._panels = self._new_panels(episode.seed)
        return {
            keys.briefing(agent.name): build_briefing(agent, self._scenario, self._environment, seed=episode.seed)
            for agent in self._scenario.agents
        }

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Read every instrument at the end of the tick."""
        if self._faults is not None:
            self._faults.obey(tick, inbox)
        self._room.obey(inbox)
        scene = self._scenes[self._room.variant.closed]
        bodies = {body.agent: body for body in cast(BodyPoses, inbox[keys.BODIES]).bodies}
        samples = {(s.agent, s.sensor): s for s in cast(FieldSamples, inbox[keys.SAMPLES]).samples}
        traffic = cast(RadioTraffic, inbox.get(keys.RADIO, _SILENCE))
        images = _index_images(cast(CameraFrames | None, inbox.get(keys.IMAGES)))
        outbox: dict[str, Observation] = {}
        for agent, panel in self._panels.items():
            if (body := bodies.get(agent)) is None:
                raise ModelError(f"sensing: expected a pose of vehicle {agent!r} in tick {tick}, was none.")
            surroundings = None
            if panel.sees_others:
                others = tuple(other for name, other in bodies.items() if name != agent)
                surroundings = Surroundings(body, scene, others, images.get(agent, {}))
            readings = panel.read(body, surroundings, samples, tick)
            outbox[keys.observation(agent)] = self._observation(tick, body, panel.pose, readings, traffic)
        return outbox

    def summary(self) -> dict[str, Any]:
        """Return the times at which gas sensors were saturated or warming up."""
        return {SENSOR_STATES_KEY: {agent: panel.state_changes for agent, panel in self._panels.items()}}

    def _new_panels(self, seed: int) -> dict[str, _AgentInstruments]:
        return {
            agent.name: _AgentInstruments(
                tuple(self._instrument(agent.name, sensor, seed) for sensor in agent.sensors), self._faults
            )
            for agent in self._scenario.agents
        }

    def _instrument(self, agent: str, sensor: SensorSpec, seed: int) -> _Instrument:
        rng = stream(seed, f"sensing.{agent}.{sensor.name}")
        kind = find_sensor_kind(self._scenario, sensor.model)
        model = build_sensor(kind, sensor, self._scenario.tick_ns, rng)
        estimate = kind.estimator(self._scenario.gas.gas) if kind.estimator else None
        return _Instrument(
            spec=sensor,
            model=model,
            is_on_board=kind.is_on_board,
            estimate=estimate,
            measures_gas=kind.quantity in GAS_QUANTITIES,
        )

    def _observation(
        self, tick: int, body: BodyState, pose: Reading | None, readings: tuple[Reading, ...], traffic: RadioTraffic
    ) -> Observation:
        position_m, quaternion, velocity_m_s = body.position_world_m, body.quaternion_wxyz, body.velocity_world_m_s
        if pose is not None:
            x, y, z, qw, qx, qy, qz, vx, vy, vz = pose.values
            position_m, quaternion, velocity_m_s = (x, y, z), (qw, qx, qy, qz), (vx, vy, vz)
        return _new_observation(
            tick=tick,
            agent=body.agent,
            time_s=seconds_from_ticks(tick, self._scenario.tick_ns),
            position_world_m=position_m,
            yaw_rad=yaw_from_quaternion(quaternion),
            velocity_world_m_s=velocity_m_s,
            status=body.phase,
            awaiting_command=body.awaiting_command,
            readings=readings,
            notice=body.rejected_command,
            incoming=tuple([arrival.reception for arrival in traffic.arrivals if arrival.agent == body.agent]),
            radio_refusals=tuple([t.refusal for t in traffic.transmissions if t.sender == body.agent and t.refusal]),
        )


def mount_velocity_world_m_s(body: BodyState, mount_body_m: Vec3) -> Vec3:
    """Return the velocity of a mount on a turning vehicle.

    v_mount = v + R_WB (omega x r)      r mount in the body frame, omega angular velocity in the body frame
    [m/s] = [m/s] + [rad/s] [m]

    Held by:
        tests/unit/services/sensing/test_sensing_core.py
    """
    if not any(mount_body_m):
        return body.velocity_world_m_s
    wx, wy, wz = body.angular_velocity_body_rad_s
    x, y, z = mount_body_m
    swing_body_m_s = np.array((wy * z - wz * y, wz * x - wx * z, wx * y - wy * x))
    swing = elementary.product(world_from_body_rotation(body.quaternion_wxyz), swing_body_m_s)
    v = body.velocity_world_m_s
    return (v[0] + float(swing[0]), v[1] + float(swing[1]), v[2] + float(swing[2]))


# Pictures by agent and sensor.
def _index_images(frames: CameraFrames | None) -> dict[str, dict[str, CameraImage]]:
    images: dict[str, dict[str, CameraImage]] = {}
    for frame in frames.frames if frames else ():
        images.setdefault(frame.agent, {})[frame.sensor] = frame.image
    return images
