"""Several runs of one room in one recording: their tracks over one map, their curves over each other."""

import itertools
import string
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import rerun as rr
from rerun.chunk import Chunk

from gslcosim.environment.model import Environment
from gslcosim.errors import RecordingError
from gslcosim.quantities import Vec3
from gslcosim.recording import colors, entities
from gslcosim.recording.at_time import shown_chunks
from gslcosim.recording.colors import GasScale
from gslcosim.recording.entities import entities_of, gases_in
from gslcosim.recording.layout.blueprint import default_blueprint
from gslcosim.recording.rows.agents import AgentRows
from gslcosim.recording.rows.wind_layer import WindLayer
from gslcosim.recording.run_file import TICK_TIMELINE, TIME_TIMELINE, RunFile
from gslcosim.recording.run_recording import FIRST_GAS
from gslcosim.recording.scene import draw_map, draw_room, draw_sources
from gslcosim.recording.summary import legend_text
from gslcosim.scenario import Scenario
from gslcosim.ticks import seconds_from_ticks

MAX_RUNS = 8
# Of these the first run's are shown for all: they are the same where neither gas nor wind differ.
_OF_ONE = ("gas", entities.WIND)
_LOGS = (entities.EVENTS, entities.CONTACTS, entities.RADIO, entities.FAULTS)
# An agent's name is the next part of a path.
_OF_AGENTS = (
    "vehicles", "tracks", "plans", "waypoints", "markers", entities.SEEN, entities.BELIEFS, entities.GAS_PLOTS,
    entities.RESPONSE_PLOTS, entities.WIND_PLOTS, entities.DISTANCE_PLOTS, entities.BELIEF_PLOTS,
    entities.TRACKING_PLOTS, entities.DECISION_PLOTS, entities.ON_BOARD_PLOTS,
)  # fmt: skip
# What stands still and is not drawn anew.
_KEPT_STATIC = (entities.BELIEFS, entities.SLICES)
# Where lines across the curves say that runs part.
_MARKED_PLOTS = (entities.GAS_PLOTS, entities.DISTANCE_PLOTS)
_MARK = "they_part"
_MARK_COLOR = colors.CONTACT


@dataclass(frozen=True, kw_only=True)
class RecordedRun:
    """A run with its recording; `text` says in a line how it went."""

    recording: Path
    scenario: Scenario
    text: str


@dataclass(frozen=True, kw_only=True)
class Parting:
    """Where runs part: at which tick, and how that is told."""

    tick: int
    text: str


@dataclass(frozen=True, kw_only=True)
class Meeting:
    """The tick at which all runs have their first contact with gas, once they are moved in time."""

    tick: int
    tick_ns: int


def record_side_by_side(
    runs: Sequence[RecordedRun],
    environment: Environment,
    path: Path,
    *,
    parting: Parting | None = None,
    is_by_contact: bool = False,
) -> None:
    """Write one recording of several runs.

    Each run has a letter, which precedes the names of its agents, and each agent a colour. Room, gas and wind are those
    of the first run.

    Args:
        runs: Two runs or more, all in `environment` and with equal ticks.
        environment: Their room.
        path: The file to write.
        parting: Where they part, to be marked; not where they are moved in time.
        is_by_contact: Whether the other runs are moved in time, so that all have their first contact with gas when the
            first run has.

    Raises:
        RecordingError: a recording cannot be read, or there are too many.
    """
    if len(runs) > MAX_RUNS:
        raise RecordingError(f"view: expected at most {MAX_RUNS} runs at once, was {len(runs)}.")
    renamed = [_names_of(letter, run.scenario) for letter, run in zip(string.ascii_uppercase, runs, strict=False)]
    scenario = _scenario_of_all(runs, renamed)
    meets_at, parting = (_meeting(runs[0]), None) if is_by_contact else (None, parting)
    chunks = [
        [*_chunks_of(run.recording, names, is_first=i == 0, meets_at=meets_at)]
        for i, (run, names) in enumerate(zip(runs, renamed, strict=True))
    ]
    believers = {name for chunk in itertools.chain(*chunks) if (name := _believer(chunk))}
    file = RunFile(
        path,
        run_id="-".join(run.recording.resolve().parent.name for run in runs),
        name=f"{len(runs)} runs of {scenario.name}",
        tick_ns=scenario.tick_ns,
        blueprint=default_blueprint(scenario, environment, believers=sorted(believers)),
    )
    try:
        _draw(file, scenario, environment, believers, _summary(runs, renamed, parting, meets_at))
        file.send_chunks(itertools.chain(*chunks))
        if parting is not None:
            _mark(file, scenario, parting, chunks[0])
    finally:
        file.close()


