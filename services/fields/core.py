"""Fields core: true gas and wind at every sensor and probe, snapshots of the gas, and events of its sources."""

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ModelError
from gslcosim.base.ticks import exact_ticks_from_seconds, seconds_from_ticks
from gslcosim.contract import keys
from gslcosim.contract.environment_messages import PROBES, ProbeSample, ProbeSamples, SourceRate, build_source_port
from gslcosim.contract.messages import (
    BodyPoses,
    ConcentrationSlice,
    FieldSamples,
    FilamentCloud,
    GasAmount,
    MountSample,
)
from gslcosim.contract.participant import Episode, Inbox, Outbox
from gslcosim.contract.record import NumericArray, build_unchecked_constructor
from gslcosim.environment.model import AT_START, Closed, Environment
from gslcosim.environment.variants import ScaledWind
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import (
    SourceEventSpec,
    SourceMovesSpec,
    SourceRateSpec,
    SourceStartsSpec,
    SourceStopsSpec,
)
from gslcosim.scenario.models.scenario import find_due_events
from gslcosim_services.fields.filament.downwash import Downwash
from gslcosim_services.fields.filament.plume import FilamentPlume
from gslcosim_services.fields.filament.release import SourceChange
from gslcosim_services.fields.filament_field import FilamentField
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_services.fields.gas_field import GasField, PointGrid, wind_m_s_at
from gslcosim_services.fields.gas_setup import gas_seed, gas_timing
from gslcosim_services.fields.sample_points import Beams, MountPositions
from gslcosim_services.fields.service import fields_spec

# For the eye, 3 sigma are enough in a slice: beyond, a filament adds 1 % of its centre, at 2.5 times the cost.
SLICE_CUTOFF_SIGMA = 3.0

_new_amount, _new_sample, _new_samples, _new_cloud = (
    build_unchecked_constructor(GasAmount),
    build_unchecked_constructor(MountSample),
    build_unchecked_constructor(FieldSamples),
    build_unchecked_constructor(FilamentCloud),
)


class GasEvents:
    """Changes of sources: opened, closed, changed or moved by events, and rates that participants set."""

    def __init__(self, scenario: Scenario, gas: GasField) -> None:
        """Read the events and participants of a scenario."""
        self._scenario = scenario
        events = [event for event in scenario.events if isinstance(event, SourceEventSpec)]
        self._plume = gas.source if isinstance(gas, FilamentField) else None
        self._rate_ports = {i: build_source_port(i) for i in scenario.driven_sources}
        if (events or self._rate_ports) and not isinstance(self._plume, FilamentPlume):
            raise ModelError("events: expected gas whose sources can change, of model filament without a tape.")
        self._closed_at_first = initially_closed_sources(scenario)

    def reset(self) -> None:
        """Close the sources that an event starts; called after the gas was reset."""
        for i_source in self._closed_at_first:
            self._change(i_source, SourceChange(is_open=False))

    def obey(self, inbox: Inbox) -> None:
        """Apply what takes effect in this tick."""
        for i_source, port in self._rate_ports.items():
            rate = inbox.get(port)
            if isinstance(rate, SourceRate):
                self._change(i_source, self._change_rate(i_source, rate.filaments_per_s))
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, SourceEventSpec):
                self._change(event.source, self._change_of(event))

    def _change(self, i_source: int, change: SourceChange) -> None:
        assert isinstance(self._plume, FilamentPlume)
        self._plume.change_source(i_source, change)

    def _change_rate(self, i_source: int, filaments_per_s: float) -> SourceChange:
        return SourceChange(share=filaments_per_s / self._scenario.gas.sources[i_source].filaments_per_s)

    def _change_of(self, event: SourceEventSpec) -> SourceChange:
        match event:
            case SourceStartsSpec():
                return SourceChange(is_open=True)
            case SourceStopsSpec():
                return SourceChange(is_open=False)
            case SourceMovesSpec():
                return SourceChange(position_world_m=event.to_m)
            case SourceRateSpec():
                return self._change_rate(event.source, event.filaments_per_s)
            case _:
                raise ModelError(f"events: expected an event of a source that is known, was {event.what!r}.")


def initially_closed_sources(scenario: Scenario) -> list[int]:
    """Return the sources that are closed at first: their first start or stop in the list of events is a start."""
    firsts: dict[int, bool] = {}
    for event in scenario.events:
        if isinstance(event, SourceStartsSpec | SourceStopsSpec):
            firsts.setdefault(event.source, isinstance(event, SourceStartsSpec))
    return [i for i, is_start in firsts.items() if is_start]


