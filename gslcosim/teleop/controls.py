"""Key bindings: from a key and the last observation to a command. No terminal, no socket, no clock."""

from dataclasses import dataclass
from typing import Literal

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Briefing, Command, Declaration, Observation

CLIMB_M = 0.25
MIN_STEP_M, MAX_STEP_M = 0.125, 8.0
# x is to the right on the map, y up.
_DIRECTIONS = {
    "up": (0, 1), "w": (0, 1), "down": (0, -1), "s": (0, -1),
    "right": (1, 0), "d": (1, 0), "left": (-1, 0), "a": (-1, 0),
}  # fmt: skip
_CLIMBS = {"r": 1, "page_up": 1, "f": -1, "page_down": -1}
_KEYS_TO_CONFIRM = {"x": "declare that the source is here", "q": "give up"}

HELP = (
    "arrows, w a s d  go a step    r f  higher, lower    [ ]  other steps",
    "space  hold   t l  take off, land   x x  source is here   q q  give up",
)

ControlRequest = Command | Literal["quit"] | None


@dataclass
class KeyControls:
    """State of manual control: length of a step, last target of the vehicle, and keys that await a second press.

    A step begins where the vehicle was last sent, so that three keys are three steps; after a refusal, a hold or a
    landing, where it is. With `waits_for_questions` a command is given only where the agent is asked.
    """

    briefing: Briefing
    waits_for_questions: bool = False
    step_m: float = 1.0
    note: str = ""
    seen: Observation | None = None
    target_m: Vec3 | None = None
    _pressed_once: str = ""
    _answered_tick: int = -1

    def see(self, observation: Observation) -> None:
        """Take an observation; a new refusal ends the way there."""
        if observation.notice is not None and (self.seen is None or self.seen.notice != observation.notice):
            self.target_m = None
        self.seen = observation

    @property
    def is_asked(self) -> bool:
        """True when the run waits for a command."""
        seen = self.seen
        return seen is not None and seen.awaiting_command and seen.tick > self._answered_tick

    def press(self, key: str) -> ControlRequest:
        """Take a key and return the command that it gives, if it gives one."""
        self.note = ""
        if key in _KEYS_TO_CONFIRM and self._pressed_once != key:
            self._pressed_once, self.note = key, f"Press {key} again to {_KEYS_TO_CONFIRM[key]}."
            return None
        self._pressed_once = ""
        if key == "q":
            return "quit"
        if key in ("[", "]"):
            factor = 2.0 if key == "]" else 0.5
            self.step_m = min(MAX_STEP_M, max(MIN_STEP_M, self.step_m * factor))
            return None
        return self._given(key)

    def _given(self, key: str) -> Command | None:
        if self.seen is None:
            self.note = "Nothing is seen yet."
            return None
        if self.waits_for_questions and not self.is_asked:
            self.note = "Wait until you are asked."
            return None
        command = self._command(key, self.seen)
        if command is not None:
            self._answered_tick = self.seen.tick
        return command

    def _command(self, key: str, seen: Observation) -> Command | None:
        tick = seen.tick
        if key in _DIRECTIONS or key in _CLIMBS:
            self.target_m = self._stepped(key, seen)
            return Command(tick=tick, kind="waypoint", position_world_m=self.target_m, hold_s=0.0)
        if key == "space":
            self.target_m = None
            return Command(tick=tick, kind="hold", hold_s=0.0)
        if key == "x":
            self.target_m = None
            declaration = Declaration(position_world_m=seen.position_world_m)
            return Command(tick=tick, kind="declare_source", declaration=declaration)
        if key in ("t", "l"):
            self.target_m = None
            return Command(tick=tick, kind="take_off" if key == "t" else "land")
        self.note = f"No such key: {key}."
        return None

    def _stepped(self, key: str, seen: Observation) -> Vec3:
        x_m, y_m, z_m = self.target_m or (*seen.position_world_m[:2], self._height_m(seen))
        dx, dy = _DIRECTIONS.get(key, (0, 0))
        dz_m = CLIMB_M * _CLIMBS.get(key, 0)
        return round(x_m + dx * self.step_m, 3), round(y_m + dy * self.step_m, 3), round(z_m + dz_m, 3)

    # On the ground it is sent to its search height.
    def _height_m(self, seen: Observation) -> float:
        is_low = seen.status in ("on_ground", "taking_off", "driving")
        return self.briefing.search_height_m if is_low else seen.position_world_m[2]
