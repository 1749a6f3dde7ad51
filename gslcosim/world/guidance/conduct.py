"""The phases of a vehicle: taking off, under way, holding, landing; and what takes it from one to the next."""

from collections.abc import Sequence
from typing import Literal

from gslcosim.quantities import Vec3
from gslcosim.scenario.models.scenario import VehicleSpec
from gslcosim.ticks import ticks_from_seconds
from gslcosim.world.guidance.abilities import Abilities
from gslcosim.world.guidance.arrival import OVERTURNED, OverturnWatch, arrival_of, give_up
from gslcosim.world.guidance.avoidance import Avoidance
from gslcosim.world.guidance.course import Course
from gslcosim.world.guidance.edges import Edges
from gslcosim.world.guidance.evasion import GIVES_WAY_FOR_S, Evasion
from gslcosim.world.guidance.separation import Neighbours
from gslcosim.world.guidance.tasks import Task
from gslcosim.world.paths.columns import free_height_m
from gslcosim.world.paths.legs import Leg
from gslcosim.world.paths.space import FlightSpace
from gslcosim.world.paths.trajectory import AS_BEFORE, Heading
from gslcosim.world.physics.records import Setpoint

# A lower flight than this above where it stood is none [m].
LEAST_RISE_M = 0.5
STANDS_WITHIN_M = 0.05
# How long a vehicle on wheels may stop and turn before it gives up.
TURNS_FOR_S = 20.0

Phase = Literal["on_ground", "taking_off", "flying", "holding", "failed", "landing", "driving"]


