"""Teleoperation: a person in place of an agent, who sees its observations on a terminal and commands with keys."""

import _thread
import contextlib
import json
import math
import os
import select
import socket
import sys
import textwrap
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from io import RawIOBase
from pathlib import Path
from typing import Any, Literal, Self

import msgpack  # pyright: ignore[reportMissingTypeStubs]

from gslcosim.base.errors import UsageError
from gslcosim.base.quantities import GAS_QUANTITIES, Vec3
from gslcosim.base.untrusted_input import escape_terminal_text
from gslcosim.contract import codec
from gslcosim.contract.length_prefix import prefix_length, read_frame
from gslcosim.contract.messages import Briefing, Command, Declaration, Ending, Observation, Reading

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
_KEYS_BY_SEQUENCE = {
    "\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left",
    "\x1bOA": "up", "\x1bOB": "down", "\x1bOC": "right", "\x1bOD": "left",
    "\x1b[5~": "page_up", "\x1b[6~": "page_down",
}  # fmt: skip
_KEYS_BY_CHARACTER = {" ": "space", "\r": "enter", "\n": "enter"}
_ENTER_SCREEN = "\x1b[?1049h\x1b[?25l"
_LEAVE_SCREEN = "\x1b[?25h\x1b[?1049l"
MIN_COLUMNS, MIN_ROWS = 72, 22
HISTORY = 240
SPARK = "▁▂▃▄▅▆▇█"
ARROWS = "→↗↑↖←↙↓↘"
BAR_WIDTH = 16
_LABEL_WIDTH = 22
_FIGURE_WIDTH = 14
_GAS_MARKS = "·∘oO@"
DRAW_PERIOD_S = 0.05
POLL_PERIOD_S = 0.1
# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack


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


if sys.platform != "win32":
    import termios
    import tty


def parse_keys(text: str) -> list[str]:
    """Return the keys in what a terminal has sent: names of special ones, others as they are, in lower case."""
    keys: list[str] = []
    at = 0
    while at < len(text):
        special = next((known for known in _KEYS_BY_SEQUENCE if text.startswith(known, at)), None)
        if special is not None:
            keys.append(_KEYS_BY_SEQUENCE[special])
        elif text[at] == "\x1b":
            # An escape sequence of another key says nothing here.
            at = _find_sequence_end(text, at)
            continue
        elif text[at] in _KEYS_BY_CHARACTER or text[at].isprintable():
            keys.append(_KEYS_BY_CHARACTER.get(text[at], text[at].lower()))
        at += len(special or text[at])
    return keys


def _find_sequence_end(text: str, at: int) -> int:
    if at + 1 >= len(text) or text[at + 1] not in "[O":
        return at + 1
    end = at + 2
    while end < len(text) and not ("@" <= text[end] <= "~"):
        end += 1
    return end + 1


def check_terminal(columns: int, rows: int) -> None:
    """Refuse to begin where nobody could see or press anything.

    Args:
        columns: The least width.
        rows: The least height.
    """
    if sys.platform == "win32":
        raise UsageError("fly: expected a terminal of Linux or macOS, this system has none of that kind.")
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise UsageError("fly: expected a terminal as standard input and output, was none. Run it in one.")
    size = os.get_terminal_size(sys.stdout.fileno())
    if size.columns < columns or size.lines < rows:
        raise UsageError(
            f"fly: expected a terminal of at least {columns} columns and {rows} rows, was {size.columns} x "
            f"{size.lines}. Enlarge it, or take a smaller font."
        )


class Terminal:
    """The terminal of this process within this context. Ctrl-C stays a signal."""

    def __init__(self) -> None:
        self._input = sys.stdin.fileno()
        self._output = sys.stdout.fileno()
        self._before: list[Any] | None = None

    def __enter__(self) -> Self:
        self._before = termios.tcgetattr(self._input)
        tty.setcbreak(self._input)
        self._write(_ENTER_SCREEN)
        return self

    def __exit__(self, *_: object) -> None:
        self._write(_LEAVE_SCREEN)
        if self._before is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._input, termios.TCSADRAIN, self._before)

    @property
    def number(self) -> int:
        """The file descriptor to wait for."""
        return self._input

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        size = os.get_terminal_size(self._output)
        return size.columns, size.lines

    def read(self) -> list[str]:
        """Return the keys that were pressed."""
        return parse_keys(os.read(self._input, 1024).decode(errors="ignore"))

    def show(self, lines: Sequence[str]) -> None:
        """Draw a picture over the last one."""
        shown = (escape_terminal_text(line, is_one_line=True) for line in lines)
        self._write("\x1b[H" + "\x1b[K\r\n".join(shown) + "\x1b[K\x1b[J")

    def _write(self, text: str) -> None:
        left = text.encode()
        with contextlib.suppress(OSError):
            while left:
                left = left[os.write(self._output, left) :]


