"""World: vehicles in a room, flown by physics, one tick at a time."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from gslcosim.contract import keys
from gslcosim.contract.arrays import NumericArray
from gslcosim.contract.messages import BodyPoses, BodyState, Command
from gslcosim.contract.participant import Episode, Inbox, Outbox, ParticipantSpec
from gslcosim.environment.model import Environment
from gslcosim.environment.paths.planning import rehearse_planning
from gslcosim.errors import ModelError, ScenarioError
from gslcosim.quantities import GRAVITY_M_S2, PHYSICS_STEP_MS, Vec3
from gslcosim.scenario.models.onboard import ImuSensorSpec
from gslcosim.scenario.models.scenario import AgentSpec, Scenario
from gslcosim.ticks import NS_PER_S, seconds_from_ticks
from gslcosim.vehicles import Vehicle, vehicle_of
from gslcosim.world.guidance.abilities import Abilities, abilities_of
from gslcosim.world.guidance.avoidance import Avoidance
from gslcosim.world.guidance.mission import Mission
from gslcosim.world.guidance.separation import Neighbours, rehearse_separation
from gslcosim.world.guidance.starts import check_overlaps, check_starts
from gslcosim.world.paths.routes import Routes, routes_of
from gslcosim.world.paths.space import CLEARANCE_M, FlightSpace
from gslcosim.world.physics import records
from gslcosim.world.physics.flight_kernels import fly_substeps_inplace
from gslcosim.world.physics.mujoco_kernels import step_address
from gslcosim.world.physics.scene import Scene, build_scene
from gslcosim.world.ports import world_spec

# Point robots have no fast dynamics: alone, they take this longer step where it fits the tick.
POINT_ROBOT_STEP_MS = 20

# A start within this of its support stands on it [m]; a higher one starts hovering in the air.
_STANDS_WITHIN_M = 0.5
# Cosine to the vertical of the direction in which something carries a wheel, at least.
_SUPPORTS_FROM = 0.7


class WorldCore:
    """Vehicles of all agents in one MuJoCo scene, with control at 250 Hz (50 Hz when there are only point robots).

    Reads `command/<agent>` with the agent's latency; writes `truth/bodies` every tick.
    Invariants: every vehicle's state is finite; every waypoint flown to is free and inside the room.
    Raises ModelError when a state explodes, naming the agent; the runtime then ends the run as invalid.
    It draws no random numbers: the seed does not matter to it.
    """

    def __init__(self, scenario: Scenario, environment: Environment) -> None:
        self._spec = world_spec(scenario)
        self._tick_ns = scenario.tick_ns
        self._environment = environment
        self._agents = scenario.agents
        models = [vehicle_of(agent.vehicle.model) for agent in self._agents]
        spaces = [FlightSpace(environment=environment, radius_m=model.body.radius_m) for model in models]
        self._least_m = _distances_to_keep_m(self._agents, [space.radius_m for space in spaces])
        step_ms = _physics_step_ms(models, scenario.tick_ms)
        self._n_substeps = scenario.tick_ms // step_ms
        dt_s = step_ms * 1e-3
        self._scene = build_scene(environment, list(zip((a.name for a in self._agents), models, strict=True)), dt_s)
        self._starts = [
            _resting_place(agent, space, half_height_m)
            for agent, space, half_height_m in zip(self._agents, spaces, self._scene.half_height_m, strict=True)
        ]
        self._constants = _constants(self._scene, self._agents, models, dt_s)
        self._states = np.zeros(len(self._agents), records.STATE)
        self._has_imu = [any(isinstance(sensor, ImuSensorSpec) for sensor in agent.sensors) for agent in self._agents]
        n_rows = self._n_substeps if any(self._has_imu) else 0
        self._inertial = np.zeros((len(self._agents), n_rows, 9))
        self._missions: list[Mission] = []
        self._routes: dict[tuple[object, ...], Routes] = {}
        for k, agent in enumerate(self._agents):
            abilities = abilities_of(agent.vehicle, models[k], self._constants[k], self._scene.half_height_m[k])
            if abilities.has_wheels:
                spaces[k] = replace(spaces[k], ground_height_m=self._starts[k][0][2])
            spaces[k] = replace(spaces[k], moves_places=agent.vehicle.avoidance != "none")
            avoidance = self._avoidance(agent, spaces[k], abilities)
            self._missions.append(Mission(agent, spaces[k], abilities, self._tick_ns, avoidance=avoidance))
        check_starts(self._agents, spaces, self._starts)
        self._data = mujoco.MjData(self._scene.model)
        self._set_loop_arguments()
        self._place_vehicles()
        check_overlaps(self._scene, self._data, self._agents)
        self._tick = -1

    @property
    def spec(self) -> ParticipantSpec:
        """Return the declared reads and writes."""
        return self._spec

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled MuJoCo scene."""
        return self._scene.model

    @property
    def data(self) -> mujoco.MjData:
        """The state of the MuJoCo scene."""
        return self._data

    def reset(self, episode: Episode) -> Outbox:
        """Put every vehicle at rest at its start; nothing is written once."""
        del episode
        self._states[:] = np.zeros((), records.STATE)
        for k, (mission, (position_m, is_flying)) in enumerate(zip(self._missions, self._starts, strict=True)):
            mission.start(position_m)
            if is_flying:
                self._states[k]["rotor_speed_rad_s"] = records.hover_rotor_speed_rad_s(self._constants[k])
        self._place_vehicles()
        # At rest nothing is felt but what carries it.
        self._inertial[:] = 0.0
        self._inertial[:, :, 2] = GRAVITY_M_S2
        self._path_length_m = [0.0] * len(self._agents)
        self._positions_m = [position_m for position_m, _ in self._starts]
        self._touched: list[set[str]] = [set() for _ in self._agents]
        self._tick = -1
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Fly all vehicles to the end of a tick and return their states.

        Args:
            tick: 0 is the state at rest.
            inbox: Commands that take effect at the start of this tick.

        Raises:
            ModelError: ticks are not in order, or a vehicle's state exploded.
        """
        if tick != self._tick + 1:
            raise ModelError(f"world: expected tick {self._tick + 1}, was {tick}.")
        self._tick = tick
        for touched in self._touched:
            touched.clear()
        if tick == 0:
            self._note_contacts()
            self._supports = [frozenset(touched) for touched in self._touched]
        else:
            self._obey(tick, inbox)
            self._keep_apart(tick)
            self._fly(tick)
        return {keys.BODIES: BodyPoses(tick=tick, bodies=tuple(self._body(k) for k in range(len(self._agents))))}

    def rehearse(self) -> None:
        """Use what is used only in flight, where vehicles use it: planning, and keeping apart."""
        if self._routes:
            rehearse_planning()
        if any(agent.vehicle.separation_m for agent in self._agents):
            rehearse_separation()

    # Vehicles of a kind share what they know of the room.
    def _avoidance(self, agent: AgentSpec, space: FlightSpace, abilities: Abilities) -> Avoidance | None:
        mode, height_m = agent.vehicle.avoidance, space.ground_height_m
        if mode == "none":
            return None
        ground = None if height_m is None else (height_m, height_m - abilities.standing_height_m)
        key = (mode, space.radius_m, ground)
        if key not in self._routes:
            self._routes[key] = routes_of(self._environment, mode, radius_m=space.radius_m, ground=ground)
        routes, has_wheels = self._routes[key], abilities.has_wheels
        return Avoidance(routes=routes, limits=abilities.limits, tick_ns=self._tick_ns, has_wheels=has_wheels)

    def _place_vehicles(self) -> None:
        mujoco.mj_resetData(self._scene.model, self._data)
        for k, (position_m, _) in enumerate(self._starts):
            self._qpos(k)[:7] = (*position_m, 1.0, 0.0, 0.0, 0.0)
        mujoco.mj_forward(self._scene.model, self._data)

    def _obey(self, tick: int, inbox: Inbox) -> None:
        for k, (agent, mission) in enumerate(zip(self._agents, self._missions, strict=True)):
            command = inbox.get(keys.command(agent.name))
            path, setpoint = mission.trajectory, mission.setpoint
            mission.begin_tick(tick, command if isinstance(command, Command) else None)
            if mission.trajectory is not path or mission.setpoint is not setpoint:
                self._follow(k)

    # All look at where the others are now, then all decide.
    def _keep_apart(self, tick: int) -> None:
        gives_way = np.array([mission.gives_way for mission in self._missions])
        if not gives_way.any():
            return
        positions_m, velocities_m_s = np.array(self._positions_m), self._data.qvel[self._i_velocities]
        for k, mission in enumerate(self._missions):
            if not gives_way[k]:
                continue
            path = mission.trajectory
            neighbours = Neighbours(
                own=k,
                positions_m=positions_m,
                velocities_m_s=velocities_m_s,
                least_m=self._least_m[k],
                gives_way=gives_way,
            )
            mission.keep_apart(tick - 1, neighbours)
            if mission.trajectory is not path:
                self._follow(k)

    def _follow(self, k: int) -> None:
        mission, state = self._missions[k], self._states[k]
        state["is_armed"] = mission.is_armed
        if mission.setpoint is None:
            records.set_trajectory(state, mission.trajectory)
        else:
            records.set_setpoint(state, mission.setpoint)

    def _fly(self, tick: int) -> None:
        wind = self._environment.wind
        frame = self._wind_m_s[wind.frame_at(seconds_from_ticks(tick - 1, self._tick_ns))]
        i_substep = 0
        while i_substep < self._n_substeps:
            i_substep, i_unsound = fly_substeps_inplace(
                i_substep, self._n_substeps, tick, self._tick_ns / NS_PER_S, self._constants, self._states,
                self._inertial, *self._views, frame, *self._loop_arguments,
            )  # fmt: skip
            if i_unsound >= 0:
                raise ModelError(self._unsound_text(i_unsound))
            if self._data.ncon:
                self._note_contacts()
        for k in range(len(self._missions)):
            self._end_tick(k, tick)

    def _end_tick(self, k: int, tick: int) -> None:
        mission, position_m = self._missions[k], self._position_m(k)
        self._path_length_m[k] += math.dist(position_m, self._positions_m[k])
        self._positions_m[k] = position_m
        path, setpoint, phase = mission.trajectory, mission.setpoint, mission.phase
        w, x, y, z = self._qpos(k)[3:7].tolist()
        mission.end_tick(
            tick,
            position_m,
            self._velocity_m_s(k),
            yaw_rad=math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)),
            uprightness=1.0 - 2.0 * (x * x + y * y),
        )
        if mission.trajectory is not path or mission.setpoint is not setpoint:
            self._follow(k)
        if phase == "landing" and mission.phase == "on_ground":
            self._supports[k] = frozenset(self._touched[k])

    # What wheels stand on is no collision; what they run against is.
    def _note_contacts(self) -> None:
        scene, contact = self._scene, self._data.contact
        for i, (geom_a, geom_b) in enumerate(contact.geom.tolist()):
            if (scene.is_rolling[geom_a] or scene.is_rolling[geom_b]) and abs(contact.frame[i][2]) > _SUPPORTS_FROM:
                continue
            agent_a, agent_b = scene.agent_of_geom[geom_a], scene.agent_of_geom[geom_b]
            if agent_a >= 0:
                self._touched[agent_a].add(scene.thing_of_geom[geom_b])
            if agent_b >= 0:
                self._touched[agent_b].add(scene.thing_of_geom[geom_a])

    def _body(self, k: int) -> BodyState:
        mission, qpos, qvel = self._missions[k], self._qpos(k), self._qvel(k)
        # A vehicle that fails before its take-off is over has not collided with what it stood on.
        is_leaving = mission.phase == "failed" and not mission.has_taken_off
        touched = self._touched[k] - self._supports[k] if is_leaving else self._touched[k]
        w, x, y, z = qpos[3:7].tolist()
        omega_x, omega_y, omega_z = qvel[3:6].tolist()
        return BodyState(
            agent=self._agents[k].name,
            position_world_m=self._positions_m[k],
            quaternion_wxyz=(w, x, y, z),
            velocity_world_m_s=self._velocity_m_s(k),
            angular_velocity_body_rad_s=(omega_x, omega_y, omega_z),
            phase=mission.phase,
            awaiting_command=mission.awaiting_command,
            path_length_m=self._path_length_m[k],
            waypoint_world_m=mission.waypoint_world_m,
            contacts=tuple(sorted(touched)),
            rejected_command=mission.notice,
            tracking_error_m=self._tracking_error_m(k),
            planned_path_world_m=mission.planned_path_world_m,
            inertial_body=NumericArray.from_array(self._inertial[k]) if self._has_imu[k] else None,
        )

    def _tracking_error_m(self, k: int) -> float | None:
        mission = self._missions[k]
        if mission.setpoint is not None or not mission.is_armed or self._tick == 0:
            return None
        return math.dist(self._positions_m[k], mission.trajectory.state_at(self._tick, self._tick_ns)[0])

    # A vehicle's position and attitude, then its wheels.
    def _qpos(self, k: int) -> NDArray[np.float64]:
        return self._data.qpos[self._i_qpos[k] :]

    # Its velocity and rates, then the speeds of its wheels.
    def _qvel(self, k: int) -> NDArray[np.float64]:
        return self._data.qvel[self._i_qvel[k] :]

    def _position_m(self, k: int) -> Vec3:
        x_m, y_m, z_m = self._qpos(k)[:3].tolist()
        return x_m, y_m, z_m

    def _velocity_m_s(self, k: int) -> Vec3:
        u, v, w = self._qvel(k)[:3].tolist()
        return u, v, w

    def _unsound_text(self, k: int) -> str:
        return (
            f"world: expected a finite, plausible state of {self._agents[k].name}'s vehicle at tick {self._tick}, "
            f"was position {self._position_m(k)} m, velocity {self._velocity_m_s(k)} m/s."
        )

    # Views of MuJoCo's arrays and addresses stay valid as long as model and data live. The wind is handed over
    # read-only, as it comes from a memory map, so that one compiled kernel serves all.
    def _set_loop_arguments(self) -> None:
        model, data, grid = self._scene.model, self._data, self._environment.grid
        self._i_qpos: list[int] = self._constants["i_qpos"].tolist()
        self._i_qvel: list[int] = self._constants["i_qvel"].tolist()
        self._i_velocities = np.add.outer(self._i_qvel, np.arange(3))
        wind = self._environment.wind.velocity_m_s
        if wind.dtype != np.float32 or not wind.flags.c_contiguous:
            raise ModelError(f"wind: expected contiguous float32, was {wind.dtype} with strides {wind.strides}.")
        self._wind_m_s = wind.view()
        self._wind_m_s.flags.writeable = False
        self._views = (data.qpos, data.qvel, data.qacc, data.qfrc_applied, data.qfrc_constraint, data.sensordata)
        addresses = (step_address(), model._address, data._address)
        self._loop_arguments = (np.array(grid.origin_m, np.float64), float(grid.cell_m), *addresses)


def _physics_step_ms(models: Sequence[Vehicle], tick_ms: int) -> int:
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


# Where a vehicle is at tick 0, and whether it hovers there instead of standing.
def _resting_place(agent: AgentSpec, space: FlightSpace, half_height_m: float) -> tuple[Vec3, bool]:
    x_m, y_m, z_m = agent.vehicle.start_m
    standing_m = space.support_height_m(agent.vehicle.start_m) + half_height_m
    if abs(z_m - standing_m) <= _STANDS_WITHIN_M:
        return (x_m, y_m, standing_m), False
    return (x_m, y_m, z_m), True


def _constants(scene: Scene, agents: Sequence[AgentSpec], models: Sequence[Vehicle], dt_s: float) -> NDArray[np.void]:
    constants = np.zeros(len(agents), records.CONSTANTS)
    for k, (agent, model) in enumerate(zip(agents, models, strict=True)):
        records.set_constants(constants[k], model, scene.model, f"{agent.name}/", dt_s)
    return constants


# What each pair keeps between its centres, (n, n): the greater wish of the two, and enough not to touch.
def _distances_to_keep_m(agents: Sequence[AgentSpec], radii_m: Sequence[float]) -> NDArray[np.float64]:
    wishes_m = np.array([agent.vehicle.separation_m for agent in agents])
    return np.maximum(np.maximum.outer(wishes_m, wishes_m), np.add.outer(radii_m, radii_m) + CLEARANCE_M)