class Conduct:
    """What one vehicle does, phase by phase. Methods return a notice for the agent where something goes wrong.

    State: phase, course, the task under way (none once it stops), the tick until which it holds, whether its
    rotors or wheels turn, whether it has left the ground, and whether it lies overturned.
    """

    def __init__(
        self,
        vehicle: VehicleSpec,
        space: FlightSpace,
        abilities: Abilities,
        tick_ns: int,
        position_world_m: Vec3,
        *,
        avoidance: Avoidance | None,
    ) -> None:
        """Rest on the ground at a place, world frame [m], at tick 0."""
        self._vehicle = vehicle
        self._space = space
        self._abilities = abilities
        self._avoidance = avoidance
        self._tick_ns = tick_ns
        self.course = Course(abilities, tick_ns, position_world_m)
        self.edges = Edges(space=space, abilities=abilities, tick_ns=tick_ns, avoidance=avoidance)
        self._evasion = Evasion(self.course, space, abilities.limits, tick_ns, avoidance=avoidance)
        self._overturn = OverturnWatch(tick_ns)
        self.under_way: Phase = "driving" if abilities.has_wheels else "flying"
        self.phase: Phase = "on_ground"
        self.goal: Task | None = None
        self.is_armed = False
        self.has_taken_off = abilities.has_wheels
        self.hold_until_tick = 0

    @property
    def is_overturned(self) -> bool:
        """Whether the vehicle lies on its side or back for good."""
        return self._overturn.is_overturned

    @property
    def gives_way(self) -> bool:
        """Whether the vehicle goes out of the way of others now, if it has to."""
        return self._vehicle.separation_m > 0 and self.phase == "flying" and self.course.setpoint is None

    # ------------------------------------------------------------ what it is told to do

    def aim_at(self, goal: Task | None) -> None:
        """Take note of the task that what follows is for."""
        self.goal = goal

    def leave_start(self) -> str | None:
        """Take off at the first tick; on wheels only turn them on."""
        if not self._abilities.has_wheels:
            return self.take_off(0)
        self.is_armed = True
        self.phase = "holding"
        self.hold_for(0, self._vehicle.hold_s)
        self.course.look(AS_BEFORE)
        return None

    def take_off(self, tick: int) -> str | None:
        """Rise to the height of search; with avoidance only as far as nothing is in the way."""
        place_m = self.course.position_m if self.has_taken_off else self.course.trajectory.end_world_m
        wanted_m = self._vehicle.search_height_m
        to_m = wanted_m if self._avoidance is None else free_height_m(self._space, place_m, wanted_m)
        found = f"take_off: expected a free way to a height of {wanted_m:g} m, was free as far as {to_m:.2f} m"
        if to_m < min(wanted_m, place_m[2] + LEAST_RISE_M):
            if self._stands_at(place_m):
                self.hold(tick, self._vehicle.hold_s)
                return f"{found}; the vehicle stays."
            to_m = max(to_m, place_m[2])
        self.is_armed = True
        self._begin(tick, [self._change_of_height("take_off", (place_m[0], place_m[1], to_m))])
        self.phase = "taking_off"
        return None if to_m == wanted_m else f"{found}; goes there."

    def land(self, tick: int) -> None:
        """Come down to what is below."""
        x_m, y_m, _ = self.course.motion(tick).state[0].tolist()
        height_m = self._space.support_height_m(self.course.position_m) + self._abilities.standing_height_m
        self._begin(tick, [self._change_of_height("land", (x_m, y_m, height_m))])
        self.phase = "landing"

    def set_out(self, tick: int, legs: Sequence[Leg], *, is_return: bool = False) -> str | None:
        """Go along legs, around what is in the way; where there is no path the vehicle holds.

        Args:
            tick: The tick that ended.
            legs: The legs, one after the other.
            is_return: Whether these are the legs that it was on before it went out of the way of others.
        """
        notice = None
        if self._avoidance is not None:
            plan = self._avoidance.plan(legs, self.course.motion(tick).state)
            notice, legs = plan.notice, plan.legs
        if legs:
            self._begin(tick, legs, is_new=not is_return)
        else:
            self.hold(tick, self._vehicle.hold_s)
        return notice

    def cruise(self, tick: int, velocity_m_s: Vec3, heading: Heading, for_s: float) -> None:
        """Take a velocity and keep it; the agent is asked after a time [s]."""
        self.course.cruise(tick, velocity_m_s, heading)
        self.hold_for(tick, for_s)
        self.phase = self.under_way

    def hand_over(self, tick: int, setpoint: Setpoint, for_s: float) -> None:
        """Obey a setpoint of the agent; it is asked after a time [s]."""
        self.is_armed = self.has_taken_off = True
        self.course.hand_over(tick, setpoint)
        self.hold_for(tick, for_s)
        self.phase = self.under_way

    def hold(self, tick: int, hold_s: float, heading: Heading = AS_BEFORE) -> None:
        """Stop and hold.

        A take-off is always finished: just above the floor is no place to hold. Who stands goes on standing.
        """
        self.goal = None
        if self.phase == "taking_off":
            return
        self.hold_for(tick, hold_s)
        if self.phase == "on_ground":
            return
        self.course.stop(tick)
        self.phase = "holding"
        if heading != AS_BEFORE:
            self.course.look(heading)

    def hold_for(self, tick: int, hold_s: float) -> None:
        """Ask the agent after a time [s]."""
        self.hold_until_tick = tick + ticks_from_seconds(hold_s, self._tick_ns)

    def fail(self, tick: int) -> None:
        """Stop for good."""
        if self.phase not in ("taking_off", "on_ground"):
            self.course.stop(tick)
        self.course.forget_legs()
        self.phase = "failed"

    # ------------------------------------------------------------ what it does by itself

    def keep_apart(self, tick: int, neighbours: Neighbours) -> str | None:
        """Go out of the way of others where that is needed, and back to the course when it no longer is."""
        wanted_m_s = self._evasion.needed_m_s(tick, neighbours)
        if wanted_m_s is None:
            return self._go_back(tick) if self._evasion.is_under_way else None
        if self._evasion.is_too_long(tick):
            self.hold(tick, self._vehicle.hold_s)
            return f"separation: expected a way past other vehicles within {GIVES_WAY_FOR_S:g} s; it holds."
        self._evasion.evade(tick, wanted_m_s, neighbours)
        return None

    def end_tick(self, tick: int, uprightness: float) -> str | None:
        """Notice arrivals and what goes wrong, and begin the next leg; the course has seen the true state."""
        self.has_taken_off = self.has_taken_off or self.course.is_over(tick)
        notice = self._notice_fall(tick, uprightness)
        if self.course.is_preparing:
            notice = self._prepare(tick) or notice
        elif self.course.goes_on:
            notice = self._brake_before_edge(tick) or notice
        elif self.phase in ("taking_off", self.under_way, "landing") and not self._evasion.is_under_way:
            notice = self._notice_arrival(tick) or notice
        if self.course.ahead and self.phase == "holding" and tick >= self.hold_until_tick:
            self._begin_leg(tick)
        return notice

    def _begin(self, tick: int, legs: Sequence[Leg], *, is_new: bool = True) -> None:
        self.course.plan(legs)
        self._begin_leg(tick, is_new=is_new)

    def _begin_leg(self, tick: int, *, is_new: bool = True) -> None:
        self._evasion.begin_leg(tick, is_new=is_new)
        self.course.begin_leg(tick)
        self.phase = self.under_way

    def _stands_at(self, place_m: Vec3) -> bool:
        above_m = place_m[2] - self._space.support_height_m(place_m)
        return above_m <= self._abilities.standing_height_m + STANDS_WITHIN_M

    def _change_of_height(self, name: str, place_m: Vec3) -> Leg:
        return Leg(name=name, place_world_m=place_m, hold_s=self._vehicle.hold_s)

    # Where ways are planned the way back is: what was straight before may no longer be.
    def _go_back(self, tick: int) -> str | None:
        if self._avoidance is None or self.course.kept_velocity_m_s is not None or self.course.leg is None:
            self.course.take_again(tick)
            return None
        legs = [leg for leg in (self.course.leg, *self.course.ahead) if not leg.is_bend]
        return self.set_out(tick, legs, is_return=True)

    def _notice_fall(self, tick: int, uprightness: float) -> str | None:
        if self.phase == "failed" or not self._overturn.sees_fall(tick, uprightness, self.course.velocity_m_s):
            return None
        self._stand(tick)
        return OVERTURNED

    # A vehicle on wheels has stopped, or has turned: the same goal again, as long as that brings it further.
    def _prepare(self, tick: int) -> str | None:
        if not self.course.is_over(tick):
            return None
        if self.course.prepares_for_s(tick) > TURNS_FOR_S:
            self.course.stay(tick, self.course.position_m)
            self._arrive(tick)
            return f"turn: expected to look where it goes within {TURNS_FOR_S:g} s, did not; the vehicle holds."
        self.course.take_again(tick)
        return None

    def _brake_before_edge(self, tick: int) -> str | None:
        edge = self.edges.ahead(tick, self.course)
        if edge is not None:
            self.hold(tick, self._vehicle.hold_s)
        return edge

    def _notice_arrival(self, tick: int) -> str | None:
        match arrival_of(tick, self.course):
            case "passed":
                self._pass(tick)
            case "there" if self.phase == "landing":
                self._stand(tick)
            case "there":
                self._arrive(tick)
            case "late":
                notice = give_up(tick, self.course, self._space)
                self._arrive(tick)
                return notice
        return None

    # After the last place that is passed it goes on as it goes there.
    def _pass(self, tick: int) -> None:
        leg = self.course.leg
        if self.course.ahead:
            self._begin_leg(tick)
        elif leg is not None:
            self.course.pass_on(leg.velocity_world_m_s)
            self.hold_until_tick = tick

    def _arrive(self, tick: int) -> None:
        leg = self.course.end_leg()
        self.phase = "holding"
        self.hold_for(tick, leg.hold_s if leg else 0.0)
        if leg is not None and self._abilities.has_wheels and leg.heading.yaw_rad is not None:
            self.course.look(leg.heading)

    # Rotors or wheels stop, and the agent is asked; whoever has landed can take off again.
    def _stand(self, tick: int) -> None:
        self.course.stand(tick)
        self.is_armed = False
        self.phase = "on_ground"
        self.hold_for(tick, self._vehicle.hold_s)
