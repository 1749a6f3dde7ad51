"""Agents on logs: programs that fly in scenarios replay a log of masts as observations, and their answers are claims.

An agent with one gas sensor is shown each event as a patrol: its vehicle goes from mast to mast by itself, and reads at
each what that mast has read on average. One whose card asks for several gas sensors carries all masts: it gets
the whole log, a row an observation, and finds the events itself.
"""

import math
import queue
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.bundled import AGENT_FILE, CARD_FILE, PROGRAM_ENDINGS, bundled_agents, bundled_suites
from gslcosim.base.errors import SimulationFault, UsageError
from gslcosim.base.files import ScratchFolder, list_files
from gslcosim.base.ticks import NS_PER_S
from gslcosim.contract import codec
from gslcosim.contract.messages import (
    Bounds,
    Briefing,
    Command,
    Ending,
    KnownMap,
    Observation,
    Reading,
    SensorDescription,
    Vec3,
)
from gslcosim.contract.participant import get_agent_participant
from gslcosim.contract.record import NumericArray
from gslcosim.contract.version import CONTRACT_HASH, CONTRACT_VERSION
from gslcosim.methods.card import WIND_QUANTITY, MethodCard
from gslcosim.runtime.agents.gateway_transport import GatewayAgents
from gslcosim.runtime.agents.loader import find_python_agent, load_python_agent
from gslcosim.runtime.agents.session import AgentEvent, AgentSession, AgentTransport, ObjectTransport
from gslcosim.runtime.agents.validator import CommandValidator
from gslcosim.runtime.network import Network
from gslcosim.runtime.processes.sandbox.selection import describe_sandboxes
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.stepper import SentMessage
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.problems import did_you_mean
from gslcosim_bench.cases.agent_setup import find_card, find_program, resolve_start
from gslcosim_bench.cases.models import EntrySpec
from gslcosim_bench.cases.suite_files import load_suite
from gslcosim_search.beliefs import CellGrid, mean_of_best_m, normalised
from gslcosim_search.fixed_sensors.events import Excess, LeakEvent
from gslcosim_search.fixed_sensors.puff_response import WindRecord
from gslcosim_validation.gas_models import build_gas_scenario, open_field
from gslcosim_validation.measured_suite.estimators import (
    AVERAGE_S,
    Claim,
    Entry,
    EventEstimator,
    HindsightEstimator,
    area_about,
    is_network,
    split_into_blocks,
)
from gslcosim_validation.measured_suite.logs import LogSite, MeasuredLog

Floats = NDArray[np.float64]

GAS = "methane"
NOSE, WIND = "nose", "wind"
REFUSAL = (
    "waypoint: expected no way to go, for the sensors of a log stand; the next observation is that of another one."
)
PLACES_PARAMETER = "places_m"
"""A card with this parameter gets the candidate places of a site, x, y and z of each in one list [m]."""
START_NOTE, END_NOTE, RATE_NOTE = "start_s", "end_s", "rate_m3_s"
"""Values of a note beside a declaration: since and until when [s of the log], and how much pure gas [m3/s]."""
BOUND_NOTE, MARGIN_NOTE = "is_upper_bound", "margin"
"""Further values: not 0 if the rate is an upper bound; how much better the place is than the next, and then the
declaration's confidence tells whether it is sure."""

DEFAULT_AGENTS: Mapping[str, Mapping[str, Any]] = {
    "particle_filter": {},
    "source_map": {"max_cells": 1000},
    "pmfs": {"max_cells": 600},
    "infotaxis": {"cell_m": 2.0, "declares": False},
}
"""Bundled agents that replay logs without being asked for, with cells for yards instead of rooms."""

_ANSWER_WITHIN_S = 120.0
_POLL_S = 0.1
_MAP_CELL_M = 2.0
_FLOWN_KINDS = ("gas", "gas_ppm", "wind")
_SUITE_ENDINGS = (".yaml", ".yml")


class LogAgentError(SimulationFault):
    """An agent that replays a log failed; its words say how."""


