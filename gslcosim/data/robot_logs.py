"""Logs of real robots as runs, scored by our referee and recorded with our views."""

import hashlib
import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.files import open_regular_file
from gslcosim.base.frames import quaternion_from_yaw, yaw_from_quaternion
from gslcosim.base.ticks import NS_PER_S, seconds_from_ticks
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import (
    BodyPoses,
    BodyState,
    FieldSamples,
    Message,
    Observation,
    Reading,
    SensorDescription,
    Verdict,
)
from gslcosim.contract.participant import Inbox
from gslcosim.environment.generation import prepare_environment
from gslcosim.ros.types import REMEDY, RosTypes, ros_types
from gslcosim.runtime.digest import HashChain, RunDigest
from gslcosim.runtime.outcome import RunOutcome
from gslcosim.runtime.replay.past_run import IMPORTED_FROM
from gslcosim.runtime.run import run_into_directory
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunResult, RunStatus
from gslcosim.scenario import Scenario
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim_services.recorder.core import RecorderCore
from gslcosim_services.referee.core import RefereeCore
from gslcosim_services.sensing.briefing import describe_sensors

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LoggedValues:
    """Values of an instrument: (n,) times, ascending [s], and (n, k) values in the unit of its readings."""

    time_s: Floats
    values: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLog:
    """The poses of one vehicle and what its instruments said, by the clock of the log.

    Attributes:
        time_s: (n,) times of the poses, ascending [s].
        position_world_m: (n, 3) [m].
        quaternion_wxyz: (n, 4) world from body, unit length.
        instruments: By the sensor's name in the scenario.
    """

    time_s: Floats
    position_world_m: Floats
    quaternion_wxyz: Floats
    instruments: Mapping[str, LoggedValues] = field(default_factory=dict[str, LoggedValues])


# How many numbers a reading has, by its unit in the sensor's description; others have one.
_N_VALUES = {"m/s, rad": 2, "m/s": 3, "m/s^2, rad/s": 6, "m, m/s": 6, "m, 1, m/s": 10, "uT": 3}


def count_values(unit: str) -> int:
    """Return the number of values in a reading of an instrument with that unit."""
    return _N_VALUES.get(unit, 1)


_TIME = "time_s"
_PLACE = ("x_m", "y_m", "z_m")
_TURN = ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z")
_YAW = "yaw_rad"


def read_csv_log(path: Path, sensors: Mapping[str, str]) -> RobotLog:
    """Read a log.

    Columns are `time_s`, `x_m`, `y_m`, `z_m`; `yaw_rad` or `quaternion_w` … `quaternion_z`, else it looks along x; and
    for each sensor those whose names begin with its name and an underscore, as many as its readings have numbers, in
    the order of these. A row without a number in a sensor's columns has no reading of it.

    Args:
        path: The file.
        sensors: By the sensors' names the units of their readings.

    Raises:
        UsageError: it cannot be read, a column is missing, or times do not ascend.
    """
    try:
        table = pyarrow.csv.read_csv(path)
    except (OSError, pa.ArrowException) as error:
        raise UsageError(f"{path}: expected a table of comma-separated values, {error}") from error
    columns = {name: _numbers(table, name, path) for name in table.column_names if _is_wanted(name, sensors)}
    missing = [name for name in (_TIME, *_PLACE) if name not in columns]
    if missing:
        raise UsageError(
            f"{path}: expected columns {', '.join((_TIME, *_PLACE))}, lacks {', '.join(missing)}. "
            f"It has {', '.join(table.column_names)}."
        )
    time_s, place_m = columns[_TIME], np.column_stack([columns[name] for name in _PLACE])
    is_placed = np.isfinite(time_s) & np.isfinite(place_m).all(axis=1)
    return RobotLog(
        time_s=time_s[is_placed],
        position_world_m=place_m[is_placed],
        quaternion_wxyz=_turns(columns, path)[is_placed],
        instruments={
            name: logged
            for name, unit in sensors.items()
            if (logged := _logged_column(columns, time_s, name, count_values(unit), path)) is not None
        },
    )


def _is_wanted(name: str, sensors: Mapping[str, str]) -> bool:
    is_pose = name in (_TIME, _YAW, *_PLACE, *_TURN)
    return is_pose or any(name.startswith(f"{sensor}_") for sensor in sensors)


