"""All messages of a run: frozen facts, SI units with the unit in the name, readable in any language.

All are msgpack maps with string keys. Unknown keys are ignored, NaN and infinity are rejected.
In JSON, which the gateway offers too, they are objects with the same keys; bytes are base64 text.
A message belongs to a tick and is valid at the end of that tick, unless its docstring states otherwise.
Frames: *world* is x east, y north, z up, right-handed, origin at the room's inner corner; *body* is x forward,
y left, z up. Quaternions are (w, x, y, z).
"""

from typing import Annotated, Literal, get_args

import msgspec
import numpy as np
from pydantic import AfterValidator, Field, JsonValue, StringConstraints

from gslcosim.base.quantities import Vec3
from gslcosim.contract.record import Message, Name, NumericArray, Record
from gslcosim.contract.record import Quaternion as Quaternion
from gslcosim.contract.record import Tick as Tick

MAX_BELIEF_CELLS = 65_536
# Tolerance of the sum of a belief's probabilities: single precision over many cells.
BELIEF_SUM_TOLERANCE = 1e-3

ParameterScalar = bool | int | float | Annotated[str, StringConstraints(max_length=1000)]
# A parameter of a method: any scalar of YAML, or a list of them.
ParameterValue = ParameterScalar | Annotated[tuple[ParameterScalar, ...], Field(max_length=1000)]
CellSize = Annotated[float, Field(gt=0, le=1000)]
RECORDED_ONLY = {"$comment": "Only the recording reads it: no part of the contract's hash."}
"""Mark in the schema of a field that only the recording reads; strict compilers accept the keyword."""
MAX_NOTE_VALUES = 16
MAX_NOTE_MODE_CHARACTERS = 40
BodyRate = Annotated[float, Field(ge=-50, le=50)]
Angle = Annotated[float, Field(ge=-6.3, le=6.3)]
HoldTime = Annotated[float, Field(ge=0, le=3600)]
CommandKind = Literal[
    "waypoint",
    "hold",
    "noop",
    "declare_source",
    "velocity",
    "failed",
    "mission",
    "take_off",
    "land",
    "attitude",
    "rates",
    "drive",
]
# Required field of a kind of command.
_NEEDED_BY_KIND = {
    "waypoint": "position_world_m",
    "velocity": "velocity_world_m_s",
    "declare_source": "declaration",
    "mission": "waypoints",
    "attitude": "attitude",
    "rates": "rates",
    "drive": "drive",
}
# Prefix of the `reason` of a command that the runtime wrote in place of one that could not be read.
REFUSED_PREFIX = "refused: "
# All kinds that an agent may write; `failed` is the runtime's.
AGENT_KINDS = tuple(kind for kind in get_args(CommandKind) if kind != "failed")


class KnownMap(Record):
    """The map of the room, for an agent that is granted it; part of `Briefing`. Since contract 1.2.

    `occupied` is uint8, 1 where a cell is solid and 0 where it is air, in equal cells of `cell_m` whose first one
    touches the corner `origin_m`; index order (x, y) or (x, y, z). A map with two axes is a horizontal slice: it has
    `height_m`, the height at which the room was cut.
    """

    origin_m: Vec3
    cell_m: CellSize
    occupied: NumericArray
    height_m: float | None = None


class NominalPlume(Record):
    """The nominal figures of the plume, for an agent that is granted them; part of `Briefing`. Since contract 1.2.

    A source releases `puffs_per_s`, together `release_ppm_m3_s` of gas: the integral of the mixing ratio [ppm] over all
    space grows by that much a second. A puff is born with the standard deviation `initial_sigma_m`, its variance grows
    by `growth_m2_s`, and its centre wanders with the eddy diffusivity `diffusivity_m2_s` on each axis. `wind_speed_m_s`
    is the nominal speed of the wind, at the inlet of a room. The position and height of the source are not part of it.
    """

    release_ppm_m3_s: float
    puffs_per_s: float
    initial_sigma_m: float
    growth_m2_s: float
    diffusivity_m2_s: float
    wind_speed_m_s: float