@dataclass(frozen=True, kw_only=True)
class LogAgent:
    """Agent as an entry: what starts it, where its paths begin, and its card.

    `is_apart` tells that it runs in a process of its own, in a sandbox where this machine has one.
    """

    spec: EntrySpec
    directory: Path
    card: MethodCard | None
    is_apart: bool

    @property
    def carries_all_sensors(self) -> bool:
        """True if its card asks for several gas sensors."""
        needs = self.card.needs.sensors if self.card is not None else {}
        return sum(n for kind, n in needs.items() if kind.startswith("gas")) > 1

    def build_agent_spec(self, parameters: dict[str, Any]) -> AgentSpec:
        """Return the agent as a scenario has it."""
        start = resolve_start(self.spec.start, self.directory).model_dump(mode="json", exclude_defaults=True)
        if self.is_apart and self.spec.start.python is not None:
            start["door"] = "stdio"
        return AgentSpec.model_validate(
            {
                "name": self.spec.name,
                "start": start,
                "vehicle": {"start_m": (1, 1, 0.2)},
                "sensors": [{"model": "pid", "name": NOSE}],
                "parameters": parameters,
                "answer_within_s": _ANSWER_WITHIN_S,
            }
        )


def find_agent_entries(
    words: Sequence[str], data_dir: Path, *, taken: Sequence[str], is_chosen: Callable[[str], bool]
) -> tuple[Entry, ...]:
    """Return the entries that words name.

    Args:
        words: Bundled agents by name, Python files, and suites by file or name for all of their entries; beside
            `DEFAULT_AGENTS`.
        data_dir: Folder of the logs, which no agent sees.
        taken: Names that other entries have; a bundled agent of such a name gets the ending `_agent`.
        is_chosen: Whether an entry of a name takes part; the others are not looked at.
    """
    entries: list[Entry] = []
    names = set(taken)
    for word in (*DEFAULT_AGENTS, *(word for word in words if word not in DEFAULT_AGENTS)):
        for agent in _find_agents(word):
            name = agent.spec.name
            if name in names and not agent.is_apart:
                name = f"{name}_agent"
            if name in names:
                raise UsageError(
                    f"--agents {word}: expected a name of its own for each entry, was {name} twice. Give it another "
                    "name in the entries of a suite file."
                )
            names.add(name)
            if not is_chosen(name):
                continue
            if reason := _find_hindrance(agent):
                raise UsageError(
                    f"--agents {word}: expected agents that can estimate from readings of standing sensors, {name} "
                    f"{reason}. Leave it out, or choose others with --only entry=NAME."
                )
            entries.append(_build_entry(name, agent, data_dir))
    return tuple(entries)


def _find_agents(word: str) -> list[LogAgent]:
    path, bundled = Path(word), bundled_agents()
    if word.endswith(PROGRAM_ENDINGS) and path.is_file():
        stem = path.resolve().parent.name if path.name in (AGENT_FILE, CARD_FILE) else path.stem
        name = re.sub(r"[^a-z0-9]+", "_", stem.lower()).strip("_")[:40]
        if not re.match(r"[a-z]", name):
            name = f"agent_{name}"[:40].rstrip("_")
        spec = EntrySpec.model_validate({"name": name, "start": {"python": str(path.absolute())}})
        return [_build_log_agent(spec, path.absolute().parent)]
    if word in bundled:
        parameters = dict(DEFAULT_AGENTS.get(word, {}))
        spec = EntrySpec.model_validate({"name": word, "start": {"python": word}, "parameters": parameters})
        return [_build_log_agent(spec, bundled[word].parent)]
    if path.suffix in _SUITE_ENDINGS or word in bundled_suites():
        suite = load_suite(word)
        specs = (setting for entry in suite.suite.entries for setting in entry.settings)
        return [_build_log_agent(spec, suite.directory) for spec in specs]
    raise UsageError(
        f"--agents {word}: expected a bundled agent, a Python file, or a suite with entries, found none of them. "
        f"{did_you_mean(word, [*bundled, *bundled_suites()])}".rstrip()
    )


def _build_log_agent(spec: EntrySpec, directory: Path) -> LogAgent:
    card, program = find_card(spec, directory), find_program(spec, directory)
    is_bundled = program is not None and spec.start.python is not None and program in bundled_agents().values()
    return LogAgent(spec=spec, directory=directory, card=card, is_apart=not is_bundled)