# By old name the new one: a lone agent is called after its method, which says more than its name.
def _names_of(letter: str, scenario: Scenario) -> dict[str, str]:
    agents = scenario.agents
    if len(agents) == 1 and agents[0].start.python:
        return {agents[0].name: f"{letter}_{Path(agents[0].start.python).stem}"}
    if len(agents) == 1 and agents[0].start.method:
        return {agents[0].name: f"{letter}_{agents[0].start.method}"}
    return {agent.name: f"{letter}_{agent.name}" for agent in agents}


def _scenario_of_all(runs: Sequence[RecordedRun], renamed: Sequence[Mapping[str, str]]) -> Scenario:
    agents = [
        agent.model_copy(update={"name": names[agent.name]})
        for run, names in zip(runs, renamed, strict=True)
        for agent in run.scenario.agents
    ]
    return runs[0].scenario.model_copy(update={"agents": tuple(agents)})


def _draw(file: RunFile, scenario: Scenario, environment: Environment, believers: Container[str], summary: str) -> None:
    draw_room(file, environment)
    draw_sources(file, scenario)
    draw_map(file, environment, GasScale.of(scenario), scenario.slice_height_m)
    WindLayer(environment, scenario.slice_height_m).draw(file, entities.WIND)
    for names in entities_of(scenario):
        rows = AgentRows(names, gases_in(scenario), scenario.tick_ns)
        rows.draw(file, label=f"{names.agent.name} ")
        if names.agent.name in believers:
            rows.belief.draw(file, label=f"{names.agent.name} ")
        # What is drawn at all times wins over the colour of each row.
        for points in (names.waypoints, names.markers):
            file.draw(points, rr.Points3D.from_fields(colors=[names.color]))
    file.draw(entities.LEGEND, rr.TextDocument(legend_text(scenario), media_type=rr.MediaType.MARKDOWN))
    file.draw(entities.SUMMARY, rr.TextDocument(summary, media_type=rr.MediaType.MARKDOWN))
    file.flush()


def _summary(
    runs: Sequence[RecordedRun],
    renamed: Sequence[Mapping[str, str]],
    parting: Parting | None,
    meets_at: Meeting | None,
) -> str:
    lines = [f"**{runs[0].scenario.name}**: {len(runs)} runs", ""]
    for run, names in zip(runs, renamed, strict=True):
        lines.append(f"- **{', '.join(names.values())}**: {run.text}")
    if parting is not None:
        lines += ["", f"### {parting.text}"]
    if meets_at is not None:
        at_s = seconds_from_ticks(meets_at.tick, meets_at.tick_ns)
        lines += ["", f"### All have their first contact with gas at {at_s:g} s: others than A are moved in time."]
    lines += ["", "Room, gas and wind are those of run A."]
    return "\n".join(lines)


def _chunks_of(
    recording: Path, names: Mapping[str, str], *, is_first: bool, meets_at: Meeting | None = None
) -> Iterator[Chunk]:
    letter = next(iter(names.values())).partition("_")[0]
    chunks = shown_chunks(recording)
    shift_ticks = 0 if meets_at is None else meets_at.tick - _first_contact(chunks, recording)
    for unshifted in chunks:
        chunk = _shifted(unshifted, shift_ticks, meets_at)
        path = str(chunk.entity_path).removeprefix("/")
        if path.split("/")[0] in _OF_ONE:
            if is_first and (not chunk.is_static or path.startswith(_KEPT_STATIC)):
                yield chunk
        elif path in _LOGS:
            yield from _said_by(letter, chunk, path)
        elif (new_path := _renamed(path, names)) is not None and _is_kept(chunk, path):
            yield chunk.with_entity_path(new_path)


def _meeting(run: RecordedRun) -> Meeting:
    tick = _first_contact(shown_chunks(run.recording), run.recording)
    return Meeting(tick=tick, tick_ns=run.scenario.tick_ns)


def _first_contact(chunks: Sequence[Chunk], recording: Path) -> int:
    ticks = [
        tick
        for chunk in chunks
        if not chunk.is_static and str(chunk.entity_path).startswith("/markers/")
        for tick, labels in _labels(chunk)
        if FIRST_GAS in labels
    ]
    if not ticks:
        raise RecordingError(
            f"--align first_contact: expected runs with a contact with gas, {recording.resolve().parent.name} has none."
        )
    return min(ticks)