def _check_probability(probability: NumericArray) -> NumericArray:
    if probability.dtype != "float32" or len(probability.shape) not in (2, 3):
        raise ValueError(f"expected float32 with 2 or 3 axes, was {probability.dtype} with {len(probability.shape)}")
    values = probability.to_array()
    if not 1 <= values.size <= MAX_BELIEF_CELLS:
        raise ValueError(f"expected 1 to {MAX_BELIEF_CELLS} cells, was {values.size}")
    if values.min() < 0:
        raise ValueError(f"expected probabilities that are not negative, was {values.min():g}")
    total = float(values.sum(dtype=np.float64))
    if abs(total - 1) > BELIEF_SUM_TOLERANCE:
        raise ValueError(f"expected probabilities whose sum is 1, was {total:.6g}")
    return probability


class Belief(Record):
    """An agent's belief about the source: a probability for each cell; part of `Command`. Since contract 1.2.

    `probability` is float32 of shape (nx, ny) or (nx, ny, nz), none negative, together 1 (within 0.001), at most 65,536
    cells of `cell_m`; the first cell touches the corner `origin_m`. A belief with two axes covers positions in the
    plane, at any height; its `origin_m` has the height at which the agent searches.
    At most one belief per second of simulated time is accepted. It is scored and recorded; no other agent sees it.
    """

    origin_m: Vec3
    cell_m: CellSize
    probability: Annotated[NumericArray, AfterValidator(_check_probability)]


class Note(Record):
    """State of a method, as it reports it; part of `Command`. Since contract 1.2.

    `mode` is its present activity in a word or two of its own, such as `casting`; `values` are numbers that it decides
    by, such as the entropy of its map, at most 16 by name. A note is recorded and nothing else: it is not judged, and
    no other agent sees it.
    """

    mode: Annotated[str, StringConstraints(max_length=MAX_NOTE_MODE_CHARACTERS)] = ""
    values: Annotated[dict[Name, float], Field(max_length=MAX_NOTE_VALUES)] = {}  # noqa: RUF012 - pydantic copies it


class RadioMessage(Record):
    """A text that an agent sends on a channel: to the agent named `to`, or to `all` other members of the channel.

    Its length in UTF-8 is limited by the channel's `max_bytes`; the channel also determines reception and delay. Part
    of `Command`. Since contract 1.1.
    """

    channel: Name
    text: Annotated[str, StringConstraints(max_length=65536)]
    to: Name = "all"


class Declaration(Record):
    """Source position that an agent declares, and its confidence (0 to 1)."""

    position_world_m: Vec3
    confidence: Annotated[float, Field(ge=0, le=1)] = 1.0


class Waypoint(Record):
    """One place of a mission, part of `Command`. Since contract 1.1.

    Without a velocity the vehicle comes to rest there and holds `hold_s`; with one it passes through with velocity
    `velocity_world_m_s` and acceleration `acceleration_world_m_s2`. It arrives `after_s` after the waypoint before
    (absent: as soon as its limits allow), with heading `yaw_rad`, counter-clockwise from world x (absent: unchanged).
    """

    position_world_m: Vec3
    velocity_world_m_s: Vec3 = (0.0, 0.0, 0.0)
    acceleration_world_m_s2: Vec3 = (0.0, 0.0, 0.0)
    hold_s: HoldTime = 0.0
    after_s: Annotated[float, Field(gt=0, le=3600)] | None = None
    yaw_rad: Angle | None = None


class AttitudeSetpoint(Record):
    """Desired attitude of a multirotor, for an agent with its own control; part of `Command`. Since contract 1.1.

    Roll about body x, pitch about body y, yaw about z, applied in the order yaw, pitch, roll from the world frame.
    `thrust_n` is the total thrust of all rotors; absent: as much as keeps the vertical speed at `climb_m_s`.
    """

    roll_rad: Annotated[float, Field(ge=-3.15, le=3.15)] = 0.0
    pitch_rad: Annotated[float, Field(ge=-3.15, le=3.15)] = 0.0
    yaw_rad: Angle = 0.0
    thrust_n: Annotated[float, Field(ge=0)] | None = None
    climb_m_s: float = 0.0


class RateSetpoint(Record):
    """Angular rates of a multirotor about its body axes, for an agent with its own control; part of `Command`.

    `thrust_n` and `climb_m_s` are those of `AttitudeSetpoint`. Since contract 1.1.
    """

    rates_body_rad_s: tuple[BodyRate, BodyRate, BodyRate]
    thrust_n: Annotated[float, Field(ge=0)] | None = None
    climb_m_s: float = 0.0