def _find_hindrance(agent: LogAgent) -> str:
    spec, card = agent.spec, agent.card
    if spec.robots > 1:
        return f"flies {spec.robots} robots"
    if spec.knows is not None and (spec.knows.source or spec.knows.plume):
        return "is granted the source or its plume"
    if card is None:
        return ""
    if others := [kind for kind in card.needs.sensors if kind not in _FLOWN_KINDS]:
        return f"needs a sensor that logs do not have ({', '.join(others)})"
    if granted := [each for each in card.needs.knows if each != "map"]:
        return f"needs to know the {granted[0]}"
    if card.needs.radio:
        return "needs a radio"
    return "" if card.declares or card.believes else "neither declares nor publishes a belief"


def _build_entry(name: str, agent: LogAgent, data_dir: Path) -> Entry:
    kind = CarriedSensorsAgent if agent.carries_all_sensors else PatrolAgent
    return Entry(
        name=name,
        title=agent.card.title if agent.card is not None else name,
        family=agent.card.family if agent.card is not None else "agent",
        build=lambda site: kind(site, agent, data_dir),
        can_take=is_network,
        sandbox=_describe_sandbox(agent),
        parameters=dict(agent.spec.parameters),
    )


def _describe_sandbox(agent: LogAgent) -> str:
    scenario = _build_scenario(agent.build_agent_spec({}))
    return describe_sandboxes(scenario, is_one_process=True)[agent.spec.name]


# What starts a process of an agent takes from it; nothing of it is flown.
def _build_scenario(spec: AgentSpec) -> Scenario:
    gas = {"model": "filament", "gas": GAS, "sources": [{"position_m": (1.0, 1.0, 1.0)}]}
    return build_gas_scenario(gas, name="measured", seed=1).model_copy(update={"agents": (spec,)})


class LogSession:
    """Conversation with one agent in the order of a log: a briefing, then questions."""

    def __init__(self, session: AgentSession, events: "queue.SimpleQueue[AgentEvent]") -> None:
        """Begin with an agent that was started."""
        self._session, self._events = session, events
        self._tick = 0

    def brief(self, briefing: Briefing) -> None:
        """Send the briefing."""
        self._session.brief(briefing, codec.encode(briefing))

    def ask(self, observation: Observation) -> Command:
        """Return the command that answers an observation."""
        session, self._tick = self._session, observation.tick
        answers: list[SentMessage] = []
        session.deliver = answers.append
        session.observe(observation, codec.encode(observation))
        # What an agent says after its answer belongs to this question too.
        while not (answers and self._events.empty()):
            try:
                session.handle(self._events.get(timeout=_POLL_S))
            except queue.Empty:
                session.check_deadline()
        command = answers[0].message
        assert isinstance(command, Command)
        if command.kind == "failed":
            raise LogAgentError(session.validator.faults[-1].text if session.validator.faults else command.reason)
        return command

    def end(self) -> None:
        """Send the end of the log."""
        self._session.end(Ending(tick=self._tick, reason="time_limit"))


@contextmanager
def open_log_session(agent: LogAgent, spec: AgentSpec, data_dir: Path) -> Iterator[LogSession]:
    """Start an agent for one replay; nothing of it is left when the context is over.

    Args:
        agent: Which; a bundled one is an object in this process.
        spec: As `LogAgent.build_agent_spec` has it.
        data_dir: Folder of the logs and their truth, which a process of an agent in a sandbox does not see.
    """
    events: queue.SimpleQueue[AgentEvent] = queue.SimpleQueue()
    with ExitStack() as stack:
        transport: AgentTransport
        log_tail = lambda: ""  # noqa: E731 - of an object
        if agent.is_apart:
            setup = _build_setup(stack, spec, data_dir)
            gateway = GatewayAgents(setup, agent.directory, Network(), events.put)
            stack.enter_context(gateway.open())
            transport = gateway.get_transport(spec.name)
            log_tail = lambda: setup.run_dir.log_tail(get_agent_participant(spec.name))  # noqa: E731
        else:
            program = find_python_agent(agent.spec.start.python or "", agent.directory)
            transport = ObjectTransport(spec.name, load_python_agent(program), events.put)
        validator = CommandValidator(spec.name)
        session = AgentSession(spec.name, validator, transport, spec.answer_within_s, log_tail=log_tail)
        opened = LogSession(session, events)
        stack.callback(opened.end)
        yield opened


