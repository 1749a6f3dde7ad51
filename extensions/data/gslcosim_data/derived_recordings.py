"""Recordings derived from others: one that opens at a tick, and several runs of one environment side by side."""

import itertools
import string
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import AbsoluteTimeRange
from rerun.chunk import Chunk

from gslcosim.base.errors import RecordingError
from gslcosim.base.method_names import ATTACHED
from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim_data.chunks import read_chunks
from gslcosim_services.recorder import colors
from gslcosim_services.recorder import stream_table as streams
from gslcosim_services.recorder.agent_look import draw_agent, draw_belief_curves
from gslcosim_services.recorder.blueprint import default_blueprint, legend_text, title
from gslcosim_services.recorder.colors import GasScale
from gslcosim_services.recorder.entities import build_entities, list_gas_names
from gslcosim_services.recorder.recording_file import TICK_TIMELINE, TIME_TIMELINE, RecordingFile
from gslcosim_services.recorder.rows.events import WindLayer
from gslcosim_services.recorder.run_recording import FIRST_GAS
from gslcosim_services.recorder.scene import draw_map, draw_room, draw_sources

MAX_RUNS = 8
# Of these the first run's are shown for all: they are the same unless gas or wind differ.
_SHARED_ENTITIES = tuple(
    stream.entity.split("/")[0] for stream in (streams.FILAMENTS, streams.SLICES, streams.WIND_ARROWS)
)
_LOGS = tuple(log.entity for log in streams.LOGS)
# The next part of the path is an agent's name.
_AGENT_ENTITIES = tuple(
    dict.fromkeys(each.root for each in streams.STREAMS if each.entity.startswith(f"{each.root}/{{agent}}"))
)
# Static entities that are copied, not drawn again.
_COPIED_STATIC_ENTITIES = (streams.BELIEF.root, streams.SLICES.root)
# Plots with a line at the tick at which runs diverge.
_MARKED_PLOTS = (streams.MIXING_RATIO.root, streams.DISTANCE.root)
_DIVERGENCE_ENTITY = "they_part"
_DIVERGENCE_COLOR = colors.CONTACT


def record_from_tick(
    recording: Path, scenario: Scenario, environment: Environment, path: Path, *, tick: int, is_still: bool
) -> None:
    """Write a copy of a recording that opens at a tick.

    The viewer's cursor can only be set by playing a selection, or by following the end.

    Args:
        tick: Tick at which it opens.
        is_still: Whether later data are left out, and nothing plays; otherwise the viewer plays from there on.
    """
    chunks = shown_chunks(recording)
    last_tick = max((last for chunk in chunks if (last := _last_tick(chunk)) is not None), default=0)
    if tick > last_tick:
        at_s, end_s = (seconds_from_ticks(each, scenario.tick_ns) for each in (tick, last_tick))
        raise RecordingError(f"--at: expected a time within the recording, which ends at {end_s:g} s, was {at_s:g} s.")
    believers = sorted({name for chunk in chunks if (name := _find_believer(chunk))})
    has_notes = any(_has_notes(chunk) for chunk in chunks)
    blueprint = default_blueprint(scenario, environment, believers=believers, has_notes=has_notes)
    if not is_still:
        blueprint = _set_time_range(blueprint, tick, last_tick, scenario.tick_ns)
    file = RecordingFile(
        path,
        run_id=recording.resolve().parent.name,
        name=title(scenario),
        tick_ns=scenario.tick_ns,
        blueprint=blueprint,
    )
    try:
        file.send_chunks(_cut_after(chunks, tick) if is_still else chunks)
    finally:
        file.close()


def shown_chunks(recording: Path) -> list[Chunk]:
    """Return all chunks of a recording but its properties."""
    return [chunk for chunk in read_chunks(recording) if not str(chunk.entity_path).startswith("/__")]


def _set_time_range(blueprint: rrb.Blueprint, tick: int, last_tick: int, tick_ns: int) -> rrb.Blueprint:
    blueprint.time_panel = rrb.TimePanel(
        state="expanded",
        timeline=TIME_TIMELINE,
        play_state="playing",
        loop_mode="selection",
        time_selection=AbsoluteTimeRange(min=tick * tick_ns, max=max(last_tick, tick + 1) * tick_ns),
    )
    return blueprint


