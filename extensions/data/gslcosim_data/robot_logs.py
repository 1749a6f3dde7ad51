"""Logs of real robots as runs, scored by our referee and recorded with our views."""

import hashlib
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gslcosim.base.errors import UsageError
from gslcosim.base.files import list_files, read_regular_file
from gslcosim.base.frames import yaw_from_quaternion
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import ESTIMATE_QUANTITY
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
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.model import Grid
from gslcosim.environment.positions import draw_positions
from gslcosim.environment.store import load_environment
from gslcosim.runtime.digest import HashChain, RunDigest
from gslcosim.runtime.outcome import RunOutcome
from gslcosim.runtime.replay.past_run import IMPORTED_FROM
from gslcosim.runtime.run import OpenRun, RunPlan
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunResult
from gslcosim.scenario import Scenario, load_scenario
from gslcosim.scenario.checks.registry import list_scenario_checks
from gslcosim.scenario.loader import LoadedScenario
from gslcosim_data.log_values import Floats, LoggedSensor, LoggedValues, RobotLog, list_parts
from gslcosim_services.recorder.core import RecorderCore
from gslcosim_services.referee.core import RefereeCore
from gslcosim_services.sensing.briefing import describe_sensors

# Longer gaps are a clock that was set, or times in another unit [s].
_LONGEST_GAP_S = 3600.0
# From here on a gap is remarked on [s].
_LONG_GAP_S = 10.0
# Instruments start a little before the pose and end a little after it [s].
_MARGIN_S = 1.0
# Clocks that are not even have two readings in a tick now and then.
_MOST_PER_TICK = 1.2
# A vehicle that is faster, and farther than a metre away, has jumped [m/s].
_GREATEST_SPEED_M_S = 50.0


# A finished flight is not started again: its programs may be elsewhere, and no event takes place.
_WITHOUT_PROGRAMS = ("agents[0].start={attach: true}", "participants=[]", "services=[]", "events=[]")


def load_log_scenario(source: str, overrides: Sequence[str]) -> LoadedScenario:
    """Read the scenario of a log; its room, source and sensors are checked, and neither method nor start."""
    checks = list_scenario_checks("room", without=("stored gas",))

    def find_room_problems(scenario: Scenario, directory: Path) -> Iterator[Problem]:
        found = (problem for check in checks for problem in check(scenario, directory))
        return (problem for problem in found if not problem.where.startswith("agents"))

    overrides = (*overrides, *_WITHOUT_PROGRAMS)
    return load_scenario(source, overrides=overrides, checks=(find_room_problems,), placer=draw_positions)


def import_log(
    log: RobotLog, source: Path, loaded: LoadedScenario, runs_dir: Path, *, remark: Callable[[str], None]
) -> RunResult:
    """Make a run of a log.

    The log's first pose is at tick 0; between its poses the vehicle is on the straight line. Readings stand until the
    next. The truth about gas and wind is not known, and nothing of it is recorded. The run ends with the log, or
    before, where the referee sees success; collisions are not judged.

    Args:
        source: The file it comes from; the manifest has its name and hash.
        loaded: Room, source, vehicle and sensors; its agent is not started.
        remark: Receives what was left out of the log or assumed, sentence by sentence; the manifest has it, too.
    """
    scenario = _scenario_of(log, loaded.scenario, source)
    environment_dir = prepare_environment(scenario, scenario_dir=loaded.directory)
    remarks = [
        *log.remarks,
        *_remarks_on_poses(log),
        *_remarks_on_readings(log, scenario),
        *_remarks_on_room(log, load_environment(environment_dir).grid),
    ]
    for text in remarks:
        remark(f"{source}: {text}")

    sha = hashlib.sha256()
    for path in list_files(source) if source.is_dir() else [source]:
        sha.update(read_regular_file(path))
    plan = RunPlan(
        scenario=scenario,
        environment_dir=environment_dir,
        runs_dir=runs_dir,
        directory=loaded.directory,
        processes="one",
        began=time.perf_counter(),
        origin={IMPORTED_FROM: {"file": source.name, "sha256": sha.hexdigest(), "remarks": remarks}},
    )
    with OpenRun(plan, lambda _: None) as run:
        run.outcome = _Retold(log, run.prepare()).outcome()
    return run.result