# The folder of the data stands for the environment: it is hidden, and its files are truth under each name they have.
def _build_setup(stack: ExitStack, spec: AgentSpec, data_dir: Path) -> RunSetup:
    run_dir = RunDir(stack.enter_context(ScratchFolder("measured")).path / "run")
    (run_dir.path / "logs").mkdir(parents=True)
    return RunSetup(
        run_dir=run_dir,
        scenario=_build_scenario(spec),
        environment_dir=data_dir.resolve(),
        environment=open_field(),
        sources=tuple(sorted(path.resolve() for path in list_files(data_dir))),
    )


class PatrolAgent(EventEstimator):
    """An agent with one gas sensor: events are found for it, and each is a patrol along the masts.

    At each visit it reads what the mast has read above its background, and the wind, both as means over `AVERAGE_S`.
    Its first declaration is the answer; without one it is what it believes at the end of the event.
    """

    def __init__(self, site: LogSite, agent: LogAgent, data_dir: Path) -> None:
        """Begin with an empty log."""
        super().__init__(site)
        self._agent, self._data_dir = agent, data_dir

    def claim(self, event: LeakEvent, excess: Excess, wind: WindRecord, gas_m3_per_kg: float) -> Claim:
        """Return the claim of one event."""
        declared: Vec3 | None = None
        believed: Command | None = None
        briefing = self._brief(event)
        spec = self._agent.build_agent_spec(dict(briefing.parameters))
        with open_log_session(self._agent, spec, self._data_dir) as session:
            session.brief(briefing)
            for observation in self._observe_event(event, excess, wind):
                command = session.ask(observation)
                believed = believed if command.belief is None else command
                if command.declaration is not None:
                    declared = command.declaration.position_world_m
                    break
        if declared is not None:
            return self.claim_at(event, declared)
        if believed is None:
            return Claim(start_s=event.start_s, end_s=event.end_s)
        return self.claim_at(event, self._place_of_belief(believed))

    @property
    def _tick_ns(self) -> int:
        return round(AVERAGE_S * NS_PER_S / len(self.site.names))

    def _brief(self, event: LeakEvent) -> Briefing:
        sensors = (_describe_nose(NOSE, (0.0, 0.0, 0.0)), _describe_vane())
        return _build_briefing(
            self._agent, self.site, sensors,
            tick_ns=self._tick_ns, seed=event.first, time_limit_s=event.end_s - event.start_s + AVERAGE_S,
            height_m=self.source_height_m,
        )  # fmt: skip

    def _observe_event(self, event: LeakEvent, excess: Excess, wind: WindRecord) -> Iterator[Observation]:
        tick_s = self._tick_ns / NS_PER_S
        for rows in split_into_blocks(event, wind):
            block = math.floor(wind.start_s[rows[0]] / AVERAGE_S) - math.floor(event.start_s / AVERAGE_S)
            wind_m_s = wind.mean_world_m_s[rows]
            wind_m_s = wind_m_s[np.isfinite(wind_m_s).all(axis=1)]
            for k, sensor_m in enumerate(self.site.sensors_m):
                above_ppm = excess.above_ppm[rows, k]
                above_ppm = above_ppm[np.isfinite(above_ppm)]
                if not len(above_ppm) or not len(wind_m_s):
                    continue
                tick = block * len(self.site.names) + k
                nose = _read_nose(NOSE, max(float(above_ppm.mean()), 0.0))
                x_m, y_m, z_m = (float(x) for x in sensor_m)
                yield _build_observation(
                    self._agent, tick, tick * tick_s, (x_m, y_m, z_m), (nose, _read_vane(wind_m_s.mean(axis=0)))
                )

    # The candidate place with most of the belief nearest to it, or the mean of its best cells.
    def _place_of_belief(self, command: Command) -> tuple[float, float]:
        belief = command.belief
        assert belief is not None
        p = belief.probability.to_array().astype(np.float64)
        grid = CellGrid(belief.origin_m[: p.ndim], belief.cell_m, p.shape)
        p = normalised(p)
        if not self.site.places_m:
            x_m, y_m = mean_of_best_m(p, grid)[:2]
            return x_m, y_m
        return self.site.find_likeliest_m(grid.centres_m()[:, :2], p.reshape(-1))


