"""Builder of cases: from scenarios to the records of the kernels; refuses what cannot be batched."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import UsageError
from gslcosim.base.scalar_kernels import distance, norm3
from gslcosim.base.ticks import NS_PER_S, ticks_from_seconds
from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses, Briefing
from gslcosim.contract.participant import Episode
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.model import Environment
from gslcosim.environment.store import load_environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.models.gas import FilamentsSpec
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.models.success import AllSourcesSuccess, SourceSuccess
from gslcosim.vehicles import Vehicle, get_vehicle
from gslcosim_formats.gaussian_plume import MeanderingPlumeGasSpec
from gslcosim_search.learned.encoding import MARGIN_M, ObservationVector
from gslcosim_services.fields.gas_setup import list_gas_names
from gslcosim_services.sensing.briefing import build_briefing
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.core import POINT_ROBOT_STEP_MS, WorldCore, physics_step_ms
from gslcosim_services.world.vehicle_records import derive_capabilities, hover_rotor_speed_rad_s
from gslcosim_training.batch import batch_records
from gslcosim_training.batch.batch_records import Cases
from gslcosim_training.batch.case_records import (
    ELSE,
    BatchGas,
    BatchInstruments,
    BatchRooms,
    is_gas_supported,
    list_wander_streams,
)
from gslcosim_training.batch.contact_scene import ContactScene
from gslcosim_training.path_lengths import PathLengths
from gslcosim_training.stepped_run import get_environment_key

# How vehicles fly: point robots alone, to the bit of a single flight; or rotorcraft too, as point masses, or as rigid
# bodies with rotors, which are those of a single flight but for rounding.
EXACT, FIRST_ORDER, RIGID = "exact", "first_order", "rigid_body"
FLYING = (EXACT, FIRST_ORDER, RIGID)
# Their streams' names are equally long.
_MOST_MEANDERING = 10
# A vehicle has left what it stands on when it is so far from everything [m].
_CLEAR_M = 0.01


@dataclass(frozen=True, kw_only=True)
class PreparedCases:
    """Cases as kernels take them; `kept` holds what their addresses point into.

    `briefing` is that of the first case, `names` those of the numbers of an observation, `lengths` of free paths
    to the sources; `scenes` are what vehicles may touch, by case; `n_memory` is how many numbers a search keeps of its
    sensors and of wandering paths, `n_wanders` how many such paths it has, `most_filaments` how many filaments the
    largest frame of a tape has.
    """

    cases: Cases
    briefing: Briefing
    names: tuple[str, ...]
    lengths: PathLengths = field(repr=False)
    scenes: tuple[ContactScene, ...] = field(repr=False)
    n_memory: int
    n_wanders: int
    most_filaments: int
    kept: Sequence[object] = field(repr=False)


def find_batch_refusal(scenario: Scenario, flying: str = EXACT) -> str | None:
    """Return why a scenario cannot be batched, in one sentence with the remedy, or nothing.

    Args:
        flying: One of `FLYING`: how its vehicle is to fly.
    """
    for key, expected, found in list_batch_misfits(scenario, flying):
        return f"{key}: expected {expected}, was {found}. {ELSE}"
    return None


def list_batch_misfits(scenario: Scenario, flying: str) -> Iterable[tuple[str, str, object]]:
    """Yield what keeps a scenario from being batched: its key, what is expected there, and what was found.

    Args:
        flying: One of `FLYING`: how its vehicle is to fly.
    """
    if len(scenario.agents) != 1:
        yield "agents", "one agent in a batch", len(scenario.agents)
        return
    agent, vehicle = scenario.agents[0], scenario.agents[0].vehicle
    kind = vehicle.facts.kind
    if kind != "holonomic" and flying == EXACT:
        also = f", or flying {FIRST_ORDER} or {RIGID}" if kind == "multirotor" else ""
        yield "agents[0].vehicle.model", f"holonomic in a batch{also}", vehicle.model
    if kind not in ("holonomic", "multirotor"):
        yield "agents[0].vehicle.model", "holonomic or a rotorcraft in a batch", vehicle.model
    if agent.mode_name not in ("on_request", "lockstep"):
        yield "agents[0].mode", "on_request or lockstep in a batch", agent.mode_name
    if vehicle.hold_rule is not None:
        yield "agents[0].vehicle.hold_rule", "none in a batch", vehicle.hold_rule
    if vehicle.avoidance != "none":
        yield "agents[0].vehicle.avoidance", "none in a batch", vehicle.avoidance
    if not is_gas_supported(scenario):
        expected = "gaussian_plume, meandering_plume, playback, or filament without rotor_downwash, in a batch"
        yield "gas.model", expected, f"{scenario.gas.model}{' with it' if scenario.gas.rotor_downwash else ''}"
    if isinstance(scenario.gas, FilamentsSpec) and scenario.gas.eddies is not None:
        yield "gas.turbulence.kind", "none in a batch", scenario.gas.eddies.kind
    if isinstance(scenario.gas, FilamentsSpec) and scenario.gas.wall_images:
        yield "gas.wall_images", "false in a batch", "true"
    if isinstance(scenario.gas, MeanderingPlumeGasSpec) and len(scenario.gas.sources) > _MOST_MEANDERING:
        yield "gas.sources", f"at most {_MOST_MEANDERING} that meander in a batch", len(scenario.gas.sources)
    if not isinstance(scenario.referee.success, SourceSuccess | AllSourcesSuccess):
        yield "referee.success.of", "source or all_sources in a batch", scenario.referee.success.of
    if not scenario.referee.stop.on_collision:
        yield "referee.stop.on_collision", "true in a batch", "false"
    if scenario.events:
        yield "events", "none in a batch", f"{len(scenario.events)}"
    if scenario.has_wind_that_changes:
        yield "wind", "wind that no service drives in a batch", "one that does"
    if scenario.channels:
        yield "channels", "none in a batch: radio needs several agents", f"{len(scenario.channels)}"


class _Preparing:
    """Gathers cases; see `prepare_cases`."""

    def __init__(self, hold_s: float | None, flying: str, action: str) -> None:
        self._hold_s = hold_s
        self.lengths = PathLengths(action)
        self._flying = flying
        self.rooms = BatchRooms()
        self._environments: dict[str, Environment] = {}
        self._starts: dict[tuple[Any, ...], tuple[int, NDArray[np.float64]]] = {}
        self._scenes: dict[tuple[Any, ...], ContactScene] = {}
        self.scenes: list[ContactScene] = []
        self.gas = BatchGas()
        self.cases: list[NDArray[np.void]] = []
        self.vehicles: list[NDArray[np.void]] = []
        self.instruments: list[BatchInstruments] = []
        self.start_rows: list[NDArray[np.float64]] = []
        self.sources_m: list[tuple[float, float, float]] = []
        self.n_start_rows = self.n_name = self.n_wanders = self.n_memory = 0
        self.names_of_streams = b""
        self.briefing: Briefing | None = None
        self.names: tuple[str, ...] = ()

    def add(self, loaded: LoadedScenario) -> None:
        scenario = loaded.scenario
        if (refusal := find_batch_refusal(scenario, self._flying)) is not None:
            raise UsageError(f"{scenario.name}: {refusal}")
        agent, environment = scenario.agents[0], self._environment(loaded)
        names = self._names(agent, scenario, environment)
        gases = list_gas_names(scenario.gas)
        if len(gases) > batch_records.MOST_GASES:
            raise UsageError(
                f"{scenario.name}: gas.sources: expected at most {batch_records.MOST_GASES} gases in a batch, was "
                f"{len(gases)}. {ELSE}"
            )
        instruments = BatchInstruments(agent, scenario, gases, names, self.n_name)
        self.n_name += len(instruments.names)
        self.instruments.append(instruments)
        self._add_case(scenario, agent, environment, instruments.n_sampled)
        self.lengths.add(scenario, agent, environment)
        self._add_wandering(self.cases[-1], scenario, instruments)

    # Names of streams are one after the other, those of sensors first.
    def _add_wandering(self, case: Any, scenario: Scenario, instruments: BatchInstruments) -> None:
        names, n_wanders = list_wander_streams(scenario), 2 * len(scenario.gas.sources)
        self.n_memory = max(self.n_memory, instruments.n_memory)
        self.names_of_streams += instruments.names + names
        if names:
            case["first_wander_name"], case["n_wander_name"] = self.n_name, len(names) // n_wanders
            case["first_knot"] = instruments.n_memory
            self.n_name += len(names)
            self.n_wanders = max(self.n_wanders, n_wanders)
            self.n_memory = max(self.n_memory, instruments.n_memory + n_wanders * int(case["n_knots"]))

    def _environment(self, loaded: LoadedScenario) -> Environment:
        key = get_environment_key(loaded)
        if key not in self._environments:
            folder = prepare_environment(loaded.scenario, scenario_dir=loaded.directory)
            self._environments[key] = load_environment(folder)
        return self._environments[key]

    def _names(self, agent: AgentSpec, scenario: Scenario, environment: Environment) -> tuple[str, ...]:
        briefing = build_briefing(agent, scenario, environment, seed=scenario.seed)
        names = ObservationVector(briefing).names
        self.briefing = self.briefing or briefing
        self.names = self.names or names
        if names != self.names:
            other = ", ".join(sorted(set(names) ^ set(self.names)))
            raise UsageError(
                f"{scenario.name}: agents[0].sensors: expected the sensors of the first case, was others ({other}). "
                "Give all cases of a batch sensors of the same names and models, in one order."
            )
        return names

    def _add_case(self, scenario: Scenario, agent: AgentSpec, environment: Environment, n_sampled: int) -> None:
        case = np.zeros((), batch_records.CASE)
        spec, model, stop = agent.vehicle, get_vehicle(agent.vehicle.model), scenario.referee.stop
        tick_ns = scenario.tick_ns
        step_ms = physics_step_ms([model], scenario.tick_ms)
        case["tick_ns"], case["tick_s"] = tick_ns, tick_ns / NS_PER_S
        case["n_substeps"], case["physics_step_s"] = scenario.tick_ms // step_ms, step_ms * 1e-3
        case["radius_m"], case["half_height_m"] = model.body.radius_m, model.body.half_height_m
        scene = self._scene(environment, model, scenario.tick_ms, step_ms)
        vehicle = scene.constants
        reach_m = model.body.radius_m
        if model.rotors is not None and self._flying == RIGID:
            if not vehicle["is_plain_body"]:
                raise UsageError(
                    f"{scenario.name}: agents[0].vehicle.model: expected one body with its centre of mass at its "
                    f"origin, flying {RIGID}, was {model.name}. Fly it {FIRST_ORDER}, or alone in gslcosim/Search-v0."
                )
            case["dynamics"], case["hull_half_m"] = batch_records.RIGID_BODY, scene.hull_half_m
            reach_m = max(reach_m, norm3(*scene.hull_half_m))
        elif model.rotors is not None:
            _fill_lags(case, model, vehicle, scenario.tick_ms)
        case["room"] = self.rooms.number_of(scenario, environment, reach_m)
        limits = derive_capabilities(spec, model, vehicle, model.body.half_height_m).limits
        case["max_speed_m_s"], case["max_acceleration_m_s2"] = limits.max_speed_m_s, limits.max_acceleration_m_s2
        rows = self._start_rows(case, scenario, environment, reach_m)
        case["start_m"] = rows[0, :3]
        case["search_height_m"] = spec.search_height_m
        case["usual_hold_ticks"] = ticks_from_seconds(spec.hold_s, tick_ns)
        case["hold_ticks"] = ticks_from_seconds(spec.hold_s if self._hold_s is None else self._hold_s, tick_ns)
        case["asks_every_tick"] = agent.is_asked_every_tick
        case["time_limit_s"], case["ends_on_collision"] = stop.time_limit_s, stop.on_collision
        self._add_sources(case, scenario, spec.start_m)
        case["n_sampled"] = n_sampled
        self.gas.add(case, scenario, environment)
        low, high = np.array(environment.grid.origin_m), np.array(environment.grid.max_m)
        case["centre_m"], case["half_m"] = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
        case["least_m"], case["most_m"] = low + MARGIN_M, np.maximum(high - MARGIN_M, low + MARGIN_M)
        case["diagonal_m"] = distance(environment.grid.origin_m, environment.grid.max_m)
        self.cases.append(case)
        self.vehicles.append(vehicle)

    def _add_sources(self, case: Any, scenario: Scenario, start_m: tuple[float, float, float]) -> None:
        success, places_m = scenario.referee.success, [source.position_m for source in scenario.gas.searched]
        case["first_source"], case["n_sources"] = len(self.sources_m), len(places_m)
        self.sources_m += places_m
        is_all = isinstance(success, AllSourcesSuccess)
        case["criterion"] = batch_records.ALL_SOURCES if is_all else batch_records.NEAREST_SOURCE
        case["within_m"], case["is_horizontal"] = success.within_m, success.is_horizontal
        case["first_place_m"] = start_m
        case["first_distance_m"] = min(distance(start_m, place_m) for place_m in places_m)

    # Rooms of a kind have one scene.
    def _scene(self, environment: Environment, model: Vehicle, tick_ms: int, step_ms: int) -> ContactScene:
        key = (environment.content_hash, model.name, tick_ms)
        if key not in self._scenes:
            self._scenes[key] = ContactScene(environment, model, step_ms * 1e-3, tick_ms // step_ms)
        self.scenes.append(self._scenes[key])
        return self._scenes[key]

    # A ball on the floor is lifted with contact forces: as MuJoCo has it, once for all cases that start there.
    def _start_rows(
        self, case: Any, scenario: Scenario, environment: Environment, reach_m: float
    ) -> NDArray[np.float64]:
        vehicle = scenario.agents[0].vehicle.model_dump(mode="json")
        key = (environment.content_hash, scenario.tick_ns, scenario.gas.warm_up_s, repr(vehicle))
        if key not in self._starts:
            rows = _first_rows(WorldCore(scenario, environment), environment, reach_m)
            self._starts[key] = (self.n_start_rows, rows)
            self.n_start_rows += len(rows)
            self.start_rows.append(rows)
        first, rows = self._starts[key]
        case["first_start_row"], case["n_start_rows"] = first, len(rows)
        return rows


def prepare_cases(
    loaded: Sequence[LoadedScenario],
    hold_s: float | None,
    flying: str = EXACT,
    report: Callable[[int, int], None] | None = None,
    action: str = "velocity",
) -> PreparedCases:
    """Prepare cases: their rooms, starts, gas and sensors.

    Args:
        hold_s: How long a waypoint is held and a velocity kept [s]; absent: as each scenario says.
        flying: One of `FLYING`.
    """
    if not loaded:
        raise UsageError("cases: expected at least one scenario, was none.")
    preparing = _Preparing(hold_s, flying, action)
    for n_done, each in enumerate(loaded, start=1):
        preparing.add(each)
        if report is not None:
            report(n_done, len(loaded))
    assert preparing.briefing is not None, "there is a case"
    # There is a place for the wind at a vehicle without sensors too.
    n_places = max(1, *(len(instruments.places_m) for instruments in preparing.instruments))
    places_m = np.zeros((len(loaded), n_places, 3))
    for i, instruments in enumerate(preparing.instruments):
        places_m[i, : len(instruments.places_m)] = instruments.places_m
    gas = preparing.gas
    cases = Cases(
        rooms=preparing.rooms.array(),
        cases=np.array(preparing.cases, batch_records.CASE),
        vehicles=np.array(preparing.vehicles, vehicle_records.CONSTANTS),
        plumes=gas.plume_array(),
        tapes=np.array(gas.tapes, batch_records.TAPE),
        frames=np.array(gas.frames, batch_records.FRAME),
        frame_of_update=np.array(gas.frame_of_update, np.int64),
        strengths=np.array(gas.strengths, np.float64),
        gas_of_source=np.array(gas.gas_of_source, np.int64),
        instruments=np.array([instruments.rows for instruments in preparing.instruments]),
        names=np.frombuffer(preparing.names_of_streams, np.uint8),
        start_rows=np.concatenate(preparing.start_rows),
        sources_m=np.array(preparing.sources_m, np.float64),
        places_m=places_m,
    )
    return PreparedCases(
        cases=cases,
        briefing=preparing.briefing,
        names=preparing.names,
        lengths=preparing.lengths,
        scenes=tuple(preparing.scenes),
        n_memory=preparing.n_memory,
        n_wanders=preparing.n_wanders,
        most_filaments=gas.most_filaments,
        kept=(*preparing.rooms.kept, *gas.kept, *(kept for each in preparing.instruments for kept in each.kept)),
    )


def lags_s(vehicle: Vehicle) -> tuple[float, float]:
    """Return the time constants of a rotorcraft's sideways and upward force [s].

    Its attitude obeys e'' + k_omega e' + k_R e = 0, which for a slow e is a lag of k_omega/k_R; its rotors have one of
    their own, faster up than down, which both forces wait for.
    """
    control, rotors = vehicle.control, vehicle.rotors
    assert control is not None, "a rotorcraft has control"
    assert rotors is not None, "a rotorcraft has rotors"
    rotors_s = (rotors.time_constant_up_s + rotors.time_constant_down_s) / 2
    return control.rate_gain_s[0] / control.attitude_gain_s2[0] + rotors_s, rotors_s


# How a rotorcraft flies in a case, see `autopilot.fly_lagged_tick`.
def _fill_lags(case: Any, vehicle: Vehicle, constants: Any, tick_ms: int) -> None:
    # As long as point robots' steps, or whole ticks where those are no whole number of them.
    n_substeps = max(1, round(tick_ms / POINT_ROBOT_STEP_MS))
    step_s = tick_ms * 1e-3 / n_substeps
    tilt_s, lift_s = lags_s(vehicle)
    case["dynamics"], case["n_substeps"], case["physics_step_s"] = batch_records.LAGGED, n_substeps, step_s
    case["tilt_share"], case["lift_share"] = -elementary.expm1(-step_s / tilt_s), -elementary.expm1(-step_s / lift_s)
    case["rotor_speeds_rad_s"] = int(constants["n_rotors"]) * hover_rotor_speed_rad_s(constants)


# The state of a vehicle at the end of each tick, see `batch_records.N_START_NUMBERS`, until it is clear.
def _first_rows(core: WorldCore, environment: Environment, reach_m: float) -> NDArray[np.float64]:
    floors = {box.name for box in environment.boxes if box.kind == "floor"} | {"floor"}
    boxes_m = np.array([(*box.min_m, *box.max_m) for box in environment.boxes], np.float64).reshape(-1, 6)
    core.reset(Episode(seed=0))
    rows: list[tuple[float, ...]] = []
    while True:
        poses = core.step(len(rows), {})[keys.BODIES]
        assert isinstance(poses, BodyPoses)
        body = poses.bodies[0]
        is_touching = any(name not in floors for name in body.contacts)
        touches = (float(is_touching), float(bool(body.contacts)))
        state = core.states[0]
        rows.append(
            (*body.position_world_m, *body.velocity_world_m_s, *touches, *body.quaternion_wxyz,
             *body.angular_velocity_body_rad_s, *state["rotor_speed_rad_s"], *state["integral_m_s2"])
        )  # fmt: skip
        place_m = np.array(body.position_world_m)
        gaps_m = np.linalg.norm(np.maximum(np.maximum(boxes_m[:, :3] - place_m, place_m - boxes_m[:, 3:]), 0.0), axis=1)
        is_clear = place_m[2] > environment.grid.origin_m[2] + reach_m + _CLEAR_M
        if is_clear and (not len(gaps_m) or gaps_m.min() > reach_m + _CLEAR_M):
            return np.array(rows)
        if body.phase not in ("on_ground", "taking_off"):
            return np.array(rows)
