"""Services and the action of a simulation in a ROS 2 graph: those of `simulation_interfaces` 2.1, and GADEN's
`odor_value` and `wind_value`, which take the place of its player.
"""

import re
import struct
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import GslCosimError
from gslcosim.base.frames import world_from_body_rotation
from gslcosim.contract.messages import BodyState
from gslcosim.simulation.simulation import Simulation
from gslcosim_ros import simulation_interfaces as interfaces
from gslcosim_ros.actions import ActionGoal, ActionServer, GoalStatus
from gslcosim_ros.node import RosSession
from gslcosim_ros.simulation_interfaces import BoundsType, Feature, ResultCode, Scope, State, get_service_type
from gslcosim_ros.types import MAP_FRAME

NODE_NAME = "simulator"
PREFIX = "/gslcosim"
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_MAX_FILTER_CHARACTERS = 200
# Python's expressions take a time that grows with the length of a name to the power of their repetitions, and where
# groups are repeated exponentially; meanwhile the whole process stands still.
_MAX_FILTER_REPETITIONS = 3
_ESCAPED = re.compile(r"\\.", re.DOTALL)
_REPETITIONS = re.compile(r"[*+?{]")
_REPEATED_GROUP = re.compile(r"\)[*+{]")


class _RefusalError(Exception):
    """A request is answered with another code than OK."""

    def __init__(self, code: ResultCode, text: str) -> None:
        super().__init__(text)
        self.code = code