class CarriedSensorsAgent(HindsightEstimator):
    """An agent that carries all masts: it gets the whole log as it was read, and each declaration is an event.

    A note beside the declaration says since and until when gas came (`start_s`, `end_s`) and how much (`rate_m3_s`);
    without them the event is the time of the declaration.
    """

    def __init__(self, site: LogSite, agent: LogAgent, data_dir: Path) -> None:
        """Begin with an empty log."""
        super().__init__(site)
        self._agent, self._data_dir = agent, data_dir
        self._names = tuple(f"mast_{k + 1}" for k in range(len(site.names)))
        self._middle_m = site.sensors_m.mean(axis=0)

    def claims(self, log: MeasuredLog) -> Sequence[Claim]:
        """Return a claim for each declaration."""
        tick_ns = round(self.site.period_s * NS_PER_S)
        mounts_m = self.site.sensors_m - self._middle_m
        sensors = [
            _describe_nose(name, (float(x_m), float(y_m), float(z_m)))
            for name, (x_m, y_m, z_m) in zip(self._names, mounts_m, strict=True)
        ]
        height_m = self.site.source_height_m
        briefing = _build_briefing(
            self._agent, self.site, (*sensors, _describe_vane()),
            tick_ns=tick_ns, seed=1, time_limit_s=float(log.start_s[-1] - log.start_s[0]) + self.site.period_s,
            height_m=height_m if math.isfinite(height_m) else float(self._middle_m[2]),
        )  # fmt: skip
        spec = self._agent.build_agent_spec(dict(briefing.parameters))
        claims: list[Claim] = []
        with open_log_session(self._agent, spec, self._data_dir) as session:
            session.brief(briefing)
            for observation in self._observe_log(log, tick_ns):
                command = session.ask(observation)
                if command.declaration is not None:
                    row = int(np.searchsorted(log.start_s, log.start_s[0] + observation.time_s - 1e-3))
                    claims.append(self._build_claim(command, observation.time_s, log, row))
        return claims

    def _observe_log(self, log: MeasuredLog, tick_ns: int) -> Iterator[Observation]:
        x_m, y_m, z_m = (float(x) for x in self._middle_m)
        last = -1
        for row in log.rows():
            time_s = row.start_s - float(log.start_s[0])
            tick = max(round(time_s * NS_PER_S / tick_ns), last + 1)
            last = tick
            noses = [_read_nose(name, float(ppm)) for name, ppm in zip(self._names, row.readings_ppm, strict=True)]
            yield _build_observation(
                self._agent, tick, time_s, (x_m, y_m, z_m), (*noses, _read_vane(row.wind_world_m_s))
            )

    def _build_claim(self, command: Command, now_s: float, log: MeasuredLog, row: int) -> Claim:
        assert command.declaration is not None
        x_m, y_m, _ = command.declaration.position_world_m
        said = dict(command.note.values) if command.note else {}
        begin_s = float(log.start_s[0])
        place, place_m = self.site.snap(x_m, y_m)
        end_s = said.get(END_NOTE, now_s)
        return Claim(
            start_s=begin_s + min(said.get(START_NOTE, now_s), end_s),
            end_s=begin_s + end_s,
            place=place,
            position_m=place_m,
            rate_kg_s=said.get(RATE_NOTE, math.nan) / float(log.gas_m3_per_kg[min(row, len(log.start_s) - 1)]),
            is_upper_bound=bool(said.get(BOUND_NOTE, 0.0)),
            margin=said.get(MARGIN_NOTE, math.nan),
            confidence=command.declaration.confidence if MARGIN_NOTE in said else math.nan,
        )