def _cut_after(chunks: Sequence[Chunk], tick: int) -> Iterator[Chunk]:
    for chunk in chunks:
        if chunk.is_static:
            yield chunk
            continue
        batch: Any = chunk.to_record_batch()
        kept = batch.filter(pa.array(_ticks(batch) <= tick))
        if kept.num_rows == batch.num_rows:
            yield chunk
        elif kept.num_rows:
            yield from (piece.with_entity_path(str(chunk.entity_path)) for piece in Chunk.from_record_batch(kept))


def _ticks(batch: Any) -> Any:
    return batch.column(TICK_TIMELINE).to_numpy(zero_copy_only=False)


def _last_tick(chunk: Chunk) -> int | None:
    if chunk.is_static:
        return None
    ticks = _ticks(chunk.to_record_batch())
    return int(ticks.max()) if len(ticks) else None


def _find_believer(chunk: Chunk) -> str | None:
    root, _, name = str(chunk.entity_path).removeprefix("/").partition("/")
    return name if root == streams.BELIEF.root else None


def _has_notes(chunk: Chunk) -> bool:
    return str(chunk.entity_path).removeprefix("/").partition("/")[0] == streams.NOTE_MODE.root


@dataclass(frozen=True, kw_only=True)
class RecordedRun:
    """A run with its recording; `text` is its outcome in a line."""

    recording: Path
    scenario: Scenario
    text: str


@dataclass(frozen=True, kw_only=True)
class Divergence:
    """First tick at which runs diverge, and its text."""

    tick: int
    text: str


@dataclass(frozen=True, kw_only=True)
class AlignmentTick:
    """Tick at which all runs have their first contact with gas, once they are shifted in time."""

    tick: int
    tick_ns: int


def record_side_by_side(
    runs: Sequence[RecordedRun],
    environment: Environment,
    path: Path,
    *,
    divergence: Divergence | None = None,
    is_by_contact: bool = False,
) -> None:
    """Write one recording of several runs.

    Each run has a letter, which precedes the names of its agents, and each agent a colour. Room, gas and wind are those
    of the first run.

    Args:
        runs: Two runs or more, all in `environment` and with equal ticks.
        divergence: Where they diverge, to be marked; ignored if runs are shifted in time.
        is_by_contact: Whether the other runs are shifted in time, so that all have their first contact with gas at that
            of the first run.
    """
    if len(runs) > MAX_RUNS:
        raise RecordingError(f"view: expected at most {MAX_RUNS} runs at once, was {len(runs)}.")
    renamed = [_rename_agents(letter, run.scenario) for letter, run in zip(string.ascii_uppercase, runs, strict=False)]
    scenario = _merge_scenarios(runs, renamed)
    meets_at = None
    if is_by_contact:
        divergence = None
        tick = _find_first_contact(shown_chunks(runs[0].recording), runs[0].recording)
        meets_at = AlignmentTick(tick=tick, tick_ns=scenario.tick_ns)
    chunks = [
        [*_rename_chunks(run.recording, names, is_first=i == 0, meets_at=meets_at)]
        for i, (run, names) in enumerate(zip(runs, renamed, strict=True))
    ]
    believers = {name for chunk in itertools.chain(*chunks) if (name := _find_believer(chunk))}
    file = RecordingFile(
        path,
        run_id="-".join(run.recording.resolve().parent.name for run in runs),
        name=f"{len(runs)} runs of {scenario.name}",
        tick_ns=scenario.tick_ns,
        blueprint=default_blueprint(
            scenario,
            environment,
            believers=sorted(believers),
            has_notes=any(_has_notes(chunk) for chunk in itertools.chain(*chunks)),
        ),
    )
    try:
        _draw(file, scenario, environment, believers, _summary(runs, renamed, divergence, meets_at))
        file.send_chunks(itertools.chain(*chunks))
        if divergence is not None:
            _mark_divergence(file, scenario, divergence, chunks[0])
    finally:
        file.close()


