"""Every message of a run: frozen facts, SI units with the unit in the name, readable in any language.

All are msgpack maps with string keys. Unknown keys are ignored, NaN and infinity are refused.
In JSON, which the gateway offers too, they are objects with the same keys; bytes are base64 text.
A message belongs to a tick and is valid at the end of that tick, unless its docstring says otherwise.
Frames: *world* is x east, y north, z up, right-handed, origin at the room's inner corner; *body* is x forward,
y left, z up. Quaternions are (w, x, y, z).
"""

from typing import Literal

from gslcosim.contract.arrays import NumericArray
from gslcosim.contract.commands import AttitudeSetpoint as AttitudeSetpoint
from gslcosim.contract.commands import Command as Command
from gslcosim.contract.commands import Declaration as Declaration
from gslcosim.contract.commands import DriveSetpoint as DriveSetpoint
from gslcosim.contract.commands import RadioMessage as RadioMessage
from gslcosim.contract.commands import RateSetpoint as RateSetpoint
from gslcosim.contract.commands import Waypoint as Waypoint
from gslcosim.contract.knowledge import Belief as Belief
from gslcosim.contract.knowledge import KnownMap as KnownMap
from gslcosim.contract.knowledge import NominalPlume as NominalPlume
from gslcosim.contract.knowledge import ParameterValue
from gslcosim.contract.record import Message as Message
from gslcosim.contract.record import Name as Name
from gslcosim.contract.record import Quaternion as Quaternion
from gslcosim.contract.record import Record as Record
from gslcosim.contract.record import Tick as Tick
from gslcosim.quantities import Vec3 as Vec3

CONTRACT_VERSION = "1.2"

# ---------------------------------------------------------------- truth, never visible to agents


class BodyState(Record):
    """True state of one vehicle; part of `BodyPoses`.

    `position_world_m` is the origin of the body frame, `quaternion_wxyz` turns body into world vectors,
    `contacts` names the things touched during the tick, `phase` is what the vehicle is doing (`landing` and
    `driving` since 1.1), `awaiting_command` asks the agent for its next command, `path_length_m` is the distance flown
    or driven so far,
    `waypoint_world_m` is where it is going (absent: nowhere), `tracking_error_m` (since 1.1) is how far it is from
    where its controller wants it now (absent: it follows no path). `rejected_command` says why the last command was
    refused or how it was changed. `planned_path_world_m` (since 1.1) are the bends ahead and the waypoint, where the
    vehicle avoids obstacles.
    `inertial_body` (since 1.1) is there for a vehicle with an IMU: (n, 9) float64, a row for each physics step of the
    tick, of specific force [m/s^2], angular velocity [rad/s] and angular acceleration [rad/s^2] at the origin of the
    body frame, in its axes.
    """

    agent: Name
    position_world_m: Vec3
    quaternion_wxyz: Quaternion
    velocity_world_m_s: Vec3
    angular_velocity_body_rad_s: Vec3
    phase: Literal["on_ground", "taking_off", "flying", "holding", "failed", "landing", "driving"]
    awaiting_command: bool
    path_length_m: float
    waypoint_world_m: Vec3 | None = None
    contacts: tuple[str, ...] = ()
    rejected_command: str | None = None
    tracking_error_m: float | None = None
    planned_path_world_m: tuple[Vec3, ...] = ()
    inertial_body: NumericArray | None = None


class BodyPoses(Message):
    """Poses, velocities and contacts of all vehicles. Written by world on `truth/bodies` every tick. Truth."""

    bodies: tuple[BodyState, ...]

    def announced_ports(self) -> frozenset[str]:
        """Return the command ports of the agents that are asked at this tick."""
        return frozenset(f"command/{body.agent}" for body in self.bodies if body.awaiting_command)


class GasAmount(Record):
    """True mixing ratio [ppm by volume] of one gas at one place."""

    gas: str
    mixing_ratio_ppm: float


class MountSample(Record):
    """True gas and wind at the mount of one sensor; the wind is that of the air, not relative to the vehicle.

    For an instrument with a beam (since 1.1) `gases` are means along it, and `beam_m` is its length up to what reflects
    it, 0 where nothing does within its range; absent: the gas is that at the mount.
    """

    agent: Name
    sensor: Name
    gases: tuple[GasAmount, ...]
    wind_world_m_s: Vec3
    beam_m: float | None = None


class FieldSamples(Message):
    """True field values at every sensor mount. Written by fields on `truth/samples` every tick. Truth."""

    samples: tuple[MountSample, ...]


class ConcentrationSlice(Record):
    """A horizontal slice of the mixing ratio [ppm]; `mixing_ratio_ppm` is (nx, ny) float32 at cell centres
    `origin_m + (i + 0.5) * cell_m`, at height `height_m`, world frame.
    """

    gas: str
    origin_m: tuple[float, float]
    cell_m: float
    height_m: float
    mixing_ratio_ppm: NumericArray


