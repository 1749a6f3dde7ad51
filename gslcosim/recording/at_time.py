"""A recording that opens at a simulated time: played from there on, or, for pictures, as it was then."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import rerun.blueprint as rrb
from rerun.blueprint.components import AbsoluteTimeRange
from rerun.chunk import Chunk

from gslcosim.environment.model import Environment
from gslcosim.errors import RecordingError
from gslcosim.recording import entities
from gslcosim.recording.layout.blueprint import default_blueprint
from gslcosim.recording.reading.stored_rows import read_chunks
from gslcosim.recording.run_file import TICK_TIMELINE, TIME_TIMELINE, RunFile
from gslcosim.recording.summary import title
from gslcosim.scenario import Scenario
from gslcosim.ticks import seconds_from_ticks


def record_from_tick(
    recording: Path, scenario: Scenario, environment: Environment, path: Path, *, tick: int, is_still: bool
) -> None:
    """Write a copy of a recording that opens at a tick.

    The viewer has no other way to be told where its cursor stands than to play a selection, or to follow the end.

    Args:
        recording: A run's recording.
        scenario: What was flown.
        environment: Where.
        path: The file to write.
        tick: Where it opens.
        is_still: Whether what comes later is left out, and nothing plays; otherwise the viewer plays from there on.

    Raises:
        RecordingError: the recording cannot be read, or ends before.
    """
    chunks = shown_chunks(recording)
    last_tick = max((last for chunk in chunks if (last := _last_tick(chunk)) is not None), default=0)
    if tick > last_tick:
        at_s, end_s = (seconds_from_ticks(each, scenario.tick_ns) for each in (tick, last_tick))
        raise RecordingError(f"--at: expected a time within the recording, which ends at {end_s:g} s, was {at_s:g} s.")
    believers = sorted({name for chunk in chunks if (name := _believer_of(chunk))})
    blueprint = default_blueprint(scenario, environment, believers=believers)
    if not is_still:
        blueprint = _played(blueprint, tick, last_tick, scenario.tick_ns)
    file = RunFile(
        path,
        run_id=recording.resolve().parent.name,
        name=title(scenario),
        tick_ns=scenario.tick_ns,
        blueprint=blueprint,
    )
    try:
        file.send_chunks(_until(chunks, tick) if is_still else chunks)
    finally:
        file.close()


def shown_chunks(recording: Path) -> list[Chunk]:
    """Return all chunks of a recording but its properties.

    Raises:
        RecordingError: it cannot be read.
    """
    return [chunk for chunk in read_chunks(recording) if not str(chunk.entity_path).startswith("/__")]


def _played(blueprint: rrb.Blueprint, tick: int, last_tick: int, tick_ns: int) -> rrb.Blueprint:
    blueprint.time_panel = rrb.TimePanel(
        state="expanded",
        timeline=TIME_TIMELINE,
        play_state="playing",
        loop_mode="selection",
        time_selection=AbsoluteTimeRange(min=tick * tick_ns, max=max(last_tick, tick + 1) * tick_ns),
    )
    return blueprint


def _until(chunks: Sequence[Chunk], tick: int) -> Iterator[Chunk]:
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


def _believer_of(chunk: Chunk) -> str | None:
    root, _, name = str(chunk.entity_path).removeprefix("/").partition("/")
    return name if root == entities.BELIEFS else None