def log_sensors(scenario: Scenario) -> tuple[LoggedSensor, ...]:
    """Return the sensors of a scenario's only agent."""
    if len(scenario.agents) != 1:
        raise UsageError(f"--scenario: expected one agent, was {len(scenario.agents)} in {scenario.name}.")
    return tuple(
        LoggedSensor(name=one.name, parts=list_parts(one), is_estimate=one.quantity == ESTIMATE_QUANTITY)
        for one in describe_sensors(scenario.agents[0], scenario)
    )


def _scenario_of(log: RobotLog, scenario: Scenario, source: Path) -> Scenario:
    if len(log.time_s) < 2:
        raise UsageError(f"{source}: expected poses at two times or more, was {len(log.time_s)}.")
    gaps_s = np.diff(log.time_s)
    if gaps_s.max() > _LONGEST_GAP_S:
        i = int(np.argmax(gaps_s))
        raise UsageError(
            f"{source}: expected poses at most {_LONGEST_GAP_S:g} s apart, {log.time_s[i + 1]:.9g} s follows "
            f"{log.time_s[i]:.9g} s. Give times in seconds, and import what is before and after a jump of the clock as "
            "two logs."
        )
    lasted_s = float(log.time_s[-1] - log.time_s[0])
    n_ticks = max(1, math.floor(lasted_s * NS_PER_S / scenario.tick_ns))
    limit_s = seconds_from_ticks(n_ticks, scenario.tick_ns)
    stop = scenario.referee.stop.model_copy(update={"time_limit_s": limit_s, "on_collision": False})
    return scenario.model_copy(
        update={
            "referee": scenario.referee.model_copy(update={"stop": stop}),
            "recording": scenario.recording.model_copy(update={"enabled": True}),
        }
    )


def _remarks_on_poses(log: RobotLog) -> Iterator[str]:
    gaps_s = np.diff(log.time_s)
    steps_m = np.linalg.norm(np.diff(log.position_world_m, axis=0), axis=1)
    if gaps_s.max() > _LONG_GAP_S:
        i = int(np.argmax(gaps_s))
        yield f"no pose in the {gaps_s[i]:.1f} s after {log.time_s[i]:.9g} s; the vehicle is on a straight line there."
    is_jump = (steps_m > 1.0) & (steps_m > _GREATEST_SPEED_M_S * gaps_s)
    if is_jump.any():
        i = int(np.argmax(is_jump))
        yield (
            f"{is_jump.sum()} of {len(is_jump)} steps between poses are jumps; the first is {steps_m[i]:.1f} m in "
            f"{gaps_s[i]:.3g} s after {log.time_s[i]:.9g} s. The path length includes it."
        )


def _remarks_on_readings(log: RobotLog, scenario: Scenario) -> Iterator[str]:
    begin_s, end_s, tick_s = log.time_s[0], log.time_s[-1], seconds_from_ticks(1, scenario.tick_ns)
    for name, one in log.instruments.items():
        n_outside = int(np.sum((one.time_s < begin_s - _MARGIN_S) | (one.time_s > end_s + _MARGIN_S)))
        if n_outside:
            yield (
                f"{name}: {n_outside} of {len(one.time_s)} readings are before the first pose or after the last, and "
                "are left out."
            )
        n_ticks = len(np.unique(np.ceil((one.time_s - begin_s) / tick_s - 1e-3)))
        if len(one.time_s) > _MOST_PER_TICK * n_ticks:
            yield (
                f"{name}: {len(one.time_s)} readings in {n_ticks} ticks; the last of each tick is kept. A smaller "
                f"tick_ms than {1e3 * tick_s:g} keeps more."
            )


def _remarks_on_room(log: RobotLog, grid: Grid) -> Iterator[str]:
    places_m = log.position_world_m
    is_outside = np.array(((places_m < grid.origin_m) | (places_m > grid.max_m)).any(axis=1))
    if is_outside.any():
        i = int(np.argmax(is_outside))
        place = ", ".join(f"{part:.2f}" for part in log.position_world_m[i])
        yield (
            f"{is_outside.sum()} of {len(is_outside)} poses are outside the room; the first is ({place}) m at "
            f"{log.time_s[i]:.9g} s. Poses are expected in metres in the frame of the room; the run ends "
            "where the vehicle leaves it."
        )


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
    values = logged.values[i].tolist() if logged is not None and is_there else [0.0] * len(list_parts(sensor))
    return Reading(
        sensor=sensor.name,
        quantity=sensor.quantity,
        unit=sensor.unit,
        values=tuple(values),
        is_warming_up=not is_there,
    )