def _numbers(table: pa.Table, name: str, path: Path) -> Floats:
    try:
        return table.column(name).cast(pa.float64()).to_numpy().astype(np.float64)
    except pa.ArrowException as error:
        raise UsageError(f"{path}: {name}: expected numbers, {error}") from error


def _turns(columns: Mapping[str, Floats], path: Path) -> Floats:
    n_rows = len(columns[_TIME])
    if all(name in columns for name in _TURN):
        turns = np.column_stack([columns[name] for name in _TURN])
        lengths = np.linalg.norm(turns, axis=1, keepdims=True)
        if not np.all(lengths[np.isfinite(lengths)] > 0):
            raise UsageError(f"{path}: quaternion_w …: expected attitudes, was 0, 0, 0, 0 somewhere.")
        return turns / lengths
    return quaternion_from_yaw(columns.get(_YAW, np.zeros(n_rows)))


def _logged_column(
    columns: Mapping[str, Floats], time_s: Floats, sensor: str, n_values: int, path: Path
) -> LoggedValues | None:
    own = [name for name in columns if name.startswith(f"{sensor}_")]
    if not own:
        return None
    if len(own) < n_values:
        raise UsageError(
            f"{path}: {sensor}: expected {n_values} columns that begin with {sensor}_, found {', '.join(own)}."
        )
    values = np.column_stack([columns[name] for name in own[:n_values]])
    is_there = np.isfinite(time_s) & np.isfinite(values).all(axis=1)
    return LoggedValues(time_s=time_s[is_there], values=values[is_there])


_NS = 1e-9
# What has a pose, in the order in which it is chosen where nobody says which.
_POSES: dict[str, Callable[[Any], Any]] = {
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
}
_MICROTESLA = 1e6
_VALUES: dict[str, Callable[[Any], tuple[float, ...]]] = {
    "olfaction_msgs/msg/GasSensor": lambda m: (m.raw,),
    "olfaction_msgs/msg/Anemometer": lambda m: (m.wind_speed, m.wind_direction),
    "std_msgs/msg/Float32": lambda m: (m.data,),
    "std_msgs/msg/Float64": lambda m: (m.data,),
    "sensor_msgs/msg/FluidPressure": lambda m: (m.fluid_pressure,),
    "sensor_msgs/msg/Range": lambda m: (m.range,),
    "sensor_msgs/msg/MagneticField": lambda m: tuple(
        _MICROTESLA * part for part in (m.magnetic_field.x, m.magnetic_field.y, m.magnetic_field.z)
    ),
    "sensor_msgs/msg/Imu": lambda m: (
        m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z,
        m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z,
    ),
}  # fmt: skip


def read_bag_log(
    path: Path, sensors: Mapping[str, str], *, pose_topic: str | None = None, topics: Mapping[str, str] | None = None
) -> RobotLog:
    """Read a log.

    Args:
        path: A folder of rosbag2, a `.bag` of ROS 1, or an `.mcap` with messages of ROS 2.
        sensors: By the sensors' names the units of their readings.
        pose_topic: Which topic has the pose; absent: the only one with poses, Odometry first.
        topics: By the sensors' names their topics; absent ones have the topic whose last part is their name.

    Raises:
        UsageError: the extra `ros` is not installed, it cannot be read, or a topic is missing or of a type that
            cannot be used.
    """
    types = ros_types()
    kinds: dict[str, str] = {}
    found: dict[str, list[tuple[float, Any]]] = defaultdict(list)
    for topic, kind, time_ns, message in _messages(path, types):
        kinds[topic] = kind
        found[topic].append((time_ns * _NS, message))
    pose_topic = _pose_topic(kinds, pose_topic, path)
    poses = [(time_s, _POSES[kinds[pose_topic]](message)) for time_s, message in found[pose_topic]]
    places = [(pose.position.x, pose.position.y, pose.position.z) for _, pose in poses]
    turns = np.array([(q.w, q.x, q.y, q.z) for q in (pose.orientation for _, pose in poses)], dtype=np.float64)
    # Nodes that know no attitude leave it empty.
    turns[np.linalg.norm(turns, axis=1) == 0] = (1, 0, 0, 0)
    by_sensor = _topics_of(sensors, kinds, topics or {}, path)
    return RobotLog(
        time_s=np.array([time_s for time_s, _ in poses]),
        position_world_m=np.array(places, dtype=np.float64),
        quaternion_wxyz=turns / np.linalg.norm(turns, axis=1, keepdims=True),
        instruments={
            sensor: _logged(found[topic], kinds[topic], sensors[sensor], sensor, topic)
            for sensor, topic in by_sensor.items()
        },
    )