# New names of agents by the old ones: a lone agent is named after its method, which is more informative.
def _rename_agents(letter: str, scenario: Scenario) -> dict[str, str]:
    agents = scenario.agents
    if len(agents) == 1 and scenario.methods[agents[0].name] != ATTACHED:
        return {agents[0].name: f"{letter}_{scenario.methods[agents[0].name]}"}
    return {agent.name: f"{letter}_{agent.name}" for agent in agents}


def _merge_scenarios(runs: Sequence[RecordedRun], renamed: Sequence[Mapping[str, str]]) -> Scenario:
    agents = [
        agent.model_copy(update={"name": names[agent.name]})
        for run, names in zip(runs, renamed, strict=True)
        for agent in run.scenario.agents
    ]
    return runs[0].scenario.model_copy(update={"agents": tuple(agents)})


def _draw(
    file: RecordingFile, scenario: Scenario, environment: Environment, believers: Container[str], summary: str
) -> None:
    draw_room(file, environment)
    draw_sources(file, scenario)
    draw_map(file, environment, GasScale.of(scenario), scenario.slice_height_m)
    WindLayer(environment, scenario.slice_height_m).draw(file, streams.WIND_ARROWS.entity)
    for names in build_entities(scenario):
        label = f"{names.agent.name} "
        draw_agent(file, names, list_gas_names(scenario), label=label)
        if names.agent.name in believers:
            draw_belief_curves(file, names, label=label)
        # Static data take precedence over the colour of each row.
        for points in (streams.WAYPOINTS, streams.MARKS):
            file.draw(names.at(points), rr.Points3D.from_fields(colors=[names.color]))
    file.draw(streams.LEGEND.entity, rr.TextDocument(legend_text(scenario), media_type=rr.MediaType.MARKDOWN))
    file.draw(streams.SUMMARY.entity, rr.TextDocument(summary, media_type=rr.MediaType.MARKDOWN))
    file.flush()


def _summary(
    runs: Sequence[RecordedRun],
    renamed: Sequence[Mapping[str, str]],
    divergence: Divergence | None,
    meets_at: AlignmentTick | None,
) -> str:
    lines = [f"**{runs[0].scenario.name}**: {len(runs)} runs", ""]
    for run, names in zip(runs, renamed, strict=True):
        lines.append(f"- **{', '.join(names.values())}**: {run.text}")
    if divergence is not None:
        lines += ["", f"### {divergence.text}"]
    if meets_at is not None:
        at_s = seconds_from_ticks(meets_at.tick, meets_at.tick_ns)
        lines += ["", f"### All have their first contact with gas at {at_s:g} s: others than A are moved in time."]
    lines += ["", "Room, gas and wind are those of run A."]
    return "\n".join(lines)


def _rename_chunks(
    recording: Path, names: Mapping[str, str], *, is_first: bool, meets_at: AlignmentTick | None = None
) -> Iterator[Chunk]:
    letter = next(iter(names.values())).partition("_")[0]
    chunks = shown_chunks(recording)
    shift_ticks = 0 if meets_at is None else meets_at.tick - _find_first_contact(chunks, recording)
    for unshifted in chunks:
        chunk = _shift_chunk(unshifted, shift_ticks, meets_at)
        path = str(chunk.entity_path).removeprefix("/")
        is_copied = not chunk.is_static or path.startswith(_COPIED_STATIC_ENTITIES)
        if path.split("/")[0] in _SHARED_ENTITIES:
            if is_first and is_copied:
                yield chunk
        elif path in _LOGS:
            yield from _prefix_texts(letter, chunk, path)
        elif (new_path := _rename_path(path, names)) is not None and is_copied:
            yield chunk.with_entity_path(new_path)


