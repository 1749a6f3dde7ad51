# pyright: reportAttributeAccessIssue=false
"""World core: the vehicles of all agents in one environment, advanced tick by tick, and checks of their starts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import ModelError, ScenarioError
from gslcosim.base.quantities import GRAVITY_M_S2, PHYSICS_STEP_MS, Vec3
from gslcosim.base.scalar_kernels import distance
from gslcosim.base.ticks import NS_PER_S, seconds_from_ticks
from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses, BodyState, Command
from gslcosim.contract.participant import Episode, Inbox, Outbox
from gslcosim.contract.record import NumericArray, build_unchecked_constructor
from gslcosim.environment.model import Environment
from gslcosim.environment.paths.planner import warm_up_planner
from gslcosim.environment.variants import ScaledWind
from gslcosim.scenario.models.scenario import AgentSpec, Scenario
from gslcosim.scenario.models.sensors import ImuSensorSpec
from gslcosim.vehicles import Vehicle, get_vehicle
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.autopilot import Autopilot, Reference
from gslcosim_services.world.flight_space import CLEARANCE_M, FlightSpace, RoutePlanner, build_route_planner
from gslcosim_services.world.leg_planners import warm_up_leg_planning
from gslcosim_services.world.multirotor_control import RotorFaults
from gslcosim_services.world.obstacle_avoidance import ObstacleAvoidance
from gslcosim_services.world.scene import DoorGeoms, Scene, build_scene, register_mujoco_state
from gslcosim_services.world.separation import Neighbours, warm_up_separation
from gslcosim_services.world.service import world_spec
from gslcosim_services.world.simulation_loop import SceneArrays, run_substeps_inplace
from gslcosim_services.world.trajectory import to_vec3
from gslcosim_services.world.vehicle_records import VehicleCapabilities, derive_capabilities

_new_body = build_unchecked_constructor(BodyState)

# Contact allowed at the start: vehicles stand on the surface below them [m].
_MIN_GAP_M = 1e-3
# Point robots have no fast dynamics: alone, they take this longer step where it fits the tick.
POINT_ROBOT_STEP_MS = 20
# A start within this of its support stands on it [m]; a higher one starts hovering in the air.
_MAX_STANDING_HEIGHT_M = 0.5
# Cosine to the vertical of the direction in which something carries a wheel, at least.
_MIN_SUPPORT_COSINE = 0.7

_new_poses = build_unchecked_constructor(BodyPoses)


@dataclass(frozen=True, kw_only=True)
class VehicleViews:
    """Views of one vehicle's part of the arrays that the compiled loop reads and writes.

    `constants` and `state` are its records of `records.CONSTANTS` and `records.STATE`; `pose` is its position and
    quaternion (7,), `motion` its velocity in the world and its rates in the body frame (6,), in MuJoCo's arrays;
    `inertial` has a row for each physics step (absent: no IMU).
    """

    constants: Any
    state: Any
    pose: NDArray[np.float64]
    motion: NDArray[np.float64]
    inertial: NDArray[np.float64] | None


@dataclass(frozen=True, kw_only=True)
class StartState:
    """Start of a vehicle at tick 0: its position, world frame [m], and the choice between hovering and standing."""

    position_world_m: Vec3
    is_flying: bool


class SimulatedVehicle:
    """One vehicle of a run, from its agent's commands to its reported state.

    State: its guide; its path so far; its position at the end of the last tick, world frame [m]; its contacts in
    this tick; and its last support. `name` is the agent's.
    """

    def __init__(self, name: str, new_guide: Callable[[], Autopilot], start: StartState, rows: VehicleViews) -> None:
        self.name = name
        self._build_autopilot = new_guide
        self._start = start
        self._rows = rows
        self._autopilot = new_guide()
        self._reference: Reference = self._autopilot.reference
        self._path_length_m = 0.0
        self.position_m = start.position_world_m
        self._touched: set[str] = set()
        self._supports: frozenset[str] = frozenset()

    @property
    def yields(self) -> bool:
        """True while the vehicle yields to others where that is needed."""
        return self._autopilot.yields

    @property
    def true_motion(self) -> tuple[Vec3, Vec3]:
        """Position [m] and velocity [m/s] in MuJoCo's scene, world frame."""
        return to_vec3(self._rows.pose[:3]), to_vec3(self._rows.motion[:3])

    def reset(self) -> None:
        """Rest at the start. The owner of the scene resets it, and then calls `place`."""
        self._autopilot = self._build_autopilot()
        self._reference = self._autopilot.reference
        self._path_length_m = 0.0
        self.position_m = self._start.position_world_m
        self._touched.clear()
        self._supports = frozenset()
        rows = self._rows
        rows.state[...] = np.zeros((), vehicle_records.STATE)
        if self._start.is_flying:
            rows.state["rotor_speed_rad_s"] = vehicle_records.hover_rotor_speed_rad_s(rows.constants)
        if rows.inertial is not None:
            # At rest nothing is felt but what carries it.
            rows.inertial[:] = 0.0
            rows.inertial[:, 2] = GRAVITY_M_S2

    def place(self) -> None:
        """Put it upright at its start."""
        self._rows.pose[:] = (*self._start.position_world_m, 1.0, 0.0, 0.0, 0.0)

    def begin_tick(self) -> None:
        """Forget what was touched in the last tick."""
        self._touched.clear()

    def touch(self, thing: str) -> None:
        """Take note of a contact with a thing."""
        self._touched.add(thing)

    def stand(self) -> None:
        """Take note that the things touched now carry it."""
        self._supports = frozenset(self._touched)

    def obey(self, tick: int, command: Command | None) -> None:
        """Take the agent's command at the start of a tick."""
        self._follow(self._autopilot.begin_tick(tick, command))

    def avoid_neighbours(self, tick: int, neighbours: Neighbours) -> None:
        """Avoid other vehicles."""
        self._follow(self._autopilot.avoid_neighbours(tick, neighbours))

    def end_tick(self, tick: int) -> None:
        """Update the autopilot with the state that physics has reached."""
        guide, rows = self._autopilot, self._rows
        x_m, y_m, z_m, w, x, y, z = rows.pose.tolist()
        u, v, climb_m_s, *_ = rows.motion.tolist()
        position_m = (x_m, y_m, z_m)
        self._path_length_m += distance(position_m, self.position_m)
        self.position_m = position_m
        was_landing = guide.phase == "landing"
        reference = guide.end_tick(
            tick,
            position_m,
            (u, v, climb_m_s),
            yaw_rad=elementary.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)),
            uprightness=1.0 - 2.0 * (x * x + y * y),
        )
        self._follow(reference)
        if was_landing and guide.phase == "on_ground":
            self.stand()

    def body(self, tick: int, tick_ns: int) -> BodyState:
        """Return the vehicle's state at the end of a tick."""
        guide, rows = self._autopilot, self._rows
        # Contact with the ground before the end of a take-off is no collision.
        is_leaving = guide.phase == "failed" and not guide.has_taken_off
        touched = self._touched - self._supports if is_leaving else self._touched
        w, x, y, z = rows.pose[3:].tolist()
        u, v, speed_w, omega_x, omega_y, omega_z = rows.motion.tolist()
        return _new_body(
            agent=self.name,
            position_world_m=self.position_m,
            quaternion_wxyz=(w, x, y, z),
            velocity_world_m_s=(u, v, speed_w),
            angular_velocity_body_rad_s=(omega_x, omega_y, omega_z),
            phase=guide.phase,
            awaiting_command=guide.awaiting_command,
            path_length_m=self._path_length_m,
            waypoint_world_m=guide.waypoint_world_m,
            contacts=tuple(sorted(touched)),
            rejected_command=guide.notice,
            tracking_error_m=self._tracking_error_m(tick, tick_ns),
            planned_path_world_m=guide.planned_path_world_m,
            inertial_body=None if rows.inertial is None else NumericArray.from_array(rows.inertial),
        )

    def _tracking_error_m(self, tick: int, tick_ns: int) -> float | None:
        reference = self._reference
        if reference.setpoint is not None or not reference.is_armed or tick == 0:
            return None
        return distance(self.position_m, reference.trajectory.position_at(tick, tick_ns))

    def _follow(self, reference: Reference) -> None:
        if reference is self._reference:
            return
        self._reference = reference
        state = self._rows.state
        state["is_armed"] = reference.is_armed
        if reference.setpoint is None:
            vehicle_records.set_trajectory(state, reference.trajectory)
        else:
            vehicle_records.set_setpoint(state, reference.setpoint)