def _messages(path: Path, types: RosTypes) -> Iterator[tuple[str, str, int, Any]]:
    if path.suffix == ".mcap":
        yield from _of_mcap(path, types)
        return
    from rosbags.highlevel import AnyReader

    try:
        with AnyReader([path], default_typestore=types.store) as bag:
            wanted = [c for c in bag.connections if c.msgtype in _POSES or c.msgtype in _VALUES]
            for connection, time_ns, data in bag.messages(connections=wanted):
                yield connection.topic, connection.msgtype, time_ns, bag.deserialize(data, connection.msgtype)
    # Of a reader that has an error for each part of a file, and not for all of them.
    except Exception as error:
        raise UsageError(f"{path}: expected a bag of ROS, was something else ({error}).") from error


def _of_mcap(path: Path, types: RosTypes) -> Iterator[tuple[str, str, int, Any]]:
    try:
        from mcap.reader import make_reader
    except ImportError as error:
        raise UsageError(f"mcap: expected the package, found none. Install it with: {REMEDY}") from error
    try:
        with open_regular_file(path) as file:
            for schema, channel, message in make_reader(file).iter_messages():
                if schema is not None and (schema.name in _POSES or schema.name in _VALUES):
                    content = types.store.deserialize_cdr(message.data, schema.name)
                    yield channel.topic, schema.name, message.log_time, content
    except Exception as error:
        raise UsageError(f"{path}: expected an MCAP file, was something else ({error}).") from error


def _pose_topic(kinds: Mapping[str, str], wanted: str | None, path: Path) -> str:
    posed = {topic: kind for topic, kind in kinds.items() if kind in _POSES}
    if wanted is not None:
        if wanted not in posed:
            raise UsageError(f"--pose {wanted}: expected one of {', '.join(sorted(posed)) or 'none'} in {path}.")
        return wanted
    for kind in _POSES:
        some = sorted(topic for topic, its_kind in posed.items() if its_kind == kind)
        if len(some) == 1:
            return some[0]
        if some:
            raise UsageError(f"{path}: expected one topic with {kind}, found {', '.join(some)}. Say which with --pose.")
    raise UsageError(f"{path}: expected a topic with poses ({', '.join(_POSES)}), found none.")


def _topics_of(
    sensors: Mapping[str, str], kinds: Mapping[str, str], given: Mapping[str, str], path: Path
) -> dict[str, str]:
    unknown = [name for name in given if name not in sensors]
    if unknown:
        raise UsageError(f"--topic {unknown[0]}: expected one of the sensors {', '.join(sensors)}.")
    usable = {topic for topic, kind in kinds.items() if kind in _VALUES}
    for sensor, topic in given.items():
        if topic not in usable:
            raise UsageError(
                f"--topic {sensor}={topic}: expected one of {', '.join(sorted(usable)) or 'none'} in {path}."
            )
    return {**_guessed(sensors, usable), **given}


# By their names; true values of our own bags are no readings.
def _guessed(sensors: Mapping[str, str], usable: Set[str]) -> dict[str, str]:
    fitting = {
        sensor: [topic for topic in usable if topic.endswith(f"/{sensor}") and not topic.startswith("/truth/")]
        for sensor in sensors
    }
    return {sensor: topics[0] for sensor, topics in fitting.items() if len(topics) == 1}


def _logged(messages: list[tuple[float, Any]], kind: str, unit: str, sensor: str, topic: str) -> LoggedValues:
    values = np.array([_VALUES[kind](message) for _, message in messages], dtype=np.float64)
    if values.shape[1] != count_values(unit):
        raise UsageError(
            f"--topic {sensor}={topic}: expected {count_values(unit)} numbers in {unit}, {kind} has {values.shape[1]}."
        )
    return LoggedValues(time_s=np.array([time_s for time_s, _ in messages]), values=values)


