"""A run read back as arrays; `gslcosim_data.open_run` opens it."""

from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.contract.messages import Command
from gslcosim.environment.generation.cache import prepare_variants, with_variants
from gslcosim.environment.model import Environment
from gslcosim.environment.store import load_environment
from gslcosim.environment.variants import first_variant
from gslcosim.runtime.replay.past_run import PastRun, find_environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import SourceEventSpec
from gslcosim_data import streams
from gslcosim_data.recording_reader import RecordingReader
from gslcosim_data.streams import (
    RecordedBeliefs,
    RecordedDoor,
    RecordedFilaments,
    RecordedNotes,
    RecordedPictures,
    RecordedPoints,
    RecordedSeries,
    RecordedShapes,
    RecordedSlices,
    RecordedTexts,
    RecordedTrack,
)
from gslcosim_services.recorder.entities import build_entities
from gslcosim_services.recorder.stream_table import (
    CONTACTS,
    EVENTS,
    FAULTS,
    MARKS,
    RADIO,
    SOURCE_MARKS,
    WAYPOINTS,
    Stream,
)

if TYPE_CHECKING:
    import pyarrow as pa
    import xarray as xr


T = TypeVar("T")


def open_run(path: Path | str) -> "RunData":
    """Open a run that has ended, or was killed and whose recording was made whole.

    Args:
        path: The run's folder, or a file in it.

    Raises:
        UsageError: it is no run, has no recording, or spoke another contract.
        RecordingError: the recording was cut off, or is none of ours.
    """
    folder = Path(path)
    return RunData(folder if folder.is_dir() else folder.parent)


