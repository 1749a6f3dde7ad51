"""Evaluation of one agent: a state machine fed with one tick at a time, from its start to its outcome and figures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import scalar_kernel
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract.messages import (
    REFUSED_PREFIX,
    AgentResult,
    AgentScore,
    BeliefScore,
    BodyState,
    Command,
    MountSample,
    RefereeEvent,
)
from gslcosim.contract.record import build_unchecked_constructor
from gslcosim.scenario.models.success import SuccessSpec
from gslcosim.validity.conduct import GAS_CONTACT_PPM
from gslcosim_services.referee import metrics
from gslcosim_services.referee.metrics import compute_belief_score
from gslcosim_services.referee.success import Evidence, build_criterion

Outcome = Literal["success", "time_limit", "collision", "agent_failed", "declared", "out_of_bounds"]

# Depth to which a vehicle may sink into floors and walls on impact without leaving the room [m].
CONTACT_PENETRATION_M = 0.05

# Ends of an agent's run without success, in the order in which they count within a tick; see `find_failure`.
FAILURES: tuple[Outcome | None, ...] = (None, "agent_failed", "collision", "out_of_bounds")

_new_score = build_unchecked_constructor(AgentScore)

_OUTCOME_TEXTS: dict[Outcome, str] = {
    "time_limit": "has not found the source in time and stopped",
    "collision": "has collided and stopped",
    "agent_failed": "has failed",
    "declared": "has declared a wrong place and stopped",
    "out_of_bounds": "has left the room and stopped",
}


@dataclass(frozen=True, kw_only=True)
class EvaluationRules:
    """Rules by which an agent is evaluated; positions and lengths in the world frame [m].

    `success` is the scenario's block; `floors` are the names of the boxes a vehicle may touch on the ground; `min_m`
    and `max_m` are the corners of the room's air.
    """

    tick_ns: int
    sources_m: tuple[Vec3, ...]
    success: SuccessSpec
    ends_on_collision: bool
    floors: frozenset[str]
    min_m: Vec3
    max_m: Vec3


class AgentEvaluation:
    """Evaluation of one agent from tick 0 to its end, with everything that its result is made of.

    Within one tick the first of these holds: the agent failed, it touched something, it left the room, it succeeded,
    it declared a wrong place. So a vehicle that hits an obstacle in the tick in which it comes near enough has not
    succeeded. Nothing is counted after the end, although the vehicle may move on.
    """

    def __init__(self, name: str, rules: EvaluationRules) -> None:
        self.name = name
        self.outcome: Outcome | None = None
        self._rules = rules
        self._criterion = build_criterion(rules.success, rules.sources_m)
        self._start_m: Vec3 | None = None
        self._body: BodyState | None = None
        self._end_tick = 0
        self._n_commands = 0
        self._declared_error_m: float | None = None
        self._declared_confidence: float | None = None
        self._belief: BeliefScore | None = None
        self._rejection: str | None = None
        self._n_refused = 0
        self._n_adjusted = 0
        self._first_refusal: str | None = None
        self._gas_contact_s: float | None = None
        self._has_taken_off = False
        self._has_met_gas = False
        self._is_touching = False
        self._measured_from_m: Vec3 | None = None
        self._measured_m: tuple[float, ...] = ()

    @property
    def start_m(self) -> Vec3 | None:
        """Position of the vehicle at tick 0, world frame [m]; nothing before."""
        return self._start_m

    def move_sources(self, sources_m: tuple[Vec3, ...]) -> None:
        """Judge by sources at other places from now on; the criterion keeps what it has seen so far."""
        self._rules = replace(self._rules, sources_m=sources_m)
        self._measured_from_m = None

    def observe(
        self, tick: int, body: BodyState, samples: Sequence[MountSample], command: Command | None
    ) -> list[RefereeEvent]:
        """Take note of one tick and return what happened in it.

        Args:
            tick: The tick that ended.
            body: The agent's vehicle at its end.
            samples: True field values at the vehicle's sensors.
            command: The agent's command that takes effect in this tick, if there is one.
        """
        if self.outcome is not None:
            return []
        if self._start_m is None:
            self._start_m = body.position_world_m
        self._body = body
        self._end_tick = tick
        events = [
            *self._note_command(command),
            *self._note_rejection(body, command),
            *self._note_take_off(body),
            *self._note_gas(samples),
            *self._note_contact(body),
        ]
        if outcome := self._failure_of(body, command):
            reason = command.reason if command is not None and command.kind == "failed" else ""
            return [*events, self.end(outcome, reason=reason)]
        return [*events, *self._judge(body, command)]

    def end(self, outcome: Outcome, *, reason: str = "") -> RefereeEvent:
        """End the evaluation with the state of the last observed tick and return its event."""
        assert self._body is not None
        self.outcome = outcome
        time_s = seconds_from_ticks(self._end_tick, self._rules.tick_ns)
        distance_m = self._distance_m(self._body.position_world_m)
        met_text = self._rules.success.met_text if outcome == "success" else _OUTCOME_TEXTS[outcome]
        text = f"{met_text} after {time_s:g} s, {distance_m:.2f} m from the source"
        return self._event(outcome, f"{text}: {reason}" if reason else text)

    def score(self, body: BodyState) -> AgentScore:
        """Return the agent's state; commands are counted up to its end, distances are those of now."""
        return _new_score(
            agent=self.name,
            distance_to_source_m=self._distance_m(body.position_world_m),
            path_length_m=body.path_length_m,
            n_commands=self._n_commands,
            belief=self._belief,
        )

    def result(self, shortest_path_m: float | None) -> AgentResult:
        """Return the final figures.

        Args:
            shortest_path_m: The shortest collision-free way from the start that suffices for success [m], if any.
        """
        assert self._body is not None
        assert self._start_m is not None
        is_success = self.outcome == "success"
        end_m, path_length_m = self._body.position_world_m, self._body.path_length_m
        source_m = metrics.find_nearest(self._start_m, self._rules.sources_m)
        if self._rules.success.is_horizontal:
            source_m = metrics.move_to_height(source_m, self._start_m)
        return AgentResult(
            name=self.name,
            success=is_success,
            outcome=self.outcome or "time_limit",
            time_to_source_s=seconds_from_ticks(self._end_tick, self._rules.tick_ns) if is_success else None,
            steps=self._n_commands,
            path_length_m=path_length_m,
            straight_line_m=metrics.distance_m(self._start_m, source_m),
            shortest_path_m=shortest_path_m,
            movement_overhead=metrics.movement_overhead(path_length_m, shortest_path_m) if is_success else None,
            directness=metrics.directness(self._start_m, end_m, source_m, path_length_m),
            final_distance_m=self._distance_m(end_m),
            declared_error_m=self._declared_error_m,
            declared_confidence=self._declared_confidence,
            belief=self._belief,
        )

    def conduct(self) -> dict[str, Any]:
        """Return the fields of `gslcosim.validity.conduct.AgentConduct` that the referee measures."""
        return {
            "n_commands": self._n_commands,
            "n_refused": self._n_refused,
            "n_adjusted": self._n_adjusted,
            "first_refusal": self._first_refusal,
            "gas_contact_s": self._gas_contact_s,
            "has_succeeded": self.outcome == "success",
        }

    def _note_command(self, command: Command | None) -> list[RefereeEvent]:
        if command is None or command.kind == "failed":
            return []
        self._n_commands += 1
        if command.kind == "hold" and command.reason.startswith(REFUSED_PREFIX):
            self._n_refused += 1
            self._first_refusal = self._first_refusal or command.reason.removeprefix(REFUSED_PREFIX)
        if command.belief is not None:
            self._belief = compute_belief_score(
                command.belief, self._rules.sources_m, within_m=self._rules.success.within_m
            )
        if command.declaration is None or command.kind != "declare_source":
            return []
        x, y, z = command.declaration.position_world_m
        self._declared_error_m = self._distance_m(command.declaration.position_world_m)
        self._declared_confidence = max(command.declaration.confidence, self._declared_confidence or 0.0)
        text = (
            f"declares the source at ({x:.2f}, {y:.2f}, {z:.2f}) m with confidence "
            f"{command.declaration.confidence:g}, {self._declared_error_m:.2f} m off"
        )
        return [self._event("declaration", text)]

    # A refusal may stay in the state for several ticks: it is new when its text changes or a command came in.
    def _note_rejection(self, body: BodyState, command: Command | None) -> list[RefereeEvent]:
        is_new = body.rejected_command is not None and (command is not None or body.rejected_command != self._rejection)
        self._rejection = body.rejected_command
        if not is_new:
            return []
        # A vehicle that goes to another place than it was sent to, or stops early, has not refused.
        if command is not None and body.waypoint_world_m is None:
            self._n_refused += 1
        else:
            self._n_adjusted += 1
        self._first_refusal = self._first_refusal or body.rejected_command
        return [self._event("refused", f"command refused: {body.rejected_command}")]

    def _note_take_off(self, body: BodyState) -> list[RefereeEvent]:
        if self._has_taken_off or body.phase in ("on_ground", "failed"):
            return []
        self._has_taken_off = True
        return [self._event("take_off", "takes off" if body.phase == "taking_off" else "sets off")]

    def _note_gas(self, samples: Sequence[MountSample]) -> list[RefereeEvent]:
        if self._has_met_gas:
            return []
        for sample in samples:
            for gas in sample.gases:
                if gas.mixing_ratio_ppm > GAS_CONTACT_PPM:
                    self._has_met_gas = True
                    self._gas_contact_s = seconds_from_ticks(self._end_tick, self._rules.tick_ns)
                    text = (
                        f"first contact with {gas.gas}: {gas.mixing_ratio_ppm:.2f} ppm at {sample.sensor} "
                        f"(more than {GAS_CONTACT_PPM:g} ppm)"
                    )
                    return [self._event("gas_contact", text)]
        return []

    def _note_contact(self, body: BodyState) -> list[RefereeEvent]:
        contacts = self._forbidden_contacts(body)
        is_new = bool(contacts) and not self._is_touching
        self._is_touching = bool(contacts)
        phase = body.phase.replace("_", " ")
        return [self._event("contact", f"touches {', '.join(contacts)} while {phase}")] if is_new else []

    # On the ground and while leaving it or coming back the floor is no collision; in the air everything is.
    def _forbidden_contacts(self, body: BodyState) -> tuple[str, ...]:
        if not body.contacts or body.phase == "failed":
            return ()
        if body.phase in ("on_ground", "taking_off", "landing"):
            return tuple(name for name in body.contacts if name not in self._rules.floors)
        return body.contacts

    def _failure_of(self, body: BodyState, command: Command | None) -> Outcome | None:
        rules = self._rules
        is_failed = body.phase == "failed" or (command is not None and command.kind == "failed")
        is_in_room = is_inside(body.position_world_m, rules.min_m, rules.max_m)
        return FAILURES[find_failure(is_failed, self._is_touching, rules.ends_on_collision, is_in_room)]

    def _judge(self, body: BodyState, command: Command | None) -> list[RefereeEvent]:
        declares = command is not None and command.kind == "declare_source"
        evidence = Evidence(
            time_s=seconds_from_ticks(self._end_tick, self._rules.tick_ns),
            body=body,
            distances_m=self._distances_m(body.position_world_m),
            declared_error_m=self._declared_error_m if declares else None,
            belief=self._belief,
        )
        events = [self._event("progress", text) for text in self._criterion.news(evidence)]
        if self._criterion.is_met(evidence):
            events.append(self.end("success"))
        elif self._criterion.has_missed(evidence):
            events.append(self.end("declared"))
        return events

    # To the nearest of the sources.
    def _distance_m(self, point_m: Vec3) -> float:
        return min(self._distances_m(point_m))

    # To each source; in the plane where heights do not count. Those of one point are needed twice in a tick.
    def _distances_m(self, point_m: Vec3) -> tuple[float, ...]:
        if point_m is not self._measured_from_m:
            is_horizontal, sources_m = self._rules.success.is_horizontal, self._rules.sources_m
            measured_m = [metrics.source_distance_m(point_m, source_m, is_horizontal) for source_m in sources_m]
            self._measured_m, self._measured_from_m = tuple(measured_m), point_m
        return self._measured_m

    def _event(self, kind: str, text: str) -> RefereeEvent:
        return RefereeEvent(agent=self.name, kind=kind, text=text)