def _labels(chunk: Chunk) -> list[tuple[int, list[str]]]:
    batch: Any = chunk.to_record_batch()
    return list(zip(batch.column(TICK_TIMELINE).to_pylist(), batch.column("Points3D:labels").to_pylist(), strict=True))


def _shifted(chunk: Chunk, ticks: int, meets_at: Meeting | None) -> Chunk:
    if meets_at is None or not ticks or chunk.is_static:
        return chunk
    batch: Any = chunk.to_record_batch()
    for name, step in ((TICK_TIMELINE, ticks), (TIME_TIMELINE, ticks * meets_at.tick_ns)):
        i = batch.schema.get_field_index(name)
        moved = pa.array(batch.column(i).cast(pa.int64()).to_numpy() + step).cast(batch.schema.field(i).type)
        batch = batch.set_column(i, batch.schema.field(i), moved)
    (piece,) = Chunk.from_record_batch(batch)
    return piece.with_entity_path(str(chunk.entity_path))


def _is_kept(chunk: Chunk, path: str) -> bool:
    return not chunk.is_static or path.startswith(_KEPT_STATIC)


def _renamed(path: str, names: Mapping[str, str]) -> str | None:
    for root in _OF_AGENTS:
        if path.startswith(f"{root}/"):
            name, slash, rest = path[len(root) + 1 :].partition("/")
            return f"{root}/{names[name]}{slash}{rest}" if name in names else None
    return None


def _believer(chunk: Chunk) -> str | None:
    root, _, name = str(chunk.entity_path).removeprefix("/").partition("/")
    return name if root == entities.BELIEFS else None


def _said_by(letter: str, chunk: Chunk, path: str) -> list[Chunk]:
    batch = chunk.to_record_batch()
    i = batch.schema.get_field_index("TextLog:text")
    texts: list[list[str]] = batch.column(i).to_pylist()
    told = pa.array([[f"{letter}  {text}" for text in row] for row in texts], type=batch.schema.field(i).type)
    said = Chunk.from_record_batch(batch.set_column(i, batch.schema.field(i), told))
    return [piece.with_entity_path(f"{path}/{letter}") for piece in said]


# A line across the curves, and a point where the first vehicle is then.
def _mark(file: RunFile, scenario: Scenario, parting: Parting, chunks: Sequence[Chunk]) -> None:
    label = f"they part at {seconds_from_ticks(parting.tick, scenario.tick_ns):g} s"
    names = entities_of(scenario)[0]
    place_m = _place_m(chunks, names.vehicle, parting.tick)
    if place_m is not None:
        columns = rr.Points3D.columns(positions=[place_m], labels=[label], radii=[0.15], show_labels=[True])
        file.draw(f"{names.markers}/{_MARK}", rr.Points3D.from_fields(colors=[_MARK_COLOR]))
        file.send(f"{names.markers}/{_MARK}", [parting.tick], columns)
    for plot in _MARKED_PLOTS:
        values = [value for chunk in chunks if _is_plotted(chunk, plot) for value in _numbers(chunk)]
        if values:
            entity = f"{plot}/{_MARK}"
            # The viewer would draw the mean of both ends.
            whole = rr.components.AggregationPolicy.Off
            line = rr.SeriesLines(names=[label], colors=[_MARK_COLOR], widths=[1.5], aggregation_policy=whole)
            file.draw(entity, line)
            # A tick wide: of two values at one tick the viewer draws the last.
            ends = [min(values), max(values)]
            file.send(entity, [parting.tick, parting.tick + 1], rr.Scalars.columns(scalars=ends))
    file.send(f"{entities.EVENTS}/parting", [parting.tick], rr.TextLog.columns(text=[parting.text], level=["WARN"]))


def _is_plotted(chunk: Chunk, plot: str) -> bool:
    return not chunk.is_static and str(chunk.entity_path).startswith(f"/{plot}/")


def _numbers(chunk: Chunk) -> list[float]:
    batch: Any = chunk.to_record_batch()
    return [float(value) for row in batch.column("Scalars:scalars").to_pylist() for value in row or ()]


def _place_m(chunks: Sequence[Chunk], vehicle: str, tick: int) -> Vec3 | None:
    for chunk in chunks:
        if str(chunk.entity_path) == f"/{vehicle}" and not chunk.is_static:
            batch: Any = chunk.to_record_batch()
            ticks: list[int] = batch.column(TICK_TIMELINE).to_pylist()
            if tick in ticks:
                x, y, z = batch.column("Transform3D:translation").to_pylist()[ticks.index(tick)][0]
                return (x, y, z)
    return None
