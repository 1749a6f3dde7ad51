"""Radio reports of a swarm: a short text for a measurement, and a memory of the others' reports.

A report in ASCII is `g TIME X Y Z AMOUNT`, and after it any of `wX Y`, `bX Y Z AMOUNT` and `nV V ...`:

    g 415 723 511 200 2004e-8 w52 -10 b690 500 200 2104e-8 n3 25e-2

Times are tenths of a second, places centimetres, winds centimetres a second (where the air goes, x and y); amounts
and numbers have up to four digits and a power of ten. `w` is the wind, `b` the best place that the robot knows of with
the amount there (as it counts at TIME), `n` are numbers that only the method understands. In a room of less than 100 m
a report with wind and best place has at most 63 bytes.
"""

import re
from dataclasses import dataclass, replace

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Briefing, ChannelDescription, Observation, RadioMessage

MAX_NUMBERS = 8
EARLY_S = 1.0
_WHOLE = r"-?[0-9]{1,6}"
_AMOUNT = r"-?[0-9]{1,4}(?:e-?[0-9]{1,2})?"
_PLACE = rf"{_WHOLE} {_WHOLE} {_WHOLE}"
_REPORT = re.compile(
    rf"g ([0-9]{{1,6}}) ({_PLACE}) ({_AMOUNT})(?: w({_WHOLE} {_WHOLE}))?(?: b({_PLACE}) ({_AMOUNT}))?"
    rf"(?: n({_AMOUNT}(?: {_AMOUNT}){{0,{MAX_NUMBERS - 1}}}))?"
)


@dataclass(frozen=True, kw_only=True)
class ReportedBest:
    """A place in the world frame [m] and how much gas there was, in whatever unit the team agrees on."""

    position_m: Vec3
    amount: float


@dataclass(frozen=True, kw_only=True)
class Report:
    """Report of one robot to the others.

    `time_s` is when it measured `amount` of gas at `position_m`; `wind_m_s` is where the air goes there (x, y).
    `best` is the best place that it knows of, its own or one it has heard of; its amount counts at `time_s`.
    `numbers` are up to eight numbers of the method's own.
    """

    time_s: float
    position_m: Vec3
    amount: float
    wind_m_s: tuple[float, float] | None = None
    best: ReportedBest | None = None
    numbers: tuple[float, ...] = ()


def encode(report: Report, *, max_bytes: int) -> str | None:
    """Return the text of a report, or None where not even time, place and amount fit.

    What does not fit is left out whole, in the order wind, best place, numbers; before that, amounts are cut to three
    digits. A listener gets fewer facts, but never a wrong one.
    """
    for cut in (
        report,
        replace(report, wind_m_s=None),
        replace(report, wind_m_s=None, best=None),
        replace(report, wind_m_s=None, best=None, numbers=()),
    ):
        for n_digits in (4, 3):
            text = _text_of(cut, n_digits)
            if len(text) <= max_bytes:
                return text
    return None


def parse(text: str) -> Report | None:
    """Return the report in a text, or None for anything else that may be on the channel."""
    found = _REPORT.fullmatch(text) if len(text) <= 200 else None
    if found is None:
        return None
    time, place, amount, wind, best_place, best_amount, numbers = found.groups()
    return Report(
        time_s=int(time) / 10.0,
        position_m=_place_m(place),
        amount=float(amount),
        wind_m_s=None if wind is None else _wind_m_s(wind),
        best=None if best_place is None else ReportedBest(position_m=_place_m(best_place), amount=float(best_amount)),
        numbers=() if numbers is None else tuple(float(number) for number in numbers.split()),
    )