class DriveSetpoint(Record):
    """Speed along the nose and rate of turn to the left of a vehicle on wheels; part of `Command`.

    The radius of the turn is `speed_m_s` divided by `yaw_rate_rad_s`. Since contract 1.1.
    """

    speed_m_s: float
    yaw_rate_rad_s: float = 0.0


class Command(Message):
    """An agent's answer to the observation of the same `tick`, on `agents/<id>/command`.

    `waypoint` goes to `position_world_m` and holds there `hold_s` (absent: the briefing's);
    `velocity` moves with `velocity_world_m_s` and does not stop for the next command, which is due after
    `hold_s`; at the edge of the room the vehicle stops by itself;
    `hold` stays for `hold_s`; `noop` changes nothing; `declare_source` states `declaration` and holds.
    `failed` is written by the runtime in place of an agent that is gone: no message follows it on this port.
    `contract` (since 1.1) may state in the first command the contract that the agent was made for, as `1.1` or
    `1.1+hash`; the agent's validator reads it and does not pass it on. `outgoing` (since 1.1) are texts for other
    agents, sent with a command of any kind.
    Since 1.1 also: `mission` visits all `waypoints`, after which the next command is due; `take_off` rises from the
    landing place to the briefing's search height; `land` descends, stands and stops its rotors; `attitude` and `rates`
    leave attitude or rates of a multirotor to the agent, and `drive` the speed and turning of a vehicle on wheels: they
    hold until the next command, which is due after `hold_s`.
    With `waypoint`, `velocity` and `hold` the vehicle's heading is `yaw_rad`, counter-clockwise from world x, or along
    its path with `faces_path`; with neither the heading is kept.
    `belief` (since 1.2) publishes the agent's belief about the place of the source, with a command of any kind; at most
    one per second of simulated time is accepted.
    `reason` is a sentence for people: the agent's reason for its decision, in its own words; it is recorded and decides
    nothing. The runtime writes it in two cases: `refused: …` with a `hold` in place of an answer that could not be
    read, and the reason why an agent is gone with `failed`.
    `note` (since 1.2) has the state of the method, with a command of any kind; where it is absent the key is left out.
    """

    kind: CommandKind
    position_world_m: Vec3 | None = None
    hold_s: HoldTime | None = None
    declaration: Declaration | None = None
    reason: Annotated[str, StringConstraints(max_length=500)] = ""
    velocity_world_m_s: Vec3 | None = None
    contract: Annotated[str, StringConstraints(max_length=80)] | None = None
    outgoing: Annotated[tuple[RadioMessage, ...], Field(max_length=16)] = ()
    waypoints: Annotated[tuple[Waypoint, ...], Field(min_length=1, max_length=1000)] | None = None
    attitude: AttitudeSetpoint | None = None
    rates: RateSetpoint | None = None
    drive: DriveSetpoint | None = None
    yaw_rad: Angle | None = None
    faces_path: bool = False
    belief: Belief | None = None
    note: Annotated[Note | None, Field(json_schema_extra={**RECORDED_ONLY})] = None

    @property
    def sent(self) -> "Command":
        """The command as it is encoded: the key of an absent note is left out, as before there were notes."""
        return self if self.note is not None else msgspec.structs.replace(self, note=msgspec.UNSET)

    def check_together(self) -> None:
        """Raise ValueError where the required field of the kind of command is missing."""
        needed = _NEEDED_BY_KIND.get(self.kind)
        if needed is not None and getattr(self, needed) is None:
            raise ValueError(f"a {self.kind} command needs {needed}")

    @classmethod
    def json_schema_extra(cls) -> dict[str, JsonValue]:
        """Return the same rule in keywords of JSON Schema, for validators in other languages."""
        rules: list[JsonValue] = [
            {
                "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
                "then": {"properties": {name: {"not": {"type": "null"}}}, "required": [name]},
            }
            for kind, name in _NEEDED_BY_KIND.items()
        ]
        return {"allOf": rules}

    @property
    def closes_port(self) -> bool:
        """True when no further message follows on this port."""
        return self.kind == "failed"


# ---------------------------------------------------------------- truth, never visible to agents