@scalar_kernel
def is_inside(point_m: Sequence[float], min_m: Sequence[float], max_m: Sequence[float]) -> bool:
    """Return whether a point (3,) is in the room, or no further out than floors and walls give way.

    Args:
        point_m: World frame [m].
        min_m: (3,) least corner of the room's air, world frame [m].
        max_m: (3,) greatest corner of it.
    """
    for axis in range(3):
        if not min_m[axis] - CONTACT_PENETRATION_M <= point_m[axis] <= max_m[axis] + CONTACT_PENETRATION_M:
            return False
    return True


@scalar_kernel
def find_failure(
    is_failed: bool,  # noqa: FBT001 - a kernel
    is_touching: bool,  # noqa: FBT001
    ends_on_collision: bool,  # noqa: FBT001
    is_in_room: bool,  # noqa: FBT001
) -> int:
    """Return the first failure of a tick as an index of `FAILURES`, 0 for none.

    Args:
        is_failed: The vehicle or its agent has failed.
        is_touching: The vehicle touches what it must not.
        ends_on_collision: A contact ends the run.
        is_in_room: `is_inside` of the vehicle's position.
    """
    if is_failed:
        return 1
    if is_touching and ends_on_collision:
        return 2
    return 0 if is_in_room else 3


@scalar_kernel
def is_time_over(tick: int, tick_ns: int, limit_s: float) -> bool:
    """Return whether the simulated time at the end of a tick has reached a limit [s]."""
    return seconds_from_ticks(tick, tick_ns) >= limit_s