@dataclass
class _History:
    """The history of one value, and its least and greatest so far."""

    values: deque[float] = field(default_factory=lambda: deque[float](maxlen=HISTORY))
    low: float = math.inf
    high: float = -math.inf

    def add(self, value: float) -> None:
        self.values.append(value)
        self.low, self.high = min(self.low, value), max(self.high, value)

    def share(self, value: float) -> float:
        return (value - self.low) / (self.high - self.low) if self.high > self.low else 0.0

    def bar(self) -> str:
        n_full = round(BAR_WIDTH * self.share(self.values[-1]))
        return "█" * n_full + "░" * (BAR_WIDTH - n_full)

    # The newest to the right; each sign is the mean of as many values as have to share it.
    def spark(self, width: int) -> str:
        values = list(self.values)
        n_each = max(1, math.ceil(len(values) / width))
        means = [sum(part) / len(part) for i in range(0, len(values), n_each) if (part := values[i : i + n_each])]
        return "".join(SPARK[min(len(SPARK) - 1, int(self.share(mean) * len(SPARK)))] for mean in means)


@dataclass
class Dashboard:
    """Remembers what the agent was sent, and lays it out.

    State: curves of all readings with at most three values; the way so far, by cells of the map, with the strongest
    gas reading there.
    """

    briefing: Briefing
    _curves: dict[tuple[str, int], _History] = field(default_factory=dict[tuple[str, int], _History])
    _visited: dict[tuple[float, float], float] = field(default_factory=dict[tuple[float, float], float])
    _gas: _History = field(default_factory=_History)
    _heard: deque[str] = field(default_factory=lambda: deque[str](maxlen=3))
    _seen: Observation | None = None

    def see(self, observation: Observation) -> None:
        """Take an observation."""
        self._seen = observation
        for reading in observation.readings:
            for i, value in enumerate(reading.values[:3]):
                if not reading.is_warming_up:
                    self._curves.setdefault((reading.sensor, i), _History()).add(value)
        x_m, y_m, _ = observation.position_world_m
        place = (round(x_m, 1), round(y_m, 1))
        strength = _get_gas_strength(observation)
        if strength is not None:
            self._gas.add(strength)
        self._visited[place] = max(self._visited.get(place, -math.inf), -math.inf if strength is None else strength)
        self._heard.extend(f"{text.sender}: {text.text}" for text in observation.incoming)

    def lines(self, controls: KeyControls, *, columns: int, rows: int) -> list[str]:
        """Return the picture, at most `rows` lines of at most `columns` signs.

        Args:
            controls: The person's hand.
        """
        if columns < MIN_COLUMNS or rows < MIN_ROWS:
            return [f"The terminal is too small: it needs {MIN_COLUMNS} x {MIN_ROWS}."[:columns]]
        seen = self._seen
        if seen is None:
            return [self.briefing.mission[:columns], "Nothing is seen yet."]
        head = [*self._state(seen, controls), "", *self._readings(seen, columns), ""]
        foot = ["", *self._notes(seen, controls), *HELP]
        free = rows - len(head) - len(foot)
        map_lines = self._map(seen, controls, columns=columns, rows=free) if free >= 5 else []
        return [line[:columns] for line in [*head, *map_lines, *foot]][:rows]

    def _state(self, seen: Observation, controls: KeyControls) -> list[str]:
        x_m, y_m, z_m = seen.position_world_m
        speed_m_s = math.hypot(*seen.velocity_world_m_s)
        asked = "   YOU ARE ASKED" if controls.waits_for_questions and controls.is_asked else ""
        target = "none" if controls.target_m is None else "({:.2f}, {:.2f}, {:.2f}) m".format(*controls.target_m)
        return [
            *textwrap.wrap(self.briefing.mission, MIN_COLUMNS),
            f"{seen.time_s:6.1f} s of {self.briefing.time_limit_s:g} s   {seen.status.replace('_', ' ')}{asked}",
            f"at ({x_m:.2f}, {y_m:.2f}, {z_m:.2f}) m   {speed_m_s:.2f} m/s   heading {_draw_arrow(seen.yaw_rad)}"
            f"   sent to {target}   step {controls.step_m:g} m",
        ]

    def _readings(self, seen: Observation, columns: int) -> list[str]:
        lines: list[str] = []
        for reading in seen.readings:
            if reading.image is not None or len(reading.values) > 3:
                continue
            if reading.is_warming_up:
                lines.append(f"{reading.sensor:<{_LABEL_WIDTH}.{_LABEL_WIDTH}} does not measure now")
                continue
            lines += [self._reading_line(reading, i, columns) for i in range(len(reading.values))]
        return lines

    def _reading_line(self, reading: Reading, i: int, columns: int) -> str:
        units = reading.unit.split(", ")
        unit = units[i] if i < len(units) else units[-1]
        label = reading.sensor if len(reading.values) == 1 else f"{reading.sensor} {i + 1}"
        figure = f"{reading.values[i]:.4g} {unit}" + (" (full)" if reading.is_saturated else "")
        start = f"{label:<{_LABEL_WIDTH}.{_LABEL_WIDTH}} {figure:>{_FIGURE_WIDTH}} "
        if unit == "rad":
            return f"{start}from {_draw_arrow(reading.values[i])}"
        curve = self._curves[reading.sensor, i]
        return f"{start}{curve.bar()} {curve.spark(max(8, columns - len(start) - BAR_WIDTH - 1))}"

    def _notes(self, seen: Observation, controls: KeyControls) -> list[str]:
        notes = [f"! {seen.notice}"] if seen.notice else []
        notes += [f"radio  {text}" for text in self._heard]
        return [*notes, controls.note]

    # A cell is about twice as high as wide, as signs of a terminal are.
    def _map(self, seen: Observation, controls: KeyControls, *, columns: int, rows: int) -> list[str]:
        low, high = self.briefing.bounds.min_m, self.briefing.bounds.max_m
        length_m, width_m = high[0] - low[0], high[1] - low[1]
        metres_a_row = max(width_m / (rows - 2), 2.0 * length_m / (columns - 2))
        n_rows = max(1, math.ceil(width_m / metres_a_row))
        n_columns = max(1, math.ceil(2.0 * length_m / metres_a_row))
        cells = [[" "] * n_columns for _ in range(n_rows)]

        def put(x_m: float, y_m: float, sign: str) -> None:
            column = int((x_m - low[0]) / metres_a_row * 2.0)
            row = n_rows - 1 - int((y_m - low[1]) / metres_a_row)
            if 0 <= column < n_columns and 0 <= row < n_rows:
                old = cells[row][column]
                if old not in _GAS_MARKS or sign not in _GAS_MARKS or _GAS_MARKS.index(sign) > _GAS_MARKS.index(old):
                    cells[row][column] = sign

        for (x_m, y_m), strength in self._visited.items():
            share = self._gas.share(strength) if math.isfinite(strength) else 0.0
            put(x_m, y_m, _GAS_MARKS[min(len(_GAS_MARKS) - 1, int(share * len(_GAS_MARKS)))])
        if controls.target_m is not None:
            put(*controls.target_m[:2], "+")
        put(*seen.position_world_m[:2], _draw_arrow(seen.yaw_rad))
        edge = "─" * n_columns
        return [f"┌{edge}┐", *(f"│{''.join(row)}│" for row in cells), f"└{edge}┘"]