class BodyState(Record):
    """True state of one vehicle; part of `BodyPoses`.

    `position_world_m` is the origin of the body frame, `quaternion_wxyz` rotates body into world vectors, `contacts`
    names the objects touched during the tick, `phase` is the present activity (`landing` and `driving` since 1.1),
    `awaiting_command` requests the agent's next command, `path_length_m` is the distance travelled so far,
    `waypoint_world_m` is the present goal (absent: none), `tracking_error_m` (since 1.1) is the distance from the
    controller's reference (absent: it follows no path). `rejected_command` is the reason why the last command was
    refused or changed. `planned_path_world_m` (since 1.1) are the bends ahead and the waypoint, where the vehicle
    avoids obstacles.
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
        """Return the command ports of the agents whose command is due at this tick."""
        return frozenset(f"command/{body.agent}" for body in self.bodies if body.awaiting_command)


class GasAmount(Record):
    """True mixing ratio [ppm by volume] of one gas at one place."""

    gas: str
    mixing_ratio_ppm: float


class MountSample(Record):
    """True gas and wind at the mount of one sensor; the wind is that of the air, not relative to the vehicle.

    For an instrument with a beam (since 1.1) `gases` are means along it, and `beam_m` is its length up to the
    reflecting surface, 0 where there is none within its range; absent: the gas is that at the mount.
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

    `position_world_m` (n, 3) and `sigma_m` (n,) are float32; `gas_index` (n,) uint8 indexes `gases`.
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
    upper left corner [pixels], shows the direction ((u - centre) / focal, (v - centre) / focal, 1) of the optical
    frame, x right, y down, z ahead, which `quaternion_body_wxyz` rotates into the body frame; the pinhole is at
    `position_body_m`. The picture was taken at the end of tick `taken_tick`.
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
    """Image of one camera; part of `CameraFrames`. Since contract 1.1."""

    agent: Name
    sensor: Name
    image: CameraImage


class CameraFrames(Message):
    """The pictures taken at this tick, often none. Written by cameras on `truth/images` every tick, in runs with
    cameras. Truth. Since contract 1.1.
    """

    frames: tuple[CameraFrame, ...] = ()


class RadioReception(Record):
    """A text that an agent receives: its sender, its channel, and the tick at whose end it was sent.

    Part of `Observation`. Since contract 1.1.
    """

    sender: Name
    channel: Name
    text: str
    sent_tick: Tick
    to: Name = "all"


class RadioTransmission(Record):
    """Fate of a text that was sent at the end of the tick before; part of `RadioTraffic`.

    Agents in `reached` receive it after the channel's delay; those in `lost` would, but for the channel's losses; the
    other intended receivers were `out_of_range`. `refusal` is the reason why it was not sent at all.
    """

    sender: Name
    message: RadioMessage
    reached: tuple[Name, ...] = ()
    lost: tuple[Name, ...] = ()
    out_of_range: tuple[Name, ...] = ()
    refusal: str | None = None


class RadioArrival(Record):
    """A text that one agent receives at this tick; part of `RadioTraffic`."""

    agent: Name
    reception: RadioReception


class RadioTraffic(Message):
    """Texts on the air. Written by radio on `truth/radio` every tick, in runs whose scenario has channels. Truth.

    Transmissions by sender's name, then as in the command; arrivals by their sending tick first. Since contract 1.1.
    1.1.
    """

    transmissions: tuple[RadioTransmission, ...] = ()
    arrivals: tuple[RadioArrival, ...] = ()


# ---------------------------------------------------------------- what agents see


class ChannelDescription(Record):
    """One channel on which an agent may send and receive; part of `Briefing`. Since contract 1.1.

    `members` are all its members, including the agent; `range_m` is its range (absent: unlimited); a text of at most
    `max_bytes` in UTF-8 arrives `delay_ticks` after it was sent, if it is not lost.
    """

    name: Name
    members: tuple[Name, ...]
    range_m: float | None
    delay_ticks: int
    max_bytes: int