def check_starts(
    agents: Sequence[AgentSpec], spaces: Sequence[FlightSpace], starts: Sequence[tuple[Vec3, bool]]
) -> None:
    """Check that vehicles start and rise in free places and apart from one another.

    Args:
        spaces: Flight space of each agent's vehicle.
        starts: Start of each, world frame [m], and whether it hovers there.
    """
    problems: list[str | None] = []
    for i, (agent, space, (start_m, is_flying)) in enumerate(zip(agents, spaces, starts, strict=True)):
        name = f"agents.{agent.name}.vehicle"
        problems.append(space.find_start_refusal(f"{name}.start_m", start_m))
        problems.append(_find_height_problem(name, agent, space, start_m, is_flying=is_flying))
        for other, other_space, (other_m, _) in list(zip(agents, spaces, starts, strict=True))[:i]:
            apart_m, needed_m = distance(start_m, other_m), space.radius_m + other_space.radius_m
            if apart_m < needed_m:
                problems.append(
                    f"{name}.start_m: expected at least {needed_m:g} m from {other.name}'s vehicle, was {apart_m:g} m."
                )
    if any(problems):
        raise ScenarioError("\n".join(problem for problem in problems if problem))


def check_overlaps(scene: Scene, data: mujoco.MjData, agents: Sequence[AgentSpec]) -> None:
    """Check that no vehicle at its start reaches into a box or another vehicle.

    Args:
        data: Its state, with contacts, all vehicles at their starts.
    """
    problems = []
    for i, (geom_a, geom_b) in enumerate(data.contact.geom.tolist()):
        depth_m = -float(data.contact.dist[i])
        for geom, other in ((geom_a, geom_b), (geom_b, geom_a)):
            if depth_m > _MIN_GAP_M and scene.agent_of_geom[geom] >= 0:
                problems.append(
                    f"agents.{agents[scene.agent_of_geom[geom]].name}.vehicle.start_m: expected a start that touches "
                    f"nothing but what it stands on, was {depth_m:.3f} m inside {scene.thing_of_geom[other]}."
                )
    if problems:
        raise ScenarioError("\n".join(dict.fromkeys(problems)))


