"""Terminal of a person: single keys in, a dashboard of the agent's observations out, restored afterwards."""

import contextlib
import math
import os
import sys
import textwrap
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

from gslcosim.base.errors import UsageError
from gslcosim.base.terminal_text import escape_terminal_text
from gslcosim.contract.messages import Briefing, Observation, Reading
from gslcosim.teleop.controls import HELP, KeyControls

if sys.platform != "win32":
    import termios
    import tty

_KEYS_BY_SEQUENCE = {
    "\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left",
    "\x1bOA": "up", "\x1bOB": "down", "\x1bOC": "right", "\x1bOD": "left",
    "\x1b[5~": "page_up", "\x1b[6~": "page_down",
}  # fmt: skip
_KEYS_BY_CHARACTER = {" ": "space", "\r": "enter", "\n": "enter"}
_ENTER_SCREEN = "\x1b[?1049h\x1b[?25l"
_LEAVE_SCREEN = "\x1b[?25h\x1b[?1049l"


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

    Raises:
        UsageError: standard input or output is no terminal, or it is too small.
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


MIN_COLUMNS, MIN_ROWS = 72, 22
HISTORY = 240
SPARK = "▁▂▃▄▅▆▇█"
ARROWS = "→↗↑↖←↙↓↘"
BAR_WIDTH = 16
_LABEL_WIDTH = 22
_FIGURE_WIDTH = 14
_GAS_MARKS = "·∘oO@"
_GAS_QUANTITIES = ("resistance", "mixing_ratio", "path_integrated_mixing_ratio", "hits", "gas_detected")


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
            columns: The width of the terminal.
            rows: Its height.
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
        if reading.values and reading.quantity in _GAS_QUANTITIES and not reading.is_warming_up:
            return -reading.values[0] if reading.unit == "ohm" else reading.values[0]
    return None


def _draw_arrow(angle_rad: float) -> str:
    return ARROWS[round(angle_rad / (math.pi / 4)) % 8]
