"""Synchronous rounds of a team over radio, and its reports: a short text for a measurement, and a memory of them.

A report in ASCII is `g TIME X Y Z AMOUNT`, and after it any of `wX Y`, `bX Y Z AMOUNT` and `nV V ...`:

    g 415 723 511 200 2004e-8 w52 -10 b690 500 200 2104e-8 n3 25e-2

Times are tenths of a second, places centimetres, winds centimetres a second (where the air goes, x and y); amounts
and numbers have up to four digits and a power of ten. `w` is the wind, `b` the best place that the robot knows of with
the amount there (as it counts at TIME), `n` are numbers that only the method understands. In a room of less than 100 m
a report with wind and best place has at most 63 bytes.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Briefing, ChannelDescription, Command, Observation, RadioMessage
from gslcosim_search import elementary
from gslcosim_search.senses.instruments import Nose, Vane
from gslcosim_search.senses.stop_and_measure import Measurement, StopAndMeasure

MAX_NUMBERS = 8
EARLY_S = 1.0
_WHOLE = r"-?[0-9]{1,6}"
_AMOUNT = r"-?[0-9]{1,4}(?:e-?[0-9]{1,2})?"
_PLACE = rf"{_WHOLE} {_WHOLE} {_WHOLE}"
_REPORT = re.compile(
    rf"g ([0-9]{{1,6}}) ({_PLACE}) ({_AMOUNT})(?: w({_WHOLE} {_WHOLE}))?(?: b({_PLACE}) ({_AMOUNT}))?"
    rf"(?: n({_AMOUNT}(?: {_AMOUNT}){{0,{MAX_NUMBERS - 1}}}))?"
)
# The round's number is the first of a report's own numbers.
_NUMBER = 0


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
        """Return the age of the last report of a member [s]; infinite when there is none."""
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


def _ppm_of(measurement: Measurement) -> float:
    return measurement.ppm[0]


@dataclass(frozen=True, kw_only=True)
class Round:
    """Readings of the team in one round: a report of each robot that sent one, the own among them, by sorted names."""

    number: int
    reports: dict[str, Report]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the robots that reported, sorted."""
        return tuple(self.reports)

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """The (n, 2) places of the readings, world frame [m]."""
        return np.array([report.position_m[:2] for report in self.reports.values()], dtype=np.float64)

    @property
    def amounts(self) -> NDArray[np.float64]:
        """The (n,) amounts of gas."""
        return np.array([report.amount for report in self.reports.values()], dtype=np.float64)

    @property
    def has_gas(self) -> bool:
        """True if any robot has gas."""
        return any(report.amount > 0.0 for report in self.reports.values())

    @property
    def winds_m_s(self) -> NDArray[np.float64]:
        """The (n, 2) winds, where the air goes [m/s]; NaN for a robot that did not send any."""
        return np.array([report.wind_m_s or (np.nan, np.nan) for report in self.reports.values()], dtype=np.float64)

    @property
    def mean_wind_m_s(self) -> tuple[float, float]:
        """The mean of the winds that were reported; zero where none was."""
        winds = [report.wind_m_s for report in self.reports.values() if report.wind_m_s is not None]
        if not winds:
            return 0.0, 0.0
        x_m_s, y_m_s = np.mean(winds, axis=0)
        return float(x_m_s), float(y_m_s)

    def numbers_of(self, name: str) -> tuple[float, ...]:
        """Return the numbers of the method's own in a robot's report, without the round's."""
        return self.reports[name].numbers[_NUMBER + 1 :]