class FieldsCore:
    """Advances the gas and samples gas and wind where the sensors are.

    Reads `truth/bodies` of the same tick, `truth/wind` of the last one where a service drives the wind,
    `truth/sources/<index>` of the last one where a participant sets the rate of a source, and `truth/events` of the
    last one where sources or the wind have events. Writes `truth/samples` every tick, with `truth/probes` where the
    scenario has probes, and `truth/filaments` at tick 0 and every `recording.gas_every_s`. Readings see filaments with
    a cut-off at 5 sigma (3 with `compatibility: gaden_3`) and along free lines of sight; slices are cut off at 3 sigma
    and pass through walls.

    `gas` is the present gas, `gases` are its names in the order of the columns of `compute_gas_ppm`.
    Invariants: no filament in a solid cell; equal seeds give equal messages.
    Raises ModelError on a wind, filament or sample that is not finite; the runtime then ends the run as invalid.
    """

    def __init__(self, scenario: Scenario, environment: Environment) -> None:
        """Build the plume of a scenario in its room."""
        self._scenario = scenario
        self._environment = environment
        self.spec = fields_spec(scenario)
        self._timing = gas_timing(scenario)
        self._mounts = MountPositions(scenario)
        n_readings_per_step = self._mounts.n_places * self._timing.ticks_per_step
        self._wind = ScaledWind(environment, scenario) if scenario.has_wind_that_changes else None
        wind_at = None if self._wind is None else self._wind.at
        self.gas: GasField = build_gas_field(
            scenario, environment, n_readings_per_step=n_readings_per_step, wind_at=wind_at
        )
        self._gas_events = GasEvents(scenario, self.gas)
        self._probes = scenario.probes or ()
        self._probes_m = np.array([probe.position_m for probe in self._probes]).reshape(-1, 3)
        self._beams = Beams(scenario, environment)
        self._downwash = Downwash(scenario)
        self.gases, gas = self.gas.gases, self.gas
        self._gas_ahead = gas if isinstance(gas, FilamentField) and not self._downwash.is_on else None
        self._slice_height_m = scenario.slice_height_m
        self._snapshot_ticks = exact_ticks_from_seconds(
            scenario.recording.gas_every_s, scenario.tick_ns, name="recording.gas_every_s"
        )

    def compute_gas_ppm(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (n, n_gases) mixing ratios [ppm by volume] at (n, 3) points in the room, world frame [m]."""
        indexed = {"is_indexed": True} if isinstance(self.gas, FilamentField) else {}
        return self.gas.mixing_ratio_ppm_at(points_world_m, **indexed)

    def compute_wind_m_s(self, points_world_m: NDArray[np.float64], tick: int) -> NDArray[np.float64]:
        """Return the (n, 3) wind [m/s] at points in the room, world frame [m]; `tick` is that of the last step."""
        return self._wind_at(points_world_m, tick)

    def reset(self, episode: Episode) -> Outbox:
        """Start again with a plume of the age `gas.warm_up_s`; no message is written once."""
        if self._wind is not None:
            self._wind.reset()
        self._beams.close_doors(AT_START)
        self.gas.reset(gas_seed(self._scenario, episode.seed))
        self._gas_events.reset()
        is_short = episode.is_warmup and self._gas_ahead is not None and self._gas_ahead.is_live
        self.gas.advance(1 if is_short else self._timing.warm_up_steps)
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Bring the gas to the end of the tick and sample it there."""
        bodies = cast(BodyPoses, inbox[keys.BODIES])
        if self._wind is not None and self._wind.obey(inbox):
            self._close_doors(self._wind.room.variant.closed)
        self._gas_events.obey(inbox)
        self._advance(self._timing.steps_at(tick), bodies)
        outbox: dict[str, FieldSamples | FilamentCloud | ProbeSamples] = {keys.SAMPLES: self._samples(tick, bodies)}
        if tick % self._snapshot_ticks == 0:
            outbox[keys.FILAMENTS] = self._cloud(tick)
        if self._probes:
            outbox[PROBES] = self._probe_samples(tick)
        return outbox

    def prefetch(self) -> bool:
        """Advance the gas while the core waits; see `SupportsPrefetch`."""
        return self._gas_ahead is not None and self._gas_ahead.prefetch()

    def _close_doors(self, closed: Closed) -> None:
        self._beams.close_doors(closed)
        if not isinstance(self.gas, FilamentField):
            raise ModelError("events: expected gas that follows doors, of model filament without a tape.")
        self.gas.close_doors(closed)

    # Jets are those of the tick's end; a filament is first carried by the room's air, then by them.
    def _advance(self, n_steps: int, bodies: BodyPoses) -> None:
        if not (self._downwash.is_on and isinstance(self.gas, FilamentField)):
            self.gas.advance(n_steps)
            return
        jets = self._downwash.compute_jets(bodies)
        for _ in range(n_steps):
            self.gas.advance(1)
            self.gas.blow(jets)

    def _samples(self, tick: int, bodies: BodyPoses) -> FieldSamples:
        places_m = self._mounts.positions_world_m(bodies)
        gas_ppm = self.gas.mixing_ratio_ppm_at(places_m).tolist()
        wind_m_s = self._wind_at(places_m, tick).tolist()
        if not all(math.isfinite(sum(ppm) + sum(wind)) for ppm, wind in zip(gas_ppm, wind_m_s, strict=True)):
            raise ModelError(f"fields: gas or wind at a sensor is not finite in tick {tick}: {gas_ppm}, {wind_m_s}.")
        amounts = [self._amounts(ppm) for ppm in gas_ppm]
        samples = [
            _new_sample(
                agent=mount.agent,
                sensor=mount.sensor,
                gases=amounts[mount.i_place],
                wind_world_m_s=tuple(wind_m_s[mount.i_place]),
            )
            for mount in self._mounts.mounts
        ]
        return _new_samples(tick=tick, samples=tuple(self._with_beams(samples, bodies) if self._beams else samples))

    # Apart from the mounts, so that their sums do not depend, even in the last digit, on the number of probes.
    def _probe_samples(self, tick: int) -> ProbeSamples:
        gas_ppm = self.compute_gas_ppm(self._probes_m)
        wind_m_s = self._wind_at(self._probes_m, tick)
        is_finite = np.isfinite(gas_ppm).all(axis=1) & np.isfinite(wind_m_s).all(axis=1)
        if not is_finite.all():
            name = self._probes[int(np.argmin(is_finite))].name
            raise ModelError(f"fields: gas or wind at probe {name} is not finite in tick {tick}.")
        samples = (
            ProbeSample(
                probe=probe.name,
                gases=self._amounts(ppm),
                wind_world_m_s=(wind[0], wind[1], wind[2]),
            )
            for probe, ppm, wind in zip(self._probes, gas_ppm.tolist(), wind_m_s.tolist(), strict=True)
        )
        return ProbeSamples(tick=tick, samples=tuple(samples))

    # An instrument with a beam measures the mean along it instead of the gas at its mount.
    def _with_beams(self, samples: list[MountSample], bodies: BodyPoses) -> list[MountSample]:
        beams = self._beams.points_of(bodies)
        return [self._with_beam(s, *beams[s.agent, s.sensor]) if (s.agent, s.sensor) in beams else s for s in samples]

    def _with_beam(self, sample: MountSample, beam_m: float, points_m: NDArray[np.float64]) -> MountSample:
        n_gases = len(self.gas.gases)
        means = self.gas.mixing_ratio_ppm_at(points_m).mean(axis=0) if len(points_m) else np.zeros(n_gases)
        return sample.model_copy(update={"gases": self._amounts(means.tolist()), "beam_m": beam_m})

    def _amounts(self, ppm: list[float]) -> tuple[GasAmount, ...]:
        return tuple(_new_amount(gas=gas, mixing_ratio_ppm=x) for gas, x in zip(self.gases, ppm, strict=True))

    def _wind_at(self, places_m: NDArray[np.float64], tick: int) -> NDArray[np.float64]:
        time_s = self._scenario.gas.warm_up_s + seconds_from_ticks(tick, self._scenario.tick_ns)
        return wind_m_s_at(self.gas, self._environment, places_m, time_s)

    def _cloud(self, tick: int) -> FilamentCloud:
        filaments = self.gas.filaments
        gas_index = filaments.gas_index[filaments.source_index].astype(np.uint8)
        return _new_cloud(
            tick=tick,
            gases=self.gas.gases,
            position_world_m=NumericArray.from_array(filaments.position_world_m.astype(np.float32)),
            sigma_m=NumericArray.from_array(filaments.sigma_m.astype(np.float32)),
            gas_index=NumericArray.from_array(gas_index),
            slices=tuple(self._slice(i) for i in range(len(self.gas.gases))),
        )

    def _slice(self, i_gas: int) -> ConcentrationSlice:
        grid, cell_m = self._environment.grid, self._scenario.recording.slice_cell_m
        size_m = np.subtract(grid.max_m, grid.origin_m)
        nx, ny = (max(1, math.ceil(side_m / cell_m - 1e-9)) for side_m in size_m[:2])
        first_m = (grid.origin_m[0] + 0.5 * cell_m, grid.origin_m[1] + 0.5 * cell_m, self._slice_height_m)
        points = PointGrid(first_m=first_m, spacing_m=cell_m, shape=(nx, ny, 1))
        ppm = self.gas.mixing_ratio_ppm_on_grid(points, gas=i_gas, cutoff_sigma=SLICE_CUTOFF_SIGMA)
        return ConcentrationSlice(
            gas=self.gas.gases[i_gas],
            origin_m=(float(grid.origin_m[0]), float(grid.origin_m[1])),
            cell_m=cell_m,
            height_m=self._slice_height_m,
            mixing_ratio_ppm=NumericArray.from_array(ppm[:, :, 0].astype(np.float32)),
        )