class RunData:
    """Everything a run has left, as arrays that are read where they are asked for.

    What is by agent is a mapping from the names of agents; see `gslcosim_data.streams` for the shapes.
    `result` is None where the run was killed before it had one.
    """

    def __init__(self, folder: Path) -> None:
        """Read the small files of a run's folder, and what its recording holds.

        Raises:
            UsageError: it is no run, has no recording, or spoke another contract.
            RecordingError: the recording was cut off, or is none of ours.
        """
        self._past = PastRun.load(folder, needs_result=False)
        self.folder = folder
        self.run_id = self._past.run_dir.run_id
        self.scenario: Scenario = self._past.scenario
        has_result = (folder / "result.json").is_file()
        self.result: Mapping[str, Any] | None = self._past.run_dir.load_result() if has_result else None
        self.manifest: Mapping[str, Any] = self._past.run_dir.load_manifest()
        if not self._past.run_dir.recording.is_file():
            raise UsageError(
                f"{self.run_id}: expected a run with a recording.rrd, found none. Record it now: "
                f"gslcosim replay {folder}\nFile: {self._past.run_dir.recording}"
            )
        self._rows = RecordingReader(self._past.run_dir.recording)
        self._agents = {names.agent.name: names for names in build_entities(self.scenario)}

    def __repr__(self) -> str:
        """Return what the run is: scenario, seed, methods, and how it ended."""
        flown = ", ".join(f"{agent} ({method})" for agent, method in self.methods.items())
        if self.result is None:
            ended = "without a result"
        else:
            outcomes = ", ".join(f"{agent['name']} {agent['outcome']}" for agent in self.result["agents"])
            ended = f"{self.result['sim_time_s']:.1f} s simulated, {outcomes}"
        return f"<Run {self.run_id}: seed {self.scenario.seed}, {flown}; {ended}>"

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of all agents, in the scenario's order."""
        return tuple(self._agents)

    @property
    def tick_s(self) -> float:
        """The length of a tick [s]."""
        return self.scenario.tick_ns * 1e-9

    @property
    def methods(self) -> Mapping[str, str]:
        """By agent the name of its method; see `name_method`."""
        return self.scenario.methods

    @cached_property
    def table_names(self) -> tuple[str, ...]:
        """Names of all tables that `table` gives, one for each stream and agent."""
        from gslcosim_data.tables import build_tables

        return tuple(table.name for table in build_tables(self))

    def table(self, name: str) -> "pa.Table":
        """Return one stream as an Arrow table; `.to_pandas()` makes a data frame of it.

        Args:
            name: One of `table_names`, such as `track_beetle`; or what several agents have, such as `track` or
                `readings`: then the tables of all agents below each other, with a column `agent` first.

        Returns:
            The same columns as the files of `gslcosim extract`; each field has `meaning` and `unit` as metadata.

        Raises:
            UsageError: the run has no table of that name.
        """
        from gslcosim_data.tables import read_table

        return read_table(self, name)

    def to_xarray(self) -> "xr.Dataset":
        """Return the gas in the layer of the map as an xarray dataset: see `build_gas_dataset`.

        Raises:
            UsageError: the extra `xarray` is not installed, or the run recorded no gas.
        """
        from gslcosim_data.gas_dataset import build_gas_dataset

        return build_gas_dataset(self)

    @property
    def commands(self) -> Mapping[str, tuple[Command, ...]]:
        """By agent the commands that took effect, by tick; exact, from `inputs.log`."""
        logged = self._past.commands
        return {name: tuple(command for _, command in sorted(logged.get(name, {}).items())) for name in self._agents}

    def _of_agents(self, read: Callable[..., Iterable[T]], **options: Any) -> tuple[T, ...]:
        return tuple(
            one for names in self._agents.values() for one in read(self._rows, self.scenario, names, **options)
        )

    def _read_points(self, stream: Stream) -> Mapping[str, RecordedPoints]:
        places = {name: names.at(stream) for name, names in self._agents.items()}
        return {name: streams.read_points(self._rows, self.scenario, entity) for name, entity in places.items()}

    @cached_property
    def tracks(self) -> Mapping[str, RecordedTrack]:
        """By agent where its vehicle was."""
        return {name: streams.read_track(self._rows, self.scenario, names) for name, names in self._agents.items()}

    @cached_property
    def samples(self) -> tuple[RecordedSeries, ...]:
        """The truth at all sensors of gas and wind."""
        return self._of_agents(streams.read_samples)

    @cached_property
    def readings(self) -> tuple[RecordedSeries, ...]:
        """Readings of all sensors, as far as they are numbers."""
        return self._of_agents(streams.read_readings)

    @cached_property
    def figures(self) -> tuple[RecordedSeries, ...]:
        """Figures of the referee and the controllers: `distance`, `tracking_error`, `belief_mass_near` and so on."""
        return self._of_agents(streams.read_figures)

    @cached_property
    def service_curves(self) -> tuple[RecordedSeries, ...]:
        """Curves written by services of other packages."""
        return tuple(streams.read_service_curves(self._rows, self.scenario))

    @cached_property
    def waypoints(self) -> Mapping[str, RecordedPoints]:
        """By agent where it was sent."""
        return self._read_points(WAYPOINTS)

    @cached_property
    def marks(self) -> Mapping[str, RecordedPoints]:
        """By agent what happened where: `start`, `first gas`, `declared`, `touches …`."""
        return self._read_points(MARKS)

    @cached_property
    def source_marks(self) -> tuple[RecordedPoints, ...]:
        """For each source what happened to it where; nothing where no event is about a source."""
        if not any(isinstance(event, SourceEventSpec) for event in self.scenario.events):
            return ()
        entities = (SOURCE_MARKS.at(source=str(i)) for i in range(len(self.scenario.gas.sources)))
        return tuple(streams.read_points(self._rows, self.scenario, entity) for entity in entities)

    @cached_property
    def beliefs(self) -> Mapping[str, RecordedBeliefs]:
        """By agent its beliefs, of those that have published any."""
        found: dict[str, RecordedBeliefs] = {}
        for name, commands in self.commands.items():
            beliefs = [(command.tick, command.belief) for command in commands if command.belief is not None]
            if beliefs:
                tick = np.array([at for at, _ in beliefs], dtype=np.int64)
                time_s = streams.tick_times_s(tick, self.scenario)
                found[name] = RecordedBeliefs(tick=tick, time_s=time_s, belief=tuple(belief for _, belief in beliefs))
        return found

    @cached_property
    def notes(self) -> Mapping[str, RecordedNotes]:
        """By agent the notes of its method on its own state, of those that have written any."""
        found: dict[str, RecordedNotes] = {}
        for name, commands in self.commands.items():
            notes = [(command.tick, command.note) for command in commands if command.note is not None]
            if notes:
                tick = np.array([at for at, _ in notes], dtype=np.int64)
                names = dict.fromkeys(value for _, note in notes for value in note.values)
                found[name] = RecordedNotes(
                    tick=tick,
                    time_s=streams.tick_times_s(tick, self.scenario),
                    mode=tuple(note.mode for _, note in notes),
                    values={each: np.array([note.values.get(each, np.nan) for _, note in notes]) for each in names},
                )
        return found

    @cached_property
    def gas_slices(self) -> Mapping[str, RecordedSlices]:
        """By gas the mixing ratio in the layer of the map."""
        return streams.read_slices(self._rows, self.scenario)

    @cached_property
    def filaments(self) -> RecordedFilaments:
        """The cloud over time; without snapshots where the gas is not of filaments."""
        return streams.read_filaments(self._rows, self.scenario)

    @cached_property
    def point_clouds(self) -> tuple[RecordedShapes, ...]:
        """Points that lidars saw."""
        return self._of_agents(streams.read_shapes, are_rays=False)

    @cached_property
    def rays(self) -> tuple[RecordedShapes, ...]:
        """Rays of range finders and lasers."""
        return self._of_agents(streams.read_shapes, are_rays=True)

    @cached_property
    def pictures(self) -> tuple[RecordedPictures, ...]:
        """Pictures of cameras."""
        return self._of_agents(streams.read_pictures)

    @cached_property
    def events(self) -> RecordedTexts:
        """The referee's log."""
        return streams.read_texts(self._rows, self.scenario, EVENTS)

    @cached_property
    def contacts(self) -> RecordedTexts:
        """Contacts of vehicles with solid things."""
        return streams.read_texts(self._rows, self.scenario, CONTACTS)

    @cached_property
    def radio(self) -> RecordedTexts:
        """Texts between agents and what became of them."""
        return streams.read_texts(self._rows, self.scenario, RADIO)

    @cached_property
    def faults(self) -> RecordedTexts:
        """Faults of agents, at their tick."""
        return streams.read_texts(self._rows, self.scenario, FAULTS)

    @cached_property
    def doors(self) -> Mapping[str, RecordedDoor]:
        """By name when each door was closed, of those that events move."""
        names = [door.name for door in self.scenario.environment.doors]
        doors = {name: streams.read_door(self._rows, self.scenario, name) for name in names}
        return {name: door for name, door in doors.items() if len(door.tick)}

    def closed_at(self, time_s: float) -> tuple[str, ...]:
        """Return the names of the doors that are closed at a simulated time [s], sorted."""
        closed = set(first_variant(self.scenario).closed)
        for name, door in self.doors.items():
            i = int(np.searchsorted(door.time_s, time_s + 1e-9, side="right")) - 1
            if i >= 0:
                (closed.add if door.is_closed[i] else closed.discard)(name)
        return tuple(sorted(closed))

    def room_at(self, time_s: float) -> Environment:
        """Return the room with the doors as they are at a simulated time [s], and some wind that belongs to them."""
        closed, room = self.closed_at(time_s), self.environment
        if closed == first_variant(self.scenario).closed:
            return room
        return next(later for situation, later in room.later_rooms.items() if situation.closed == closed)

    @cached_property
    def environment(self) -> Environment:
        """The room with its occupancy and wind; made again where it is no longer in the cache, which takes its time.

        `later_rooms` are those that events make of it.

        Raises:
            EnvironmentDataError: it is not the one that was run in.
        """
        environment = load_environment(find_environment(self._past, lambda _: None))
        return with_variants(environment, prepare_variants(self.scenario, scenario_dir=self.folder))

    def wind_m_s(self, time_s: float) -> NDArray[np.float32]:
        """Return the (nx, ny, nz, 3) wind of the environment at a simulated time [s], world frame [m/s]."""
        wind = self.environment.wind
        return wind.velocity_m_s[wind.frame_at(self.scenario.gas.warm_up_s + time_s)]

    def figure(self, agent: str, quantity: str) -> RecordedSeries | None:
        """Return one of `figures`; None where there is none."""
        return next((one for one in self.figures if (one.agent, one.quantity) == (agent, quantity)), None)