def _find_height_problem(
    name: str, agent: AgentSpec, space: FlightSpace, start_m: Vec3, *, is_flying: bool
) -> str | None:
    x_m, y_m, z_m = start_m
    if space.ground_height_m is None:
        return space.refusal(f"{name}.search_height_m", (x_m, y_m, agent.vehicle.search_height_m))
    if is_flying:
        return f"{name}.start_m: expected a start on the floor for a {agent.vehicle.model}, was {z_m:g} m high."
    return None


register_mujoco_state()


class WorldCore:
    """Vehicles of all agents in one MuJoCo scene, with control at 250 Hz (50 Hz when there are only point robots).

    Reads `command/<agent>` with the agent's latency; writes `truth/bodies` every tick.
    `data` is the state of the MuJoCo scene, `states` (n,) records of `vehicle_records.STATE`.
    Invariants: every vehicle's state is finite; every waypoint on the way is free and inside the room.
    Raises ModelError when a state explodes, naming the agent; the runtime then ends the run as invalid.
    It draws no random numbers: the seed does not matter to it.
    """

    def __init__(self, scenario: Scenario, environment: Environment) -> None:
        self.spec = world_spec(scenario)
        self._tick_ns = scenario.tick_ns
        self._environment = environment
        self._wind = _build_wind(environment, scenario)
        self._warm_up_s = scenario.gas.warm_up_s
        self._agents = scenario.agents
        models = [get_vehicle(agent.vehicle.model) for agent in self._agents]
        doors = self._wind.room if scenario.environment.doors else None
        spaces = [FlightSpace(environment=environment, radius_m=model.body.radius_m, doors=doors) for model in models]
        self._least_m = _min_distances_m(self._agents, [space.radius_m for space in spaces])
        step_ms = physics_step_ms(models, scenario.tick_ms)
        self._n_substeps = scenario.tick_ms // step_ms
        dt_s = step_ms * 1e-3
        self._scene = build_scene(environment, list(zip((a.name for a in self._agents), models, strict=True)), dt_s)
        self._has_wheels = any(self._scene.is_rolling)
        self.data = mujoco.MjData(self._scene.model)
        self._constants = _build_constants(self._scene, self._agents, models, dt_s)
        self._door_geoms = DoorGeoms(environment, self._scene, doors)
        self._rotor_faults = RotorFaults(scenario, self._constants)
        self.states = np.zeros(len(self._agents), vehicle_records.STATE)
        has_imu = [any(isinstance(sensor, ImuSensorSpec) for sensor in agent.sensors) for agent in self._agents]
        self._inertial = np.zeros((len(self._agents), self._n_substeps if any(has_imu) else 0, 9))
        self._i_velocities = np.add.outer(self._constants["i_qvel"], np.arange(3))
        grid = environment.grid
        self._scene_arrays = SceneArrays.of(self._scene.model, self.data)
        self._wind_grid = (np.array(grid.origin_m, np.float64), float(grid.cell_m))
        self._routes: dict[tuple[object, ...], RoutePlanner] = {}
        starts = [
            _find_start_state(agent, space, half_height_m)
            for agent, space, half_height_m in zip(self._agents, spaces, self._scene.half_height_m, strict=True)
        ]
        self._vehicles: list[SimulatedVehicle] = []
        for k, (agent, start) in enumerate(zip(self._agents, starts, strict=True)):
            abilities = derive_capabilities(agent.vehicle, models[k], self._constants[k], self._scene.half_height_m[k])
            if abilities.has_wheels:
                spaces[k] = replace(spaces[k], ground_height_m=start.position_world_m[2])
            spaces[k] = replace(spaces[k], moves_places=agent.vehicle.avoidance != "none")
            new_guide = partial(
                Autopilot,
                agent,
                spaces[k],
                abilities,
                self._tick_ns,
                start.position_world_m,
                avoidance=self._avoidance(agent, spaces[k], abilities),
            )
            self._vehicles.append(SimulatedVehicle(agent.name, new_guide, start, self._records(k, has_imu=has_imu[k])))
        check_starts(self._agents, spaces, [(start.position_world_m, start.is_flying) for start in starts])
        self._place_vehicles()
        check_overlaps(self._scene, self.data, self._agents)
        self._tick = -1

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled MuJoCo scene."""
        return self._scene.model

    def reset(self, episode: Episode) -> Outbox:
        """Put every vehicle at rest at its start; nothing is written once."""
        del episode
        self._wind.reset()
        self._door_geoms.show()
        self._rotor_faults.reset()
        for vehicle in self._vehicles:
            vehicle.reset()
        self._place_vehicles()
        self._tick = -1
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Advance all vehicles to the end of a tick and return their states.

        Args:
            tick: 0 is the state at rest.
            inbox: Commands that take effect at the start of this tick.
        """
        if tick != self._tick + 1:
            raise ModelError(f"world: expected tick {self._tick + 1}, was {tick}.")
        self._tick = tick
        for vehicle in self._vehicles:
            vehicle.begin_tick()
        if tick == 0:
            self._note_contacts(b"")
            for vehicle in self._vehicles:
                vehicle.stand()
        else:
            self._wind.obey(inbox)
            self._door_geoms.show()
            self._rotor_faults.obey(inbox)
            for vehicle in self._vehicles:
                command = inbox.get(keys.command(vehicle.name))
                vehicle.obey(tick, command if isinstance(command, Command) else None)
            self._keep_apart(tick)
            self._fly(tick)
        return {keys.BODIES: _new_poses(tick=tick, bodies=tuple(c.body(tick, self._tick_ns) for c in self._vehicles))}

    def warm_up(self) -> None:
        """Run all code that is used only during motion, on behalf of vehicles: legs, planning and separation."""
        warm_up_leg_planning()
        if self._routes:
            warm_up_planner()
        if any(agent.vehicle.separation_m for agent in self._agents):
            warm_up_separation(self._environment)

    # Vehicles of a kind have one model of the room.
    def _avoidance(
        self, agent: AgentSpec, space: FlightSpace, abilities: VehicleCapabilities
    ) -> ObstacleAvoidance | None:
        mode, height_m = agent.vehicle.avoidance, space.ground_height_m
        if mode == "none":
            return None
        ground = None if height_m is None else (height_m, height_m - abilities.standing_height_m)
        key = (mode, space.radius_m, ground)
        if key not in self._routes:
            self._routes[key] = build_route_planner(
                self._environment, mode, radius_m=space.radius_m, ground=ground, doors=space.doors
            )
        routes, has_wheels = self._routes[key], abilities.has_wheels
        return ObstacleAvoidance(routes=routes, limits=abilities.limits, tick_ns=self._tick_ns, has_wheels=has_wheels)

    def _place_vehicles(self) -> None:
        mujoco.mj_resetData(self._scene.model, self.data)
        for vehicle in self._vehicles:
            vehicle.place()
        mujoco.mj_forward(self._scene.model, self.data)

    # All read the others' present positions, then all decide.
    def _keep_apart(self, tick: int) -> None:
        is_yielding = [vehicle.yields for vehicle in self._vehicles]
        if not any(is_yielding):
            return
        gives_way = np.array(is_yielding)
        positions_m = np.array([vehicle.position_m for vehicle in self._vehicles])
        velocities_m_s = self.data.qvel[self._i_velocities]
        for k, vehicle in enumerate(self._vehicles):
            if not is_yielding[k]:
                continue
            neighbours = Neighbours(
                own=k,
                positions_m=positions_m,
                velocities_m_s=velocities_m_s,
                least_m=self._least_m[k],
                yields=gives_way,
            )
            vehicle.avoid_neighbours(tick - 1, neighbours)

    def _fly(self, tick: int) -> None:
        # The wind is as old as the gas: its time 0 is the opening of the sources.
        frame = self._wind.at(self._warm_up_s + seconds_from_ticks(tick - 1, self._tick_ns))
        i_substep, noted = 0, b""
        while i_substep < self._n_substeps:
            i_substep, i_unsound, has_contacts = run_substeps_inplace(
                i_substep, self._n_substeps, tick, self._tick_ns / NS_PER_S, self._constants, self.states,
                self._inertial, self._scene_arrays, frame, *self._wind_grid,
            )  # fmt: skip
            if i_unsound >= 0:
                raise ModelError(self._implausible_state_text(self._vehicles[i_unsound]))
            if has_contacts and self.data.ncon:
                noted = self._note_contacts(noted)
        for vehicle in self._vehicles:
            vehicle.end_tick(tick)

    # A wheel's contact with the ground is no collision; its contact with anything else is. A vehicle at rest has the
    # same contacts in each sub-step: without wheels it is enough to note them once in a tick.
    def _note_contacts(self, noted: bytes) -> bytes:
        scene, contact = self._scene, self.data.contact
        geoms = contact.geom
        now = b"" if self._has_wheels else geoms.tobytes()
        if now and now == noted:
            return noted
        for i, (geom_a, geom_b) in enumerate(geoms.tolist()):
            if (scene.is_rolling[geom_a] or scene.is_rolling[geom_b]) and abs(
                contact.frame[i][2]
            ) > _MIN_SUPPORT_COSINE:
                continue
            agent_a, agent_b = scene.agent_of_geom[geom_a], scene.agent_of_geom[geom_b]
            if agent_a >= 0:
                self._vehicles[agent_a].touch(scene.thing_of_geom[geom_b])
            if agent_b >= 0:
                self._vehicles[agent_b].touch(scene.thing_of_geom[geom_a])
        return now

    def _implausible_state_text(self, vehicle: SimulatedVehicle) -> str:
        return (
            f"world: expected a finite, plausible state of {vehicle.name}'s vehicle at tick {self._tick}, "
            "was position {} m, velocity {} m/s.".format(*vehicle.true_motion)
        )

    def _records(self, k: int, *, has_imu: bool) -> VehicleViews:
        i_qpos, i_qvel = int(self._constants[k]["i_qpos"]), int(self._constants[k]["i_qvel"])
        return VehicleViews(
            constants=self._constants[k],
            state=self.states[k, ...],
            pose=self.data.qpos[i_qpos : i_qpos + 7],
            motion=self.data.qvel[i_qvel : i_qvel + 6],
            inertial=self._inertial[k] if has_imu else None,
        )