class FilamentCloud(Message):
    """Filaments and a concentration slice. Written by fields on `truth/filaments` every `gas_every_s`. Truth.

    `position_world_m` (n, 3) and `sigma_m` (n,) are float32; `gas_index` (n,) uint8 counts into `gases`.
    """

    gases: tuple[str, ...]
    position_world_m: NumericArray
    sigma_m: NumericArray
    gas_index: NumericArray
    slices: tuple[ConcentrationSlice, ...] = ()


class CameraImage(Record):
    """A picture with its calibration; part of `Reading` and `CameraFrame`. Since contract 1.1.

    `data` is a file: colours as PNG or JPEG, or (`depth_png`) a PNG of 16-bit depths along the optical axis [mm], 0
    where nothing is in range. A pinhole without distortion: the point of the picture (u, v), right and down from its
    upper left corner [pixels], shows what lies in the direction ((u - centre) / focal, (v - centre) / focal, 1) of the
    optical frame, x right, y down, z ahead, which `quaternion_body_wxyz` turns into the body frame; the eye is at
    `position_body_m`. `taken_tick` is the tick at whose end the picture was taken.
    """

    encoding: Literal["png", "jpeg", "depth_png"]
    width_px: int
    height_px: int
    focal_px: float
    centre_px: tuple[float, float]
    position_body_m: Vec3
    quaternion_body_wxyz: Quaternion
    taken_tick: Tick
    data: bytes


class CameraFrame(Record):
    """What one camera sees; part of `CameraFrames`. Since contract 1.1."""

    agent: Name
    sensor: Name
    image: CameraImage


class CameraFrames(Message):
    """The pictures taken at this tick, often none. Written by cameras on `truth/images` every tick, in runs with
    cameras. Truth. Since contract 1.1.
    """

    frames: tuple[CameraFrame, ...] = ()


class RadioReception(Record):
    """A text that an agent hears: from whom, on which channel, and at the end of which tick it was sent.

    Part of `Observation`. Since contract 1.1.
    """

    sender: Name
    channel: Name
    text: str
    sent_tick: Tick
    to: Name = "all"


class RadioTransmission(Record):
    """What became of a text that was sent at the end of the tick before; part of `RadioTraffic`.

    It is heard by `reached`, after the channel's delay; by `lost` it would have been, but for the channel's losses; the
    other members it was meant for were `out_of_range`. `refusal` says why it was not sent at all.
    """

    sender: Name
    message: RadioMessage
    reached: tuple[Name, ...] = ()
    lost: tuple[Name, ...] = ()
    out_of_range: tuple[Name, ...] = ()
    refusal: str | None = None


class RadioArrival(Record):
    """A text that comes to one agent at this tick; part of `RadioTraffic`."""

    agent: Name
    reception: RadioReception


class RadioTraffic(Message):
    """What is on the air. Written by radio on `truth/radio` every tick, in runs whose scenario has channels. Truth.

    By sender's name, in the order of the sender's command; arrivals by their sending tick first. Since contract 1.1.
    """

    transmissions: tuple[RadioTransmission, ...] = ()
    arrivals: tuple[RadioArrival, ...] = ()


# ---------------------------------------------------------------- what agents see


class ChannelDescription(Record):
    """One channel that an agent may send and hear on, as told in the briefing. Since contract 1.1.

    `members` are all its members, the agent among them; `range_m` is how far it reaches (absent: everywhere); a text
    of at most `max_bytes` in UTF-8 is heard `delay_ticks` after it was sent, if it is not lost.
    """

    name: Name
    members: tuple[Name, ...]
    range_m: float | None
    delay_ticks: int
    max_bytes: int


class SensorDescription(Record):
    """One sensor of the agent's vehicle, as told in the briefing.

    `mount_rpy_rad` (since 1.1) turns the sensor's axes against the body's, by roll, then pitch, then yaw about fixed
    axes. `directions_body` (since 1.1) are the unit directions in which ranges are measured, in the body frame, in the
    order of the ranges: (n, 3) float32 for range finders, (elevations, azimuths, 3) for lidars.
    """

    name: Name
    model: str
    quantity: str
    unit: str
    mount_body_m: Vec3
    mount_rpy_rad: Vec3 = (0.0, 0.0, 0.0)
    directions_body: NumericArray | None = None


class Bounds(Record):
    """An axis-aligned box in the world frame [m]."""

    min_m: Vec3
    max_m: Vec3


class Briefing(Message):
    """What an agent is told once, before its first observation. Written by sensing on `agents/<id>/briefing`.

    `seed` is the agent's own seed for its random draws; `bounds` is the room. `tick` is 0.
    `contract_version` and `contract_hash` (since 1.1) say which contract the run speaks: an agent made for another
    major version should say so and exit. `channels` (since 1.1) are those on which it may talk with other agents.
    `parameters` (since 1.2) are the settings of the method, as the scenario gives them; those it leaves out have the
    method's own values. `known_map`, `plume` and `known_sources` (since 1.2) are there for an agent that the scenario
    grants this knowledge: the map of the room, nominal figures of the plume, and, for upper bounds such as the oracle
    alone, the places of the sources.
    """

    agent: Name
    contract_version: str
    mission: str
    tick_ns: int
    seed: int
    mode: Literal["on_request", "lockstep", "latency"]
    latency_ticks: int
    gas: str
    bounds: Bounds
    search_height_m: float
    hold_s: float
    time_limit_s: float
    sensors: tuple[SensorDescription, ...]
    contract_hash: str = ""
    channels: tuple[ChannelDescription, ...] = ()
    parameters: dict[Name, ParameterValue] = {}  # noqa: RUF012 - pydantic copies it
    known_map: KnownMap | None = None
    plume: NominalPlume | None = None
    known_sources: tuple[Vec3, ...] = ()


