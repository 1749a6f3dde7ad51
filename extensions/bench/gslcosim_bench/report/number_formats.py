"""Formats of numbers for people: figures with their intervals, on the page, in Markdown and in tables."""

import math
from collections.abc import Callable

from gslcosim_bench.statistics.estimates import Estimate

ABSENT = "\N{EN DASH}"
"""Text in place of a number that is unknown."""

_MINUS = "\N{MINUS SIGN}"

Format = Callable[[float], str]


def format_percent(value: float) -> str:
    """Return a share as percent, without the sign: 67, or 6.7 below 10."""
    return f"{100 * value:.1f}" if 0.0 < abs(value) < 0.0995 else f"{100 * value:.0f}"


def format_points(value: float) -> str:
    """Return a difference of shares in points, with its sign."""
    return _signed(f"{100 * value:+.0f}")


def format_score(value: float) -> str:
    """Return a score or an area, two digits after the point."""
    return _signed(f"{value:.2f}") if value < 0 else f"{value:.2f}"


def format_three_digits(value: float) -> str:
    """Return a number with about three digits: 123, 12.3, 1.23."""
    digits = 0 if abs(value) >= 99.95 else 1 if abs(value) >= 9.995 else 2
    return _signed(f"{value:.{digits}f}") if value < 0 else f"{value:.{digits}f}"


def format_one_digit(value: float) -> str:
    """Return a number with one digit after the point."""
    return _signed(f"{value:.1f}") if value < 0 else f"{value:.1f}"


def format_estimate(estimate: Estimate, form: Format, *, unit: str = "") -> str:
    """Return a figure with its interval: 67 (58 to 75) %."""
    if math.isnan(estimate.value):
        return ABSENT
    return f"{format_value(estimate, form)}{format_interval(estimate, form, ' ({})')}{unit and ' ' + unit}"


def format_value(estimate: Estimate, form: Format) -> str:
    """Return a figure alone."""
    return ABSENT if math.isnan(estimate.value) else "∞" if math.isinf(estimate.value) else form(estimate.value)


def format_interval(estimate: Estimate, form: Format, frame: str = "{}") -> str:
    """Return the ends of its interval in a frame; empty where there is none."""
    if math.isnan(estimate.low) or math.isnan(estimate.high):
        return ""
    low, high = ("∞" if math.isinf(end) else form(end) for end in (estimate.low, estimate.high))
    # A dash between signs is hard to read.
    between = " to " if {low[0], high[0]} & {"+", _MINUS} else ABSENT
    return frame.format(low + between + high)


def format_ranks(first: int, last: int) -> str:
    """Return the places that an entry may have: 2, or 2–5."""
    return str(first) if first == last else f"{first}{ABSENT}{last}"


def format_duration(seconds: float) -> str:
    """Return a time by the clock: 540 ms, 12.3 s, 4 min 5 s, 2 h 3 min."""
    if seconds < 1.0:
        return f"{1000 * seconds:.3g} ms"
    if seconds < 60.0:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


# A true minus; none before zero.
def _signed(text: str) -> str:
    return text.replace("-", _MINUS) if any(digit in text for digit in "123456789") else text.lstrip("+-")