def import_log(log: RobotLog, source: Path, loaded: LoadedScenario, runs_dir: Path) -> RunResult:
    """Make a run of a log.

    The log's first pose is at tick 0; between its poses the vehicle is on the straight line. Readings stand until the
    next. The truth about gas and wind is not known, and nothing of it is recorded. The run ends with the log, or
    before, where the referee sees success; collisions are not judged.

    Args:
        log: What was run.
        source: The file it comes from; the manifest has its name and hash.
        loaded: Room, source, vehicle and sensors; its only agent is who flew.
        runs_dir: Where the run's folder is made.

    Raises:
        UsageError: the scenario has several agents, or the log is too short, goes back in time or has numbers that are
            none.
        MachineError: the folder cannot be made.
    """
    scenario = _scenario_of(log, loaded.scenario, source)
    environment_dir = prepare_environment(scenario, scenario_dir=loaded.directory)

    def fly_it(setup: RunSetup, report: object) -> RunOutcome:
        del report
        return _Retold(log, setup).outcome()

    def ignored(_: RunStatus) -> None:
        return

    _, result = run_into_directory(
        scenario,
        environment_dir,
        fly_it,
        runs_dir=runs_dir,
        processes="one",
        began=time.perf_counter(),
        report=ignored,
        directory=loaded.directory,
        origin={IMPORTED_FROM: {"file": source.name, "sha256": _hash_of(source)}},
    )
    return result


def log_sensors(scenario: Scenario) -> dict[str, str]:
    """Return the sensors of a scenario's only agent by name, with the units of their readings.

    Raises:
        UsageError: it has several agents.
    """
    if len(scenario.agents) != 1:
        raise UsageError(f"--scenario: expected one agent, was {len(scenario.agents)} in {scenario.name}.")
    return {sensor.name: sensor.unit for sensor in describe_sensors(scenario.agents[0], scenario)}


def _scenario_of(log: RobotLog, scenario: Scenario, source: Path) -> Scenario:
    log_sensors(scenario)
    if len(log.time_s) < 2:
        raise UsageError(f"{source}: expected poses at two times or more, was {len(log.time_s)}.")
    for name, times_s in {"poses": log.time_s, **{n: one.time_s for n, one in log.instruments.items()}}.items():
        if np.any(np.diff(times_s) < 0):
            at = int(np.argmax(np.diff(times_s) < 0))
            raise UsageError(
                f"{source}: {name}: expected times that ascend, {times_s[at + 1]:g} s follows {times_s[at]:g} s."
            )
    if not (np.isfinite(log.position_world_m).all() and np.isfinite(log.quaternion_wxyz).all()):
        raise UsageError(f"{source}: expected places and attitudes of finite numbers, was NaN or infinity somewhere.")
    lasted_s = float(log.time_s[-1] - log.time_s[0])
    n_ticks = max(1, math.floor(lasted_s * NS_PER_S / scenario.tick_ns))
    limit_s = seconds_from_ticks(n_ticks, scenario.tick_ns)
    stop = scenario.referee.stop.model_copy(update={"time_limit_s": limit_s, "on_collision": False})
    # Who flew is nobody that could be started.
    (agent,) = scenario.agents
    flown = agent.model_copy(update={"start": StartSpec(attach=True)})
    return scenario.model_copy(
        update={
            "agents": (flown,),
            "referee": scenario.referee.model_copy(update={"stop": stop}),
            "recording": scenario.recording.model_copy(update={"enabled": True}),
        }
    )


def _hash_of(source: Path) -> str:
    sha = hashlib.sha256()
    files = sorted(path for path in source.rglob("*") if path.is_file()) if source.is_dir() else [source]
    for path in files:
        sha.update(path.read_bytes())
    return sha.hexdigest()