class Rounds:
    """Keeps a team in step: a robot that has read waits until the others have read too, and only then steps.

    Each sends its report when it has read, and again with every wait and with its step, so that a text may be lost.
    A robot that is silent for `timeout_s` counts as lost and is not waited for until it is heard again. Who hears that
    others are a round ahead has missed them: it steps at once and counts on from their number. All compute with the
    reports as they are heard, its own included, so those who have heard the same come to the same.

    Use `observe` with every observation, and in `decide`:

        now = self.rounds.complete(observation)
        if now is None:
            return self.rounds.wait(observation)
        ...
        return waypoint(observation, ..., outgoing=self.rounds.call())

    State: the round's number, the own report of it, since when it waits, what was heard, and who is lost.

    Held by:
        extensions/search/tests/unit/swarms/test_rounds.py
    """

    def __init__(
        self,
        briefing: Briefing,
        nose: Nose,
        vane: Vane | None,
        *,
        amount: Callable[[Measurement], float] = _ppm_of,
        timeout_s: float = 6.0,
        first_timeout_s: float = 15.0,
        wait_s: float = 0.2,
        n_calls: int = 2,
        window_s: float = math.inf,
    ) -> None:
        """Join the team on the first channel of a briefing.

        Args:
            briefing: The agent's briefing.
            amount: Gives the gas of a measurement, for the reports; by default its mixing ratio.
            timeout_s: How long a silent robot is waited for [s].
            first_timeout_s: The same in the first round, in which all take off [s].
            wait_s: How long a wait lasts before the report is sent again [s].
            n_calls: How often a report is sent at least.
            window_s: Over how long a robot that stays where it is averages what it reads [s].
        """
        self.team = Team(briefing)
        self.number = 1
        self.lost: set[str] = set()
        self._timeouts_s = (first_timeout_s, timeout_s)
        self._wait_s, self._n_calls = wait_s, n_calls
        self._amount = amount
        self._measure = StopAndMeasure((nose,), vane, window_s=window_s)
        self._received: dict[str, dict[int, Report]] = {name: {} for name in self.team.others}
        self._own: Report | None = None
        self._last: Report | None = None
        self._since_s = 0.0
        self._n_called = 0

    @property
    def index(self) -> int:
        """The robot's own place among the sorted names of all members: its slot."""
        return self.team.index

    @property
    def n_members(self) -> int:
        """Number of robots of the team at the start."""
        return len(self.team.members)

    def observe(self, observation: Observation) -> None:
        """Take note of an observation: readings, and what is heard."""
        self._measure.add(observation)
        for name, report in self.team.receive(observation):
            self.lost.discard(name)
            if report.numbers:
                self._received[name][int(report.numbers[_NUMBER])] = report

    def complete(
        self, observation: Observation, numbers: Sequence[float] = (), *, best: ReportedBest | None = None
    ) -> Round | None:
        """Return the round's reports once all that are not lost have reported; None as long as there is to wait.

        A round is returned once; the next call begins the next one with what the vehicle reads then.

        Args:
            numbers: Up to seven numbers of the method's own for the report.
            best: The best place that the robot knows of, for the report.
        """
        if self._own is None:
            measured = self._measure.measured()
            if measured is None:
                return None
            self._own = self._report(observation, measured, numbers, best)
            self._since_s, self._n_called = observation.time_s, 0
        missing = [name for name in self.team.others if name not in self.lost and not self._has_reported(name)]
        if missing:
            timeout_s = self._timeouts_s[0 if self.number == 1 else 1]
            if observation.time_s - self._since_s < timeout_s - 1e-9:
                return None
            self.lost.update(missing)
        elif self._n_called + 1 < self._n_calls and len(self.lost) < len(self.team.others):
            return None
        return self._close()

    def wait(self, observation: Observation) -> Command:
        """Return the command that waits for the others, and sends them the own report again."""
        return Command(tick=observation.tick, kind="hold", hold_s=self._wait_s, outgoing=self.call())

    def call(self) -> tuple[RadioMessage, ...]:
        """Return the own last report as it goes out with a command."""
        self._n_called += 1
        return () if self._last is None else self.team.call(self._last)

    def _has_reported(self, name: str) -> bool:
        return any(number >= self.number for number in self._received[name])

    def _report(
        self, observation: Observation, measured: Measurement, numbers: Sequence[float], best: ReportedBest | None
    ) -> Report:
        wind = measured.wind
        report = Report(
            time_s=observation.time_s,
            position_m=observation.position_world_m,
            amount=self._amount(measured),
            wind_m_s=None if wind is None else _blowing_m_s(wind.speed_m_s * wind.steadiness_frac, wind.upwind_rad),
            best=best,
            numbers=(float(self.number), *numbers),
        )
        self._last = round_to_sent_digits(report, self.team)
        return self._last

    def _close(self) -> Round:
        assert self._own is not None
        reports = {self.team.name: self._own}
        for name in self.team.others:
            received = {number: report for number, report in self._received[name].items() if number >= self.number}
            if received and name not in self.lost:
                reports[name] = received.get(self.number, received[max(received)])
        closed = Round(number=self.number, reports=dict(sorted(reports.items())))
        self.number = max(self.number + 1, *(max(received, default=0) for received in self._received.values()), 0)
        self._received = {
            name: {number: report for number, report in received.items() if number >= self.number}
            for name, received in self._received.items()
        }
        self._own = None
        return closed


def round_to_sent_digits(report: Report, team: Team) -> Report:
    """Return a report with the digits in which the others hear it; as it is where it cannot be sent.

    Where not everything fits, the best place goes before the wind: the others know of best places themselves.
    """
    for candidate in (report, replace(report, best=None)):
        text = None if team.channel is None else encode(candidate, max_bytes=team.channel.max_bytes)
        heard = None if text is None else parse(text)
        if heard is not None and (heard.wind_m_s is not None or candidate.wind_m_s is None or candidate.best is None):
            return heard
    return report


# The mean vector of a hold: speed times how well its directions agree.
def _blowing_m_s(speed_m_s: float, upwind_rad: float) -> tuple[float, float]:
    return -speed_m_s * elementary.cos(upwind_rad), -speed_m_s * elementary.sin(upwind_rad)
