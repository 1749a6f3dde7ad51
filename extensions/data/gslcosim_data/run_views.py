"""Recordings of several runs in one view, aligned by time or first contact."""

from collections.abc import Sequence
from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.base.ticks import seconds_from_ticks, ticks_from_seconds
from gslcosim.cli.arguments import DIGEST
from gslcosim.environment.store import load_environment
from gslcosim.runtime.replay.compare import RunComparison
from gslcosim.runtime.replay.past_run import PastRun, find_environment
from gslcosim_data.derived_recordings import Divergence, RecordedRun, record_from_tick, record_side_by_side


def record_runs(recordings: Sequence[Path], path: Path, *, is_by_contact: bool = False) -> None:
    """Write one recording of several runs, aligned by simulated time or by first contact with gas."""
    pasts = [PastRun.load(recording.parent) for recording in recordings]
    first = pasts[0]
    for past in pasts[1:]:
        if (past.environment_hash, past.scenario.tick_ns) != (first.environment_hash, first.scenario.tick_ns):
            raise UsageError(
                f"{past.run_dir.run_id}: expected a run in the room of {first.run_dir.run_id} "
                f"({first.environment_hash}) with ticks of {first.scenario.tick_ms} ms, was in "
                f"{past.environment_hash} with {past.scenario.tick_ms} ms. Look at each by itself."
            )
    runs = [
        RecordedRun(recording=recording, scenario=past.scenario, text=_describe_outcome(past))
        for recording, past in zip(recordings, pasts, strict=True)
    ]
    environment = load_environment(find_environment(first, lambda _: None), with_meshes=True)
    record_side_by_side(runs, environment, path, divergence=_find_first_divergence(pasts), is_by_contact=is_by_contact)


def record_run_at(recording: Path, path: Path, at_s: float, *, is_still: bool) -> None:
    """Write a copy of a run's recording that opens at a simulated time [s]."""
    past = PastRun.load(recording.parent, needs_result=False)
    environment = load_environment(find_environment(past, lambda _: None))
    tick = ticks_from_seconds(at_s, past.scenario.tick_ns)
    record_from_tick(recording, past.scenario, environment, path, tick=tick, is_still=is_still)


def _describe_outcome(past: PastRun) -> str:
    result = past.run_dir.load_result()
    reason = result["end_reason"].replace("_", " ")
    agents = "".join(
        f"; {agent['name']}: {agent['outcome'].replace('_', ' ')}, {agent['path_length_m']:.1f} m flown, ends "
        f"{agent['final_distance_m']:.2f} m from the source"
        for agent in result.get("agents", ())
    )
    return f"{reason} after {result.get('sim_time_s', 0.0):g} s{agents} ({past.run_dir.run_id})"


# The first tick at which one of the other runs differs from the first run.
def _find_first_divergence(pasts: Sequence[PastRun]) -> Divergence | None:
    folders = [past.run_dir.path for past in pasts]
    if not all((folder / DIGEST).is_file() for folder in folders):
        return None
    compared = (RunComparison.of(folders[0] / DIGEST, other / DIGEST) for other in folders[1:])
    partings = [(one.divergence, one.kinship) for one in compared if one.divergence is not None]
    if not partings:
        return None
    divergence, kinship = min(partings, key=lambda parting: parting[0].tick)
    tick_ns = pasts[0].scenario.tick_ns
    fork = "" if kinship is None else f" (forked at {seconds_from_ticks(kinship.tick, tick_ns):g} s)"
    time_s = seconds_from_ticks(divergence.tick, tick_ns)
    return Divergence(
        tick=divergence.tick,
        text=f"They part at {time_s:g} s{fork}: {divergence.participant}, {divergence.port}",
    )
