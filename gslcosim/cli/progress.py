"""Progress on standard error, as a live line on a terminal or as lines in a pipe; pages that are redrawn."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Self

from gslcosim.cli.terminal import open_console, plain_text, write_note

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live
    from rich.table import Table

_REFRESH_HZ = 10
_BAR_WIDTH = 24
_TEXT_COLUMN = 2
# Minimum interval of lines in a pipe [s]; for long work a fraction of its elapsed time, up to a limit.
_PLAIN_EVERY_S = 10.0
_PLAIN_SHARE, _PLAIN_AT_MOST_S = 0.05, 300.0


# Elapsed time before the first estimate [s].
_ESTIMATE_AFTER_S = 5.0


class RemainingTime:
    """Estimate of the remaining time of a piece of work, from the fraction done and the elapsed time."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Use this clock [s]."""
        self._clock = clock
        self._piece = ""
        self._began_s = 0.0
        self._began_share = 0.0

    def describe(self, piece: str, fraction: float | None) -> str:
        """Return the percentage done and the time left, such as `20 %, about 3 min left`; empty without an estimate."""
        left = self.estimate(piece, fraction)
        return f"{100 * (fraction or 0.0):.0f} %, {left}" if left else ""

    def estimate(self, piece: str, fraction: float | None) -> str:
        """Return the time left, such as `about 3 min left`; empty without an estimate."""
        now_s, share = self._clock(), fraction or 0.0
        if piece != self._piece or share < self._began_share:
            self._piece, self._began_s, self._began_share = piece, now_s, share
        elapsed_s, done = now_s - self._began_s, share - self._began_share
        if fraction is None or elapsed_s < _ESTIMATE_AFTER_S or done <= 0.0:
            return ""
        left_s = elapsed_s * (1.0 - share) / done
        minutes = round(left_s / 60)
        left = f"{minutes} min" if minutes > 1 else f"{max(10 * round(left_s / 10), 10)} s"
        return f"about {left} left"


class ProgressLine:
    """Progress of long work: redrawn on a terminal, written now and then in a pipe.

    A context manager. On a terminal it leaves no trace, and an update costs no more than an assignment.
    """

    def __init__(self, title: str = "", *, is_quiet: bool) -> None:
        """Set the beginning of the line; `is_quiet` shows nothing."""
        self._title = title
        self._is_quiet = is_quiet
        self._is_terminal = sys.stderr.isatty()
        self._drawn: tuple[str, str | Callable[[], str], float | None] = (title, "", None)
        self._live: Live | None = None
        self._spinner: Any = None
        self._written_at_s: dict[str, float] = {}
        self._begun_at_s: dict[str, float] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def show(
        self,
        text: str | Callable[[], str],
        *,
        fraction: float | None = None,
        phase: str = "",
        plain: str = "",
        is_last: bool = False,
    ) -> None:
        """Show the progress of the work.

        Args:
            text: Description of the progress, or a function that returns it when it is drawn.
            fraction: Fraction done, for a bar on a terminal; None if unknown.
            phase: A part of the work; lines of each come in a pipe some seconds apart.
            plain: The description for a pipe; empty: `text`.
            is_last: Written to a pipe regardless of the interval.
        """
        if self._is_quiet:
            return
        title = f"{self._title}, {phase}" if phase else self._title
        if self._is_terminal:
            self._drawn = title, text, fraction
            self._draw()
            return
        now_s = time.monotonic()
        worked_s = now_s - self._begun_at_s.setdefault(phase, now_s)
        pause_s = min(max(_PLAIN_EVERY_S, _PLAIN_SHARE * worked_s), _PLAIN_AT_MOST_S)
        if is_last or now_s - self._written_at_s.get(phase, -1e9) >= pause_s:
            self._written_at_s[phase] = now_s
            words = plain or (text if isinstance(text, str) else text())
            write_note(f"{title}: {words}" if title else words)

    def count(self, done: int, total: int, *, phase: str = "") -> None:
        """Show the number done and the total (0: unknown)."""
        text = f"{done} of {total}" if total else f"{done} trials"
        self.show(text, fraction=done / total if total else None, phase=phase)

    def note(self, text: str) -> None:
        """Write a line that stays."""
        if not self._is_quiet:
            write_note(text)

    def end(self) -> None:
        """Remove the line; the next text starts a new one."""
        self._written_at_s.clear()
        self._begun_at_s.clear()
        if self._live is not None:
            self._live.stop()
            self._live = None

    def render(self) -> "Table":
        """Return the line as a terminal shows it."""
        from rich.progress_bar import ProgressBar
        from rich.spinner import Spinner
        from rich.table import Table

        title, text, fraction = self._drawn
        self._spinner = self._spinner or Spinner("dots")
        line = Table.grid(padding=(0, 1))
        cells: list[Any] = [self._spinner, plain_text(title), plain_text(text if isinstance(text, str) else text())]
        if fraction is not None:
            cells += [ProgressBar(total=1.0, completed=fraction, width=_BAR_WIDTH), f"{100 * fraction:3.0f} %"]
        for i in range(len(cells)):
            line.add_column(no_wrap=True, overflow="ellipsis" if i == _TEXT_COLUMN else "crop")
        line.add_row(*cells)
        return line

    # Output of other code meanwhile appears above the line.
    def _draw(self) -> None:
        if self._live is None:
            from rich.live import Live

            console = open_console(sys.stderr)
            self._live = Live(
                get_renderable=self.render, console=console, refresh_per_second=_REFRESH_HZ, transient=True
            )
            self._live.start()


@contextlib.contextmanager
def draw_pages() -> "Iterator[Callable[..., None]]":
    """Yield a function that draws parts of a page, one below the other, on a terminal in place of the last page.

    The last page stays.
    """
    from rich.console import Group
    from rich.live import Live

    console = open_console(sys.stdout)
    with Live(console=console, auto_refresh=False, redirect_stdout=False, redirect_stderr=False) as live:

        def draw(*parts: "RenderableType") -> None:
            live.update(Group(*parts), refresh=True)

        yield draw