def _build_briefing(
    agent: LogAgent,
    site: LogSite,
    sensors: tuple[SensorDescription, ...],
    *,
    tick_ns: int,
    seed: int,
    time_limit_s: float,
    height_m: float,
) -> Briefing:
    low_m, high_m = area_about(site.sensors_m)
    top_m = 2.0 * max(height_m, float(site.sensors_m[:, 2].max()))
    bounds = Bounds(min_m=(low_m[0], low_m[1], 0.0), max_m=(high_m[0], high_m[1], top_m))
    parameters = {**agent.spec.parameters}
    if agent.card is not None and PLACES_PARAMETER in agent.card.parameters and site.places_m:
        given = tuple(float(x) for place_m in site.places_m.values() for x in place_m)
        parameters = {PLACES_PARAMETER: given, **parameters}
    return Briefing(
        tick=0,
        agent=agent.spec.name,
        contract_version=CONTRACT_VERSION,
        mission=f"Say where {GAS} comes from, from the readings of {len(site.names)} sensors that stand.",
        tick_ns=tick_ns,
        seed=seed,
        mode="on_request",
        latency_ticks=1,
        gas=GAS,
        bounds=bounds,
        search_height_m=height_m,
        hold_s=tick_ns / NS_PER_S,
        time_limit_s=time_limit_s,
        sensors=sensors,
        contract_hash=CONTRACT_HASH,
        parameters=parameters,
        known_map=_build_map(bounds, height_m) if _is_granted_map(agent) else None,
    )


def _is_granted_map(agent: LogAgent) -> bool:
    if agent.spec.knows is not None:
        return bool(agent.spec.knows.map)
    return agent.card is not None and "map" in agent.card.needs.knows


# An open yard: nothing of what stands there is in the set.
def _build_map(bounds: Bounds, height_m: float) -> KnownMap:
    shape = [max(1, math.ceil((bounds.max_m[a] - bounds.min_m[a]) / _MAP_CELL_M)) for a in range(2)]
    return KnownMap(
        origin_m=(bounds.min_m[0], bounds.min_m[1], height_m),
        cell_m=_MAP_CELL_M,
        occupied=NumericArray.from_array(np.zeros(shape, np.uint8)),
        height_m=height_m,
    )


def _build_observation(
    agent: LogAgent, tick: int, time_s: float, position_m: Vec3, readings: tuple[Reading, ...]
) -> Observation:
    return Observation(
        tick=tick,
        agent=agent.spec.name,
        time_s=time_s,
        position_world_m=position_m,
        yaw_rad=0.0,
        velocity_world_m_s=(0.0, 0.0, 0.0),
        status="holding",
        awaiting_command=True,
        readings=readings,
        notice=REFUSAL,
    )


def _describe_nose(name: str, mount_m: Vec3) -> SensorDescription:
    return SensorDescription(name=name, model="pid", quantity="mixing_ratio", unit="ppm", mount_body_m=mount_m)


def _describe_vane() -> SensorDescription:
    return SensorDescription(
        name=WIND, model="anemometer", quantity=WIND_QUANTITY, unit="m/s, rad", mount_body_m=(0.0, 0.0, 0.0)
    )


# What was not read is a sensor that does not measure: the contract has no word for a gap.
def _read_nose(name: str, ppm: float) -> Reading:
    is_read = math.isfinite(ppm)
    return Reading(
        sensor=name,
        quantity="mixing_ratio",
        unit="ppm",
        values=(ppm if is_read else 0.0,),
        is_warming_up=not is_read,
    )


def _read_vane(wind_world_m_s: Floats) -> Reading:
    x_m_s, y_m_s = (float(x) for x in wind_world_m_s)
    is_read = math.isfinite(x_m_s) and math.isfinite(y_m_s)
    values = (math.hypot(x_m_s, y_m_s), math.atan2(-y_m_s, -x_m_s)) if is_read else (0.0, 0.0)
    return Reading(sensor=WIND, quantity=WIND_QUANTITY, unit="m/s, rad", values=values, is_warming_up=not is_read)