class Team:
    """Last reports of the other robots on one channel, with their ages.

    Texts get lost, come late and come twice: what is not newer than what is known of its sender is dropped, and so
    is what was said by strangers, on other channels or in another language.
    """

    def __init__(self, briefing: Briefing, channel: str = "") -> None:
        """Join a channel of the briefing: the named one, or else the first; without any the robot is alone."""
        self.name = briefing.agent
        self.channel = _channel_of(briefing, channel)
        members = () if self.channel is None else self.channel.members
        self.members = tuple(sorted({*members, self.name}))
        self.reports: dict[str, Report] = {}

    @property
    def others(self) -> tuple[str, ...]:
        """Names of the other members, sorted, whether or not they were ever heard."""
        return tuple(name for name in self.members if name != self.name)

    @property
    def index(self) -> int:
        """Return the robot's own place among the sorted names of all members."""
        return self.members.index(self.name)

    def receive(self, observation: Observation) -> tuple[tuple[str, Report], ...]:
        """Take in what an observation brings; return the news, as (sender, report). For `observe`: every tick."""
        news: list[tuple[str, Report]] = []
        for reception in observation.incoming:
            report = parse(reception.text)
            if report is None or not self._is_news(reception.sender, reception.channel, report, observation.time_s):
                continue
            self.reports[reception.sender] = report
            news.append((reception.sender, report))
        return tuple(news)

    def age_s(self, name: str, now_s: float) -> float:
        """Return how old the last report of a member is; infinite when there is none."""
        return now_s - self.reports[name].time_s if name in self.reports else float("inf")

    def recent(self, now_s: float, max_age_s: float = float("inf")) -> dict[str, Report]:
        """Return the last reports that are no older than `max_age_s`, by name in sorted order."""
        names = (name for name in self.others if name in self.reports)
        return {name: self.reports[name] for name in names if self.age_s(name, now_s) <= max_age_s}

    def call(self, report: Report, to: str = "all") -> tuple[RadioMessage, ...]:
        """Return the `outgoing` texts for the others; nothing without a channel or where it does not fit."""
        if self.channel is None:
            return ()
        text = encode(report, max_bytes=self.channel.max_bytes)
        return () if text is None else (RadioMessage(channel=self.channel.name, text=text, to=to),)

    def _is_news(self, sender: str, channel: str, report: Report, now_s: float) -> bool:
        if self.channel is None or channel != self.channel.name or sender not in self.others:
            return False
        if report.time_s > now_s + EARLY_S:  # a clock that is ahead would make its sender deaf to correction
            return False
        return sender not in self.reports or report.time_s > self.reports[sender].time_s


def _channel_of(briefing: Briefing, name: str) -> ChannelDescription | None:
    return next((channel for channel in briefing.channels if name in ("", channel.name)), None)


def _text_of(report: Report, n_digits: int) -> str:
    parts = [f"g {max(0, _whole(report.time_s, 10))} {_place(report.position_m)} {_amount(report.amount, n_digits)}"]
    if report.wind_m_s is not None:
        parts.append("w" + " ".join(str(_whole(speed_m_s, 100)) for speed_m_s in report.wind_m_s))
    if report.best is not None:
        parts.append(f"b{_place(report.best.position_m)} {_amount(report.best.amount, n_digits)}")
    if report.numbers:
        parts.append("n" + " ".join(_amount(number, n_digits) for number in report.numbers[:MAX_NUMBERS]))
    return " ".join(parts)


def _place(position_m: Vec3) -> str:
    return " ".join(str(_whole(length_m, 100)) for length_m in position_m)


# Clipped, so that no number has more than six digits.
def _whole(value: float, per_unit: int) -> int:
    return max(-999_999, min(999_999, round(value * per_unit)))


# A whole mantissa and a power of ten, which is shorter than `%g` for small numbers: 2004e-8.
def _amount(value: float, n_digits: int) -> str:
    value = max(-1e90, min(1e90, value))
    if abs(value) < 1e-90:
        return "0"
    mantissa, exponent = f"{value:.{n_digits - 1}e}".split("e")
    digits = mantissa.replace(".", "")
    shift = int(exponent) - n_digits + 1
    shorter = digits.rstrip("0")
    shift += len(digits) - len(shorter)
    if 0 <= shift <= n_digits - len(shorter.lstrip("-")):
        return shorter + "0" * shift
    return f"{shorter}e{shift}"


def _place_m(text: str) -> Vec3:
    x, y, z = (int(part) / 100.0 for part in text.split())
    return x, y, z


def _wind_m_s(text: str) -> tuple[float, float]:
    x, y = (int(part) / 100.0 for part in text.split())
    return x, y