# One compiled kernel serves all winds: read-only, as they come from a memory map.
def _build_wind(environment: Environment, scenario: Scenario) -> ScaledWind:
    for frames in (environment.wind, *(room.wind for room in environment.later_rooms.values())):
        wind = frames.velocity_m_s
        if wind.dtype != np.float32 or not wind.flags.c_contiguous:
            raise ModelError(f"wind: expected contiguous float32, was {wind.dtype} with strides {wind.strides}.")
    return ScaledWind(environment, scenario)


def physics_step_ms(models: Sequence[Vehicle], tick_ms: int) -> int:
    """Return the length of a physics step [ms] for vehicles of one scene."""
    if tick_ms % POINT_ROBOT_STEP_MS == 0 and not any(model.rotors or model.wheels for model in models):
        return POINT_ROBOT_STEP_MS
    n_substeps, rest_ms = divmod(tick_ms, PHYSICS_STEP_MS)
    if rest_ms or not n_substeps:
        below = max(1, n_substeps) * PHYSICS_STEP_MS
        raise ScenarioError(
            f"tick_ms: expected a whole number of {PHYSICS_STEP_MS} ms physics steps, was {tick_ms} ms. "
            f"Nearest: {below} ms or {below + PHYSICS_STEP_MS} ms."
        )
    return PHYSICS_STEP_MS