# Of the first sensor that tells of gas, in its unit; a resistance falls where there is more.
def _get_gas_strength(observation: Observation) -> float | None:
    for reading in observation.readings:
        if reading.values and reading.quantity in GAS_QUANTITIES and not reading.is_warming_up:
            return -reading.values[0] if reading.unit == "ohm" else reading.values[0]
    return None


def _draw_arrow(angle_rad: float) -> str:
    return ARROWS[round(angle_rad / (math.pi / 4)) % 8]


class TeleopClient(threading.Thread):
    """Thread that flies an agent by hand, from the moment its join file is there until the run ends.

    Args:
        keyboard: The terminal.
        waits_for_questions: Whether commands are given only where the agent is asked.
        step_m: How long a step is.
        progress: Says what the run does before it flies.
    """

    def __init__(
        self, keyboard: Terminal, *, waits_for_questions: bool, step_m: float, progress: Callable[[], str]
    ) -> None:
        super().__init__(daemon=True)
        self._keyboard = keyboard
        self._waits_for_questions = waits_for_questions
        self._step_m = step_m
        self._progress = progress
        self._join_file: Path | None = None
        self._is_over = threading.Event()
        self._connection: socket.socket | None = None
        self._controls: KeyControls | None = None
        self._dashboard: Dashboard | None = None
        self._drawn_at_s = 0.0
        self.failure: Exception | None = None

    def attach(self, join_file: Path) -> None:
        """Say where the join data will be; on any thread."""
        self._join_file = join_file

    def leave(self) -> None:
        """End the thread, whatever the run does, and wait for it."""
        self._is_over.set()
        self.join(timeout=5.0)

    def run(self) -> None:
        """Wait for the run, then fly until it ends or the person gives up."""
        try:
            self._connection = self._connected()
            if self._connection is not None:
                with self._connection, self._connection.makefile("rb", buffering=0) as frames:
                    self._fly(self._connection, frames)
        except Exception as error:  # reported by the caller that has started the thread and may be waiting
            self.failure = error
            _thread.interrupt_main()

    def _connected(self) -> socket.socket | None:
        while not self._is_over.is_set():
            self._draw_text(self._progress())
            if self._join_file is not None and self._join_file.is_file():
                join = json.loads(self._join_file.read_text())
                connection = socket.socket(socket.AF_UNIX)
                connection.connect(join["gateway"].partition(":")[2])
                connection.sendall(prefix_length(_msgpack.packb({"token": join["token"]})))
                return connection
            # Keys that are pressed now mean nothing.
            if select.select([self._keyboard.number], [], [], POLL_PERIOD_S)[0]:
                self._keyboard.read()
        return None

    def _fly(self, connection: socket.socket, frames: RawIOBase) -> None:
        while not self._is_over.is_set():
            ready, _, _ = select.select([connection, self._keyboard.number], [], [], POLL_PERIOD_S)
            if connection in ready and not self._receive(frames):
                return
            if self._keyboard.number in ready:
                for key in self._keyboard.read():
                    if not self._press(key, connection):
                        return
            self._draw()

    # False at the end of the run.
    def _receive(self, frames: RawIOBase) -> bool:
        try:
            frame = read_frame(frames)
        except OSError:
            return False
        if frame is None:
            return False
        fields: dict[str, Any] = _msgpack.unpackb(frame, use_list=False)
        return self._take(str(fields.pop("message")), fields)

    def _take(self, message: str, fields: dict[str, Any]) -> bool:
        if message == Briefing.__name__:
            briefing = codec.build_message(Briefing, fields)
            self._controls = KeyControls(briefing, waits_for_questions=self._waits_for_questions, step_m=self._step_m)
            self._dashboard = Dashboard(briefing)
        elif message == Observation.__name__ and self._controls is not None and self._dashboard is not None:
            observation = codec.build_message(Observation, fields)
            self._controls.see(observation)
            self._dashboard.see(observation)
        return message != Ending.__name__

    # False when the person gives up.
    def _press(self, key: str, connection: socket.socket) -> bool:
        wish = self._controls.press(key) if self._controls is not None else None
        if wish == "quit":
            return False
        if isinstance(wish, Command):
            with contextlib.suppress(OSError):
                connection.sendall(prefix_length(codec.encode(wish)))
        return True

    def _draw(self) -> None:
        now_s = time.monotonic()
        if self._dashboard is None or self._controls is None or now_s - self._drawn_at_s < DRAW_PERIOD_S:
            return
        self._drawn_at_s = now_s
        columns, rows = self._keyboard.size
        self._keyboard.show(self._dashboard.lines(self._controls, columns=columns, rows=rows))

    def _draw_text(self, text: str) -> None:
        columns, _ = self._keyboard.size
        self._keyboard.show([text[:columns]])