def _find_first_contact(chunks: Sequence[Chunk], recording: Path) -> int:
    ticks = [
        tick
        for chunk in chunks
        if not chunk.is_static and str(chunk.entity_path).startswith(f"/{streams.MARKS.root}/")
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


def _shift_chunk(chunk: Chunk, ticks: int, meets_at: AlignmentTick | None) -> Chunk:
    if meets_at is None or not ticks or chunk.is_static:
        return chunk
    batch: Any = chunk.to_record_batch()
    for name, step in ((TICK_TIMELINE, ticks), (TIME_TIMELINE, ticks * meets_at.tick_ns)):
        i = batch.schema.get_field_index(name)
        moved = pa.array(batch.column(i).cast(pa.int64()).to_numpy() + step).cast(batch.schema.field(i).type)
        batch = batch.set_column(i, batch.schema.field(i), moved)
    (piece,) = Chunk.from_record_batch(batch)
    return piece.with_entity_path(str(chunk.entity_path))


def _rename_path(path: str, names: Mapping[str, str]) -> str | None:
    for root in _AGENT_ENTITIES:
        if path.startswith(f"{root}/"):
            name, slash, rest = path[len(root) + 1 :].partition("/")
            return f"{root}/{names[name]}{slash}{rest}" if name in names else None
    return None


def _prefix_texts(letter: str, chunk: Chunk, path: str) -> list[Chunk]:
    batch = chunk.to_record_batch()
    i = batch.schema.get_field_index(streams.TEXTS)
    texts: list[list[str]] = batch.column(i).to_pylist()
    column = pa.array([[f"{letter}  {text}" for text in row] for row in texts], type=batch.schema.field(i).type)
    said = Chunk.from_record_batch(batch.set_column(i, batch.schema.field(i), column))
    return [piece.with_entity_path(f"{path}/{letter}") for piece in said]


# A line across the curves, and a point at the first vehicle's position in that tick.
def _mark_divergence(file: RecordingFile, scenario: Scenario, divergence: Divergence, chunks: Sequence[Chunk]) -> None:
    label = f"they part at {seconds_from_ticks(divergence.tick, scenario.tick_ns):g} s"
    names = build_entities(scenario)[0]
    place_m = _find_position_m(chunks, names.at(streams.TRACK), divergence.tick)
    if place_m is not None:
        columns = rr.Points3D.columns(positions=[place_m], labels=[label], radii=[0.15], show_labels=[True])
        file.draw(
            f"{names.at(streams.MARKS)}/{_DIVERGENCE_ENTITY}", rr.Points3D.from_fields(colors=[_DIVERGENCE_COLOR])
        )
        file.send(f"{names.at(streams.MARKS)}/{_DIVERGENCE_ENTITY}", [divergence.tick], columns)
    for plot in _MARKED_PLOTS:
        plotted = (each for each in chunks if not each.is_static and str(each.entity_path).startswith(f"/{plot}/"))
        batches: Iterator[Any] = (chunk.to_record_batch() for chunk in plotted)
        rows = (row for batch in batches for row in batch.column(streams.SCALARS).to_pylist())
        values = [float(value) for row in rows for value in row or ()]
        if values:
            entity = f"{plot}/{_DIVERGENCE_ENTITY}"
            # With aggregation the viewer would draw the mean of both ends.
            whole = rr.components.AggregationPolicy.Off
            line = rr.SeriesLines(names=[label], colors=[_DIVERGENCE_COLOR], widths=[1.5], aggregation_policy=whole)
            file.draw(entity, line)
            # One tick wide: of two values at one tick the viewer draws the last.
            ends = [min(values), max(values)]
            file.send(entity, [divergence.tick, divergence.tick + 1], rr.Scalars.columns(scalars=ends))
    file.send(
        f"{streams.EVENTS.entity}/parting",
        [divergence.tick],
        rr.TextLog.columns(text=[divergence.text], level=["WARN"]),
    )


def _find_position_m(chunks: Sequence[Chunk], vehicle: str, tick: int) -> Vec3 | None:
    for chunk in chunks:
        if str(chunk.entity_path) == f"/{vehicle}" and not chunk.is_static:
            batch: Any = chunk.to_record_batch()
            ticks: list[int] = batch.column(TICK_TIMELINE).to_pylist()
            if tick in ticks:
                x, y, z = batch.column(streams.TRACK.component).to_pylist()[ticks.index(tick)][0]
                return (x, y, z)
    return None