def _find_start_state(agent: AgentSpec, space: FlightSpace, half_height_m: float) -> StartState:
    x_m, y_m, z_m = agent.vehicle.start_m
    standing_m = space.support_height_m(agent.vehicle.start_m) + half_height_m
    if abs(z_m - standing_m) <= _MAX_STANDING_HEIGHT_M:
        return StartState(position_world_m=(x_m, y_m, standing_m), is_flying=False)
    return StartState(position_world_m=(x_m, y_m, z_m), is_flying=True)


def _build_constants(
    scene: Scene, agents: Sequence[AgentSpec], models: Sequence[Vehicle], dt_s: float
) -> NDArray[np.void]:
    constants = np.zeros(len(agents), vehicle_records.CONSTANTS)
    for k, (agent, model) in enumerate(zip(agents, models, strict=True)):
        vehicle_records.set_constants(constants[k], model, scene.model, f"{agent.name}/", dt_s)
    return constants


# Distance between the centres of each pair, (n, n): the greater requirement of the two, and enough not to touch.
def _min_distances_m(agents: Sequence[AgentSpec], radii_m: Sequence[float]) -> NDArray[np.float64]:
    wishes_m = np.array([agent.vehicle.separation_m for agent in agents])
    return np.maximum(np.maximum.outer(wishes_m, wishes_m), np.add.outer(radii_m, radii_m) + CLEARANCE_M)