class Reading(Record):
    """What one instrument reports: one or several numbers in `unit` (see the sensor's description).

    `is_saturated` says that the instrument is at the end of its range; `is_warming_up` (since 1.1) that it does not
    measure yet, and that its values mean nothing. `array` and `image` (since 1.1) are what does not fit `values`:
    an IMU's samples, a lidar's ranges, a camera's picture. They come when they are new, and again where a command is
    awaited.
    """

    sensor: Name
    quantity: str
    unit: str
    values: tuple[float, ...]
    is_saturated: bool = False
    is_warming_up: bool = False
    array: NumericArray | None = None
    image: CameraImage | None = None


class Observation(Message):
    """All that an agent gets in a tick. Written by sensing on `agents/<id>/observation` every tick, and again on
    `agents/<id>/question` (since 1.2) where it awaits a command: an agent subscribes to one of the two.

    The pose is the vehicle's own estimate. When `awaiting_command` is true, exactly one `Command` with this
    tick is expected in return, and simulated time waits for it. `notice` says why the last command was refused,
    or how it was changed.
    `incoming` (since 1.1) are the texts heard from other agents at this tick, whether or not a command is awaited;
    `radio_refusals` (since 1.1) says of each text sent in the last command that was not put on the air, why.
    """

    agent: Name
    time_s: float
    position_world_m: Vec3
    yaw_rad: float
    velocity_world_m_s: Vec3
    status: str
    awaiting_command: bool
    readings: tuple[Reading, ...]
    notice: str | None = None
    incoming: tuple[RadioReception, ...] = ()
    radio_refusals: tuple[str, ...] = ()

    @property
    def is_question(self) -> bool:
        """Whether the agent is asked."""
        return self.awaiting_command

    def reading(self, sensor: str) -> Reading:
        """Return the reading of the sensor of that name.

        Raises:
            KeyError: the vehicle has no such sensor.
        """
        for reading in self.readings:
            if reading.sensor == sensor:
                return reading
        raise KeyError(f"no sensor {sensor!r}; there are {[r.sensor for r in self.readings]}")


class Ending(Message):
    """Told to an agent when the run is over, on `agents/<id>/ending`: it should exit."""

    reason: str


# ---------------------------------------------------------------- referee


class BeliefScore(Record):
    """How good a belief is, by the truth; part of `AgentScore` and `AgentResult`. Since contract 1.2.

    `expected_distance_m` is the mean distance of the believed places to the nearest source: the earth mover's distance
    of the belief to the truth. `mass_near_frac` is the probability within the success radius of a source,
    `cell_frac` that of the cells that hold one, `entropy_bits` the belief's entropy. Beliefs with two axes are judged
    in the plane.
    """

    expected_distance_m: float
    mass_near_frac: float
    cell_frac: float
    entropy_bits: float


class AgentScore(Record):
    """How one agent stands at this tick; `belief` (since 1.2) judges the last belief that it published, if any."""

    agent: Name
    distance_to_source_m: float
    path_length_m: float
    n_commands: int
    belief: BeliefScore | None = None


class AgentResult(Record):
    """The final figures of one agent; lengths are absent where they have no meaning (no path, no declaration).

    `declared_confidence` (since 1.2) is the highest confidence of its declarations, `belief` (since 1.2) judges the
    last belief that it published.
    """

    name: Name
    success: bool
    outcome: str
    time_to_source_s: float | None
    steps: int
    path_length_m: float
    straight_line_m: float
    shortest_path_m: float | None
    movement_overhead: float | None
    directness: float | None
    final_distance_m: float
    declared_error_m: float | None
    declared_confidence: float | None = None
    belief: BeliefScore | None = None


class RefereeEvent(Record):
    """Something the referee saw at this tick: take-off, first gas contact, collision, declaration, success."""

    agent: Name | None
    kind: str
    text: str


class Score(Message):
    """How all agents stand. Written by referee on `referee/score` every tick.

    `is_final` announces that the verdict of the same tick follows on `referee/verdict` and the run ends.
    """

    agents: tuple[AgentScore, ...]
    events: tuple[RefereeEvent, ...] = ()
    is_final: bool = False

    def announced_ports(self) -> frozenset[str]:
        """Return the verdict port at the tick that ends the run."""
        return frozenset({"referee/verdict"}) if self.is_final else frozenset()


class Verdict(Message):
    """The end of the run and its result; nothing after this tick counts. Written once by referee."""

    end_reason: Literal["success", "time_limit", "collision", "agent_failed", "declared", "out_of_bounds"]
    agents: tuple[AgentResult, ...]