class SimulationServices:
    """Answers services about a simulation, which begins paused; poses and gas are the true ones.

    Requests that control it are carried out one after the other; others are answered between two ticks. A new state
    and a reset end steps that are being made, and those that wait, after the present tick. Whatever a request has wrong
    is answered with a result, or with an error where it cannot even be read.

    Args:
        simulation: The simulation.
        session: In the graph.
        pace: Simulated seconds in a second while it plays; None: as fast as it goes.
    """

    def __init__(self, simulation: Simulation, session: RosSession, *, pace: float | None = None) -> None:
        self._simulation = simulation
        self._types = session.types
        self._pace = pace
        self._is_stopped = False
        # Of requests that control the simulation: one has the turn, others wait for it.
        self._turns = threading.Condition()
        self._is_turn_taken = False
        self._n_interruptions = 0
        self._quit = threading.Event()
        interfaces.define_interfaces(self._types)
        node = session.create_node(NODE_NAME, PREFIX)
        answers: dict[str, Callable[[Any], dict[str, Any]]] = {
            "GetSimulatorFeatures": self._get_features,
            "GetSimulationState": self._get_state,
            "SetSimulationState": self._set_state,
            "StepSimulation": self._step,
            "ResetSimulation": self._reset,
            "GetEntities": self._get_entities,
            "GetEntitiesStates": self._get_entities_states,
            "GetEntityState": self._get_entity_state,
            "GetEntityInfo": self._get_entity_info,
        }
        for name, answer in answers.items():
            node.answer_service(
                f"{PREFIX}/{_to_snake_case(name)}", get_service_type(name), self._build_answerer(name, answer)
            )
        path = f"{PREFIX}/{_to_snake_case('SimulateSteps')}"
        ActionServer(session, node, path, interfaces.SIMULATE_STEPS, self._start_steps, cancel=self._wake_up)
        node.answer_service("/odor_value", interfaces.GADEN_GAS, self._get_gas)
        node.answer_service("/wind_value", interfaces.GADEN_WIND, self._get_wind)

    def wait_until_quit(self, timeout_s: float | None = None) -> bool:
        """Wait until a client has set the state to quitting; return whether one has."""
        return self._quit.wait(timeout_s)

    # A response says what went wrong, and has values of its type in all other fields.
    def _build_answerer(self, name: str, answer: Callable[[Any], dict[str, Any]]) -> Callable[[Any], Any]:
        kind = f"{get_service_type(name)}_Response"
        blanks = {
            "GetSimulationState": {"state": self._make("SimulationState", state=State.PAUSED)},
            "GetEntities": {"entities": []},
            "GetEntitiesStates": {"entities": [], "states": []},
            "GetEntityState": {"state": self._make_state(None)},
            "GetEntityInfo": {"info": self._make_info("", ())},
        }.get(name, {})

        def answer_request(request: Any) -> Any:
            if name == "GetSimulatorFeatures":
                return self._types.make(kind, **answer(request))
            code, text, fields = ResultCode.OK, "", {}
            try:
                fields = answer(request)
            except _RefusalError as refusal:
                code, text = refusal.code, str(refusal)
            except GslCosimError as error:
                code, text = ResultCode.OPERATION_FAILED, str(error)
            return self._types.make(kind, result=self._make_result(code, text), **(blanks | fields))

        return answer_request

    def _get_features(self, request: Any) -> dict[str, Any]:
        del request
        features = np.array([int(feature) for feature in Feature], np.uint16)
        info = f"gslcosim: {self._simulation.scenario.name}, seed {self._simulation.scenario.seed}"
        return {"features": self._make("SimulatorFeatures", features=features, spawn_formats=[], custom_info=info)}

    @property
    def _state(self) -> State:
        if self._quit.is_set():
            return State.QUITTING
        if self._simulation.is_playing:
            return State.PLAYING
        return State.STOPPED if self._is_stopped else State.PAUSED

    def _get_state(self, request: Any) -> dict[str, Any]:
        del request
        return {"state": self._make("SimulationState", state=int(self._state))}

    def _set_state(self, request: Any) -> dict[str, Any]:
        wanted = request.state.state
        if wanted not in list(State):
            found = f"expected a state of {', '.join(f'{state.name} {state.value}' for state in State)}, was {wanted}."
            raise _RefusalError(ResultCode.OPERATION_FAILED, found)
        if wanted == State.QUITTING:
            # A step that is being made ends after its tick.
            self._quit.set()
            self._wake_up()
            return {}
        has_interrupted = self._interrupt_steps() and wanted == State.PAUSED
        with self._take_turn():
            if wanted == self._state and not has_interrupted:
                raise _RefusalError(ResultCode.ALREADY_IN_TARGET_STATE, f"It is {State(wanted).name} already.")
            try:
                if wanted == State.PLAYING:
                    self._simulation.play(self._pace)
                elif wanted == State.STOPPED:
                    self._simulation.reset()
                else:
                    self._simulation.pause()
            except GslCosimError as error:
                raise _RefusalError(ResultCode.STATE_TRANSITION_ERROR, str(error)) from error
            self._is_stopped = wanted == State.STOPPED
        return {}

    def _step(self, request: Any) -> dict[str, Any]:
        for _ in self._iterate_steps(request.steps):
            pass
        return {}

    def _interrupt_steps(self) -> bool:
        """End steps that are being made or wait; return whether a request has the turn."""
        with self._turns:
            self._n_interruptions += 1
            self._turns.notify_all()
            return self._is_turn_taken

    def _wake_up(self, goal: ActionGoal | None = None) -> None:
        """Let requests that wait see whether they are still wanted."""
        del goal
        with self._turns:
            self._turns.notify_all()

    @contextmanager
    def _take_turn(self, is_unwanted: Callable[[], bool] = lambda: False) -> Iterator[None]:
        """Control the simulation, after those that do; who is not wanted any more does not wait."""
        with self._turns:
            self._turns.wait_for(lambda: is_unwanted() or not self._is_turn_taken)
            has_turn = not is_unwanted()
            self._is_turn_taken = self._is_turn_taken or has_turn
        try:
            yield
        finally:
            if has_turn:
                with self._turns:
                    self._is_turn_taken = False
                    self._turns.notify_all()

    # On a thread of its own, for whoever has sent the goal may cancel it, and ask for other things.
    def _start_steps(self, goal: ActionGoal) -> None:
        threading.Thread(target=self._simulate_steps, args=(goal,), name="simulates steps", daemon=True).start()

    def _simulate_steps(self, goal: ActionGoal) -> None:
        status, code, text, n_steps = GoalStatus.SUCCEEDED, ResultCode.OK, "", goal.message.steps
        make = partial(self._types.make, f"{interfaces.SIMULATE_STEPS}_Feedback")
        try:
            with closing(self._iterate_steps(n_steps, lambda: goal.is_canceling)) as steps:
                for n_done in steps:
                    goal.publish_feedback(make(completed_steps=n_done, remaining_steps=n_steps - n_done))
        except _RefusalError as refusal:
            status, code, text = GoalStatus.ABORTED, refusal.code, str(refusal)
        except GslCosimError as error:
            status, code, text = GoalStatus.ABORTED, ResultCode.OPERATION_FAILED, str(error)
        if status == GoalStatus.ABORTED and goal.is_canceling:
            status = GoalStatus.CANCELED
        result = self._make_result(code, text)
        goal.end(status, self._types.make(f"{interfaces.SIMULATE_STEPS}_Result", result=result))

    def _iterate_steps(
        self, n_steps: int, is_canceled: Callable[[], bool] = lambda: False
    ) -> Generator[int, None, None]:
        """Simulate ticks, and yield after each how many have been simulated; others control nothing meanwhile."""
        n_done, n_interruptions = 0, self._n_interruptions
        if n_steps < 1:
            raise _RefusalError(ResultCode.OPERATION_FAILED, f"steps: expected at least 1, was {n_steps}.")

        def is_unwanted() -> bool:
            return is_canceled() or self._quit.is_set() or self._n_interruptions != n_interruptions

        with self._take_turn(is_unwanted):
            while n_done < n_steps and not is_unwanted():
                if self._state != State.PAUSED:
                    raise _RefusalError(
                        ResultCode.OPERATION_FAILED,
                        f"Expected state PAUSED, was {self._state.name}. Pause it first.",
                    )
                n_done += self._simulation.step()
                yield n_done
                if n_done < n_steps and (self._simulation.is_over or self._simulation.asked):
                    raise _RefusalError(
                        ResultCode.OPERATION_FAILED,
                        f"It went {n_done} of {n_steps} steps: {self._describe_halt()}.",
                    )
        if n_done < n_steps:
            why = "it quits" if self._quit.is_set() else "another request has set the state"
            why = "it was canceled" if is_canceled() else why
            raise _RefusalError(ResultCode.OPERATION_FAILED, f"It went {n_done} of {n_steps} steps: {why}.")

    def _describe_halt(self) -> str:
        if self._simulation.asked:
            return f"{', '.join(self._simulation.asked)} awaits a command"
        verdict = self._simulation.outcome.verdict
        return f"the run is over ({verdict.end_reason if verdict else 'closed'})"

    def _reset(self, request: Any) -> dict[str, Any]:
        both = Scope.TIME | Scope.STATE
        if request.scope and request.scope & both != both:
            raise _RefusalError(
                ResultCode.FEATURE_UNSUPPORTED,
                f"scope: expected 0, {both} or 255, for time and state are reset together, was {request.scope}.",
            )
        self._interrupt_steps()
        with self._take_turn():
            self._simulation.reset()
            self._is_stopped = False
        return {}

    def _get_entities(self, request: Any) -> dict[str, Any]:
        return {"entities": [name for name, _ in self._find_entities(request.filters)]}

    def _get_entities_states(self, request: Any) -> dict[str, Any]:
        found = self._find_entities(request.filters)
        return {"entities": [name for name, _ in found], "states": [self._make_state(body) for _, body in found]}

    def _get_entity_state(self, request: Any) -> dict[str, Any]:
        with self._simulation.lock:
            return {"state": self._make_state(self._get_body(request.entity))}

    def _get_entity_info(self, request: Any) -> dict[str, Any]:
        self._get_body(request.entity)
        methods = self._simulation.scenario.methods
        description = f"{self._get_tags(request.entity)[0]} with the method {methods[request.entity]}"
        return {"info": self._make_info(description, self._get_tags(request.entity))}

    def _get_body(self, name: str) -> BodyState:
        bodies = self._simulation.truth.bodies
        if name not in bodies:
            raise _RefusalError(
                ResultCode.NOT_FOUND, f"entity: expected one of {', '.join(bodies)}, was {name[:80]!r}."
            )
        return bodies[name]

    def _get_tags(self, agent: str) -> tuple[str, ...]:
        return tuple(spec.vehicle.model for spec in self._simulation.scenario.agents if spec.name == agent)

    def _find_entities(self, filters: Any) -> list[tuple[str, BodyState]]:
        matches_name, matches_place = _parse_name_filter(filters.filter), _parse_bounds(filters.bounds)
        categories = [category.category for category in filters.categories]
        tags, needs_all = set(filters.tags.tags), filters.tags.filter_mode == interfaces.FILTER_MODE_ALL
        if categories and interfaces.CATEGORY_ROBOT not in categories:
            return []
        found: list[tuple[str, BodyState]] = []
        with self._simulation.lock:
            for name, body in self._simulation.truth.bodies.items():
                own = set(self._get_tags(name))
                has_tags = not tags or (tags <= own if needs_all else bool(tags & own))
                if has_tags and matches_name(name) and matches_place(body.position_world_m):
                    found.append((name, body))
        return found

    def _get_gas(self, request: Any) -> bytes:
        points_m = _read_points(request)
        truth = self._simulation.truth
        with self._simulation.lock:
            gases = truth.gases
            inside = self._find_inside(points_m)
            ppm = np.zeros((len(points_m), len(gases)))
            for i, gas in enumerate(gases):
                ppm[inside, i] = truth.gas_ppm(points_m[inside], gas)
        return encode_gas_response(ppm, gases)

    def _get_wind(self, request: Any) -> Any:
        points_m = _read_points(request)
        with self._simulation.lock:
            inside = self._find_inside(points_m)
            wind_m_s = np.zeros_like(points_m)
            wind_m_s[inside] = self._simulation.truth.wind_m_s(points_m[inside])
        u, v, w = np.ascontiguousarray(wind_m_s.T)
        return self._types.make(f"{interfaces.GADEN_WIND}_Response", u=u, v=v, w=w)

    # GADEN answers with zeros outside its room; so do we.
    def _find_inside(self, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        return self._simulation.environment.grid.contains_points(points_m)

    def _make(self, name: str, **fields: Any) -> Any:
        return self._types.make(f"{interfaces.PACKAGE}/msg/{name}", **fields)

    def _make_result(self, code: ResultCode, text: str) -> Any:
        return self._make("Result", result=int(code), error_message=text)

    def _make_info(self, description: str, tags: Sequence[str]) -> Any:
        category = self._make("EntityCategory", category=interfaces.CATEGORY_ROBOT if tags else 0)
        return self._make("EntityInfo", category=category, description=description, tags=list(tags))

    # Velocities are in the frame of the header, the world's; accelerations are not known and stay 0.
    def _make_state(self, body: BodyState | None) -> Any:
        types, zero = self._types, np.zeros(3)
        position_m, turn, velocity_m_s, rate_rad_s, time_ns = zero, np.array([1.0, 0.0, 0.0, 0.0]), zero, zero, 0
        if body is not None:
            position_m, turn = np.array(body.position_world_m), np.array(body.quaternion_wxyz)
            velocity_m_s = np.array(body.velocity_world_m_s)
            rate_rad_s = world_from_body_rotation(body.quaternion_wxyz) @ np.array(body.angular_velocity_body_rad_s)
            time_ns = max(self._simulation.tick, 0) * self._simulation.scenario.tick_ns
        return self._make(
            "EntityState",
            header=types.header(time_ns, MAP_FRAME),
            pose=types.pose(position_m, turn),
            twist=types.make(
                "geometry_msgs/msg/Twist", linear=types.vector(velocity_m_s), angular=types.vector(rate_rad_s)
            ),
            acceleration=types.make("geometry_msgs/msg/Accel", linear=types.vector(zero), angular=types.vector(zero)),
        )


def _to_snake_case(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def _parse_name_filter(pattern: str) -> Callable[[str], bool]:
    if not pattern:
        return lambda _: True
    try:
        if len(pattern) > _MAX_FILTER_CHARACTERS:
            raise re.error(f"more than {_MAX_FILTER_CHARACTERS} characters")
        plain = _ESCAPED.sub("x", pattern)
        if "(?" in plain or "[:" in plain or _REPEATED_GROUP.search(plain):
            raise re.error("with a repeated group, (? or [:, which are not offered")
        if len(_REPETITIONS.findall(plain)) > _MAX_FILTER_REPETITIONS:
            raise re.error(f"with more than {_MAX_FILTER_REPETITIONS} repetitions")
        expression = re.compile(pattern)
    except (re.error, OverflowError, RecursionError) as error:
        raise _RefusalError(
            ResultCode.OPERATION_FAILED, f"filter: expected a regular expression, was {pattern[:80]!r} ({error})."
        ) from error
    return lambda name: expression.search(name) is not None


def _parse_bounds(bounds: Any) -> Callable[[Sequence[float]], bool]:
    if bounds.type == BoundsType.EMPTY:
        return lambda _: True
    if bounds.type != BoundsType.SPHERE:
        raise _RefusalError(
            ResultCode.FEATURE_UNSUPPORTED, f"bounds: expected a sphere, type 3, or none, was type {bounds.type}."
        )
    if len(bounds.points) != 2:
        found = f"bounds: expected a centre and a radius for a sphere, was {len(bounds.points)} points."
        raise _RefusalError(ResultCode.OPERATION_FAILED, found)
    centre, radius_m = bounds.points[0], bounds.points[1].x
    centre_m = np.array([centre.x, centre.y, centre.z])
    return lambda position_m: bool(np.linalg.norm(np.asarray(position_m) - centre_m) <= radius_m)


def _read_points(request: Any) -> NDArray[np.float64]:
    lengths = {len(request.x), len(request.y), len(request.z)}
    if len(lengths) != 1:
        raise ValueError(f"expected as many x as y and z, was {len(request.x)}, {len(request.y)} and {len(request.z)}")
    return np.column_stack([request.x, request.y, request.z]).astype(np.float64)


def encode_gas_response(ppm: NDArray[np.float64], gases: Sequence[str]) -> bytes:
    """Return a response of GADEN's `odor_value` as CDR, little-endian; thousands of points take a millisecond.

    Args:
        ppm: (n, n_gases) mixing ratios [ppm].
    """
    n_points, n_gases = ppm.shape
    # A cell is the number of its gases, and a gap that lets its numbers begin at a multiple of 8 bytes. The number of
    # cells comes first, and takes the place of the first gap.
    cells = np.zeros(n_points, np.dtype([("first", "<u4"), ("second", "<u4"), ("ppm", "<f8", (n_gases,))]))
    cells["ppm"], cells["first"] = ppm, n_gases
    body = cells.tobytes()
    body = struct.pack("<II", n_points, n_gases) + body[8:] if n_points else struct.pack("<I", 0)
    parts = [_LITTLE_ENDIAN, body, struct.pack("<I", n_gases)]
    length = len(body) + 4
    for gas in gases:
        text = gas.encode() + b"\x00"
        gap = -length % 4
        parts += [bytes(gap), struct.pack("<I", len(text)), text]
        length += gap + 4 + len(text)
    return b"".join(parts)