class SensorDescription(Record):
    """One sensor of the agent's vehicle; part of `Briefing`.

    `mount_rpy_rad` (since 1.1) rotates the sensor's axes against the body's, by roll, then pitch, then yaw about fixed
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


class Task(Record):
    """Task of an agent: criterion and limits of success; part of `Briefing`. Since contract 1.3.

    `goal` is the criterion of success: `source` (the vehicle comes near a source), `declaration` (a declared position
    is near one), `all_sources` (the vehicle comes near each), `map` (the last belief is concentrated near one), or the
    name of a criterion of another package.
    `distance_of` names the object that has to be within `success_radius_m` of a source, absent where the criterion of
    another package is not a distance; with `is_horizontal` heights do not count in that distance. Of a belief at least
    `mass_at_least` has to be within the radius (absent: no belief is required).
    `time_limit_s` is simulated time, and `command_limit` the number of commands (absent: no limit).
    `asks_for_declaration` is true where an agent that declares no position cannot succeed.
    `n_sources` is the number of sources to be found (absent: all; their number is not given).
    """

    goal: str
    success_radius_m: Annotated[float, Field(gt=0)]
    time_limit_s: Annotated[float, Field(gt=0)]
    distance_of: Literal["vehicle", "declaration", "belief"] | None = None
    is_horizontal: bool = False
    mass_at_least: Annotated[float, Field(gt=0, le=1)] | None = None
    command_limit: Annotated[int, Field(ge=1)] | None = None
    asks_for_declaration: bool = False
    n_sources: Annotated[int, Field(ge=1)] | None = 1


class Briefing(Message):
    """Task and sensors of an agent, once before its first observation, by sensing on `agents/<id>/briefing`.

    `seed` is the agent's own seed for its random draws; `bounds` is the room. `tick` is 0.
    `contract_version` and `contract_hash` (since 1.1) identify the contract of the run: an agent made for another major
    version should report it and exit. `channels` (since 1.1) are those on which it may communicate with other agents.
    `parameters` (since 1.2) are the settings of the method in the scenario; those it leaves out have the method's own
    values. `known_map`, `plume` and `known_sources` (since 1.2) are there for an agent that the scenario grants this
    knowledge: the map of the room, nominal figures of the plume, and, only for upper bounds such as the oracle, the
    positions of the sources.
    `task` (since 1.3) is the agent's task, absent in runs of older contracts and where nothing is judged; `mission` is
    the same as a sentence for people.
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
    task: Task | None = None


class Reading(Record):
    """Output of one instrument: one or several numbers in `unit` (see the sensor's description).

    `is_saturated` means that the instrument is at the end of its range; `is_warming_up` (since 1.1) that it does not
    measure yet, and that its values have no meaning. `array` and `image` (since 1.1) hold data that does not fit
    `values`: an IMU's samples, a lidar's ranges, a camera's picture. They are present when they are new, and again
    where a command is awaited.
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

    The pose is the vehicle's own estimate. `status` is the vehicle's present activity: `on_ground`, `taking_off`,
    `flying`, `driving`, `holding`, `landing` or `failed`, as the phases of `BodyState`; more may be added, so that
    agents should treat an unknown word as `flying`.
    When `awaiting_command` is true, exactly one `Command` with this tick is expected in return, and simulated time
    waits for it. `notice` is the reason why the last command was refused, or how it was changed.
    `incoming` (since 1.1) are the texts received from other agents at this tick, whether or not a command is awaited;
    `radio_refusals` (since 1.1) has the reason for each text of the last command that was not transmitted.
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
        """True when a command of the agent is awaited."""
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
    """End of the run, sent to an agent on `agents/<id>/ending`: it should exit."""

    reason: str


# ---------------------------------------------------------------- referee


class BeliefScore(Record):
    """Quality of a belief, measured against the truth; part of `AgentScore` and `AgentResult`. Since contract 1.2.

    `expected_distance_m` is the belief's mean distance to the nearest source: the earth mover's distance of the belief
    to the truth. `mass_near_frac` is the probability within the success radius of a source, `cell_frac` that of the
    cells that hold one, `entropy_bits` the belief's entropy. Beliefs with two axes are judged in the plane.
    """

    expected_distance_m: float
    mass_near_frac: float
    cell_frac: float
    entropy_bits: float


class AgentScore(Record):
    """Standing of one agent at this tick; `belief` (since 1.2) judges the last belief that it published, if any."""

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
    """An event that the referee detected at this tick: take-off, first gas contact, collision, declaration, success."""

    agent: Name | None
    kind: str
    text: str


class Score(Message):
    """Standing of all agents. Written by referee on `referee/score` every tick.

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