@dataclass
class _Retold:
    """A log replayed as the messages of a run."""

    log: RobotLog
    setup: RunSetup

    def outcome(self) -> RunOutcome:
        """Send it to referee and recorder, and return what has come of it."""
        setup, scenario = self.setup, self.setup.scenario
        referee = RefereeCore(scenario, setup.environment)
        recorder = RecorderCore(scenario, setup.environment, setup.run_dir.recording)
        trails: dict[str, HashChain] = {}
        writers: dict[str, str] = {}
        began = time.perf_counter()
        setup.run_dir.replace(setup.run_dir.inputs.name, "")
        for core in (referee, recorder):
            core.reset(setup.episode)
        verdict: Verdict | None = None
        tick, path_m = 0, 0.0
        try:
            while verdict is None:
                inbox, path_m = self._build_inbox(tick, path_m)
                judged = referee.step(tick, inbox)
                verdict = judged.get(keys.VERDICT)  # type: ignore[assignment]
                recorder.step(tick, {**inbox, **judged})
                for port, message in {**inbox, **judged}.items():
                    trails.setdefault(port, HashChain()).append(message.tick, codec.encode(message))
                    writers[port] = "referee" if port in judged else "log"
                tick += 1
        finally:
            recorder.close()
        return RunOutcome(
            ticks_flown=verdict.tick,
            flight_wall_s=time.perf_counter() - began,
            verdict=verdict,
            digest=RunDigest.of(trails, writers, verdict.tick),
        )

    def _build_inbox(self, tick: int, path_m: float) -> tuple[Inbox, float]:
        agent, tick_ns = self.setup.scenario.agents[0], self.setup.scenario.tick_ns
        time_s = float(self.log.time_s[0]) + seconds_from_ticks(tick, tick_ns)
        before_m, here_m = self._place(time_s - seconds_from_ticks(1, tick_ns)), self._place(time_s)
        path_m += float(np.linalg.norm(here_m - before_m)) if tick else 0.0
        velocity = (here_m - before_m) / seconds_from_ticks(1, tick_ns)
        turn = self._turn(time_s)
        x, y, z = here_m.tolist()
        u, v, w = velocity.tolist()
        body = BodyState(
            agent=agent.name,
            position_world_m=(x, y, z),
            quaternion_wxyz=turn,
            velocity_world_m_s=(u, v, w),
            angular_velocity_body_rad_s=(0.0, 0.0, 0.0),
            phase="driving" if agent.vehicle.drives else "flying",
            awaiting_command=False,
            path_length_m=path_m,
        )
        observation = Observation(
            tick=tick,
            agent=agent.name,
            time_s=seconds_from_ticks(tick, tick_ns),
            position_world_m=(x, y, z),
            yaw_rad=yaw_from_quaternion(turn),
            velocity_world_m_s=(u, v, w),
            status="flown elsewhere",
            awaiting_command=False,
            readings=tuple(self._readings(time_s)),
        )
        inbox: dict[str, Message] = {
            keys.BODIES: BodyPoses(tick=tick, bodies=(body,)),
            keys.SAMPLES: FieldSamples(tick=tick, samples=()),
            keys.observation(agent.name): observation,
        }
        return inbox, path_m

    def _place(self, time_s: float) -> Floats:
        log = self.log
        return np.array([np.interp(time_s, log.time_s, log.position_world_m[:, axis]) for axis in range(3)])

    # The attitude that was logged last.
    def _turn(self, time_s: float) -> tuple[float, float, float, float]:
        i = max(int(np.searchsorted(self.log.time_s, time_s + 1e-9, side="right")) - 1, 0)
        w, x, y, z = self.log.quaternion_wxyz[i].tolist()
        return w, x, y, z

    def _readings(self, time_s: float) -> list[Reading]:
        scenario = self.setup.scenario
        return [
            _reading(sensor, self.log.instruments.get(sensor.name), time_s)
            for sensor in describe_sensors(scenario.agents[0], scenario)
        ]


# Before the first, and of an instrument that was not logged, there is none.
def _reading(sensor: SensorDescription, logged: LoggedValues | None, time_s: float) -> Reading:
    i = -1 if logged is None else int(np.searchsorted(logged.time_s, time_s + 1e-9, side="right")) - 1
    is_there = logged is not None and i >= 0
    values = logged.values[i].tolist() if logged is not None and is_there else [0.0] * count_values(sensor.unit)
    return Reading(
        sensor=sensor.name,
        quantity=sensor.quantity,
        unit=sensor.unit,
        values=tuple(values),
        is_warming_up=not is_there,
    )
