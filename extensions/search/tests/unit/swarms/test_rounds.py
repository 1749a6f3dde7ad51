import math
from collections import deque

import pytest
from briefings import observation, sensor
from built_messages import build_briefing, build_observation

from gslcosim.agent_kit import Briefing, Observation, RadioReception
from gslcosim.contract.messages import ChannelDescription
from gslcosim_search.senses.instruments import find_noses, find_vanes
from gslcosim_search.swarms.rounds import Report, ReportedBest, Rounds, Team, encode, parse

NAMES = ("ada", "bob", "cyd")
SENSORS = (sensor("pid", "nose"), sensor("anemometer", "vane"))
FULL = Report(
    time_s=41.5,
    position_m=(7.23, 5.11, 2.0),
    amount=2.004e-5,
    wind_m_s=(0.52, -0.1),
    best=ReportedBest(position_m=(6.9, 5.0, 2.0), amount=2.104e-5),
)
# The longest that a room of less than 100 m asks for: all coordinates at the far end, wind against the axes.
LONGEST = Report(
    time_s=9999.9,
    position_m=(99.99, 99.99, 99.99),
    amount=1.234e-6,
    wind_m_s=(-9.99, -9.99),
    best=ReportedBest(position_m=(99.99, 99.99, 99.99), amount=1.234e-6),
)


def rounds_of(name: str, *, members=NAMES, **settings) -> Rounds:
    channel = ChannelDescription(name="radio", members=members, range_m=None, delay_ticks=1, max_bytes=64)
    agent_briefing = build_briefing(agent=name, sensors=SENSORS, channels=(channel,) if members else ())
    return Rounds(agent_briefing, find_noses(agent_briefing)[0], find_vanes(agent_briefing)[0], **settings)


class Station:
    """One robot that stands and is asked every 0.2 s; what the others say comes into its inbox."""

    def __init__(self, name: str, ppm: float, **settings) -> None:
        self.rounds, self.ppm, self.inbox, self.done = rounds_of(name, **settings), ppm, deque(), []
        self.name = name

    def ask(self, time_s: float):
        seen = observation(
            tick=round(time_s * 10), name=self.name, time_s=time_s, heard=tuple(self.inbox),
            readings={"nose": self.ppm, "vane": (0.5, 0.0)},
        )  # fmt: skip
        self.inbox.clear()
        self.rounds.observe(seen)
        now = self.rounds.complete(seen, (self.ppm + 1.0,))
        if now is not None:
            self.done.append((time_s, now))
        return self.rounds.call() if now is not None else self.rounds.wait(seen).outgoing


def play(stations, time_s: float, *, drops=lambda _sender, _listener, _time_s: False, begins=None):
    """Ask all of them every 0.2 s; who has not begun or is not there says nothing."""
    for step in range(1, round(time_s / 0.2) + 1):
        now_s = 0.2 * step
        said = {
            station.name: station.ask(now_s) for station in stations if now_s >= (begins or {}).get(station.name, 0.0)
        }
        for sender, messages in said.items():
            for station in stations:
                if station.name != sender and not drops(sender, station.name, now_s):
                    station.inbox.extend((sender, message.text) for message in messages)


def team(**settings):
    return [Station(name, float(i), **settings) for i, name in enumerate(NAMES)]


def test_all_step_with_the_same_reports():
    stations = team()
    play(stations, 1.0)
    first = [station.done[0][1] for station in stations]
    assert first[0] == first[1] == first[2]
    assert first[0].names == NAMES
    assert first[0].amounts == pytest.approx([0.0, 1.0, 2.0])
    assert first[0].numbers_of("cyd") == (3.0,)
    assert first[0].mean_wind_m_s == pytest.approx((-0.5, 0.0))


def test_the_first_wait_for_the_last():
    stations = team()
    play(stations, 5.0, begins={"cyd": 3.0})
    assert min(time_s for station in stations for time_s, _ in station.done) > 3.0
    assert all(station.done[0][1].names == NAMES for station in stations)


def test_who_stays_silent_is_waited_for_once_and_then_no_more():
    stations = team(timeout_s=2.0, first_timeout_s=4.0)
    play(stations, 12.0, begins={"cyd": 999.0})
    times = [time_s for time_s, _ in stations[0].done]
    assert times[0] == pytest.approx(4.2)
    assert times[1] - times[0] < 1.0
    assert stations[0].done[1][1].names == ("ada", "bob")
    assert stations[0].rounds.lost == {"cyd"}


def test_who_was_lost_takes_part_again_when_it_is_received_and_comes_into_step():
    stations = team(timeout_s=2.0, first_timeout_s=4.0)
    play(stations, 12.0, begins={"cyd": 8.0})
    last = [station.done[-1][1] for station in stations]
    assert last[0].names == NAMES
    assert {now.number for now in last} == {last[0].number}
    assert stations[0].rounds.lost == set()


def test_a_text_that_is_lost_is_sent_again_and_stops_no_robot():
    stations = team(timeout_s=2.0)
    # Nothing from bob is heard by ada at every second time.
    play(stations, 6.0, drops=lambda sender, listener, t: (sender, listener) == ("bob", "ada") and round(5 * t) % 2)
    assert len(stations[0].done) > 5
    assert all(now.names == NAMES for _, now in stations[0].done)


def test_one_that_is_deaf_does_not_hold_up_the_others_and_catches_up():
    stations = team(timeout_s=1.0)
    play(stations, 10.0, drops=lambda _sender, listener, t: listener == "ada" and t < 5.0)
    numbers = [station.rounds.number for station in stations]
    assert max(numbers) - min(numbers) <= 1
    assert min(numbers) > 5


def test_alone_a_robot_steps_at_once():
    alone = Station("ada", 1.0, members=())
    play([alone], 1.0)
    assert len(alone.done) == 5
    assert alone.done[0][1].names == ("ada",)


def briefing(*members: str, name: str = "one", max_bytes: int = 64, channels: int = 1) -> Briefing:
    channel = ChannelDescription(name="radio", members=members, range_m=None, delay_ticks=1, max_bytes=max_bytes)
    return build_briefing(agent=name, contract_version="1.1", channels=(channel,) * channels)


def with_incoming(*texts: tuple[str, str], time_s: float = 50.0, channel: str = "radio") -> Observation:
    incoming = tuple(RadioReception(sender=who, channel=channel, text=text, sent_tick=0) for who, text in texts)
    return build_observation(round(time_s * 10), agent="one", time_s=time_s, awaiting_command=False, incoming=incoming)


def report_text(time_s: float, amount: float = 1.0) -> str:
    text = encode(Report(time_s=time_s, position_m=(1.0, 2.0, 1.0), amount=amount), max_bytes=64)
    assert text is not None
    return text


def test_a_report_is_a_line_that_can_be_read():
    text = encode(Report(**{**vars(FULL), "numbers": (3.0, 0.25)}), max_bytes=80)
    assert text == "g 415 723 511 200 2004e-8 w52 -10 b690 500 200 2104e-8 n3 25e-2"


def test_a_report_comes_back_as_it_was_sent():
    text = encode(FULL, max_bytes=64)
    assert text is not None
    assert parse(text) == FULL


@pytest.mark.parametrize("amount", [0.0, 1.0, 9999.0, 12345.0, 1e-7, 123.4, -0.5, 1e12, 2.0e-5, 1000.0, 99_999.0])
def test_amounts_keep_four_digits_whatever_their_unit(amount):
    text = encode(Report(time_s=0.0, position_m=(0.0, 0.0, 0.0), amount=amount), max_bytes=64)
    assert text is not None
    report = parse(text)
    assert report is not None
    assert report.amount == pytest.approx(amount, rel=5.1e-4)


def test_a_report_with_wind_and_best_place_fits_64_bytes_in_rooms_below_100_metres():
    text = encode(LONGEST, max_bytes=63)
    assert text is not None
    assert parse(text) == Report(
        **{**vars(LONGEST), "amount": 1.23e-6, "best": ReportedBest(position_m=(99.99, 99.99, 99.99), amount=1.23e-6)}
    )


@pytest.mark.parametrize("max_bytes", range(20, 90))
def test_no_text_is_longer_than_the_channel_allows_and_what_is_left_is_right(max_bytes):
    report = Report(**{**vars(FULL), "numbers": (3.0, 0.25)})
    text = encode(report, max_bytes=max_bytes)
    if text is None:
        assert max_bytes < len("g 415 723 511 200 2e-5")
        return
    assert len(text.encode()) <= max_bytes
    got = parse(text)
    assert got is not None
    assert (got.time_s, got.position_m) == (report.time_s, report.position_m)
    assert got.amount == pytest.approx(report.amount, rel=5e-3)
    assert got.wind_m_s in (None, report.wind_m_s)
    assert got.numbers in ((), report.numbers)


def test_values_beyond_all_bounds_are_clipped_and_do_not_lengthen_the_text():
    wild = Report(time_s=-1.0, position_m=(1e9, -1e9, 0.0), amount=1e300, wind_m_s=(1e9, 0.0))
    text = encode(wild, max_bytes=64)
    assert text is not None
    report = parse(text)
    assert report is not None
    assert report.position_m == (9999.99, -9999.99, 0.0)
    assert report.time_s == 0.0
    assert math.isfinite(report.amount)


@pytest.mark.parametrize(
    "text",
    [
        "", "g", "hello", "1.0 2.0", "g 1 2 3 4", "g 1 2 3 4 nan", "g 1 2 3 4 inf", "g 1 2 3 4 1e999", "g -1 2 3 4 5",
        "g 1 2 3 4 5 w1", "g 1 2 3 4 5 b1 2 3", "g 1 2 3 4 5 n", "g 1 2 3 4 5 x", "g 1.5 2 3 4 5", "g 1 2 3 4 5 ",
        "g 1 2 3 4 5\n", "g 1 2 3 4 " + chr(0x665), "g 1 2 3 4 5 n" + "1 " * 500, "g " + "9" * 5000,
        '{"x": 1}', "g 1 2 3 4 5 b1 2 3 4 w1 2",
    ],
)  # fmt: skip
def test_anything_else_on_the_channel_is_no_report(text):
    assert parse(text) is None


def test_the_last_report_of_each_member_is_kept_with_its_age():
    team = Team(briefing("one", "two", "three"))
    assert team.others == ("three", "two")
    reports = team.receive(
        with_incoming(("two", report_text(40.0)), ("three", report_text(45.0)), ("two", report_text(48.0)), time_s=50.0)
    )
    assert [(name, report.time_s) for name, report in reports] == [("two", 40.0), ("three", 45.0), ("two", 48.0)]
    assert team.age_s("two", 50.0) == pytest.approx(2.0)
    assert list(team.recent(50.0, 3.0)) == ["two"]
    assert list(team.recent(50.0)) == ["three", "two"]
    assert team.recent(60.0, 3.0) == {}


def test_repeated_and_late_texts_change_nothing():
    team = Team(briefing("one", "two"))
    team.receive(with_incoming(("two", report_text(40.0, amount=3.0))))
    assert (
        team.receive(with_incoming(("two", report_text(40.0, amount=9.0)), ("two", report_text(39.0, amount=9.0))))
        == ()
    )
    assert team.reports["two"].amount == 3.0


def test_strangers_other_channels_itself_and_the_future_are_not_received():
    team = Team(briefing("one", "two"))
    assert (
        team.receive(with_incoming(("four", report_text(40.0)), ("one", report_text(40.0)), ("two", report_text(99.0))))
        == ()
    )
    assert team.receive(with_incoming(("two", report_text(40.0)), channel="other")) == ()
    assert team.reports == {}


def test_a_call_is_a_text_to_all_on_the_channel_and_two_teams_understand_each_other():
    (message,) = Team(briefing("one", "two")).call(FULL)
    assert (message.channel, message.to) == ("radio", "all")
    listener = Team(briefing("one", "two", name="two"))
    assert listener.receive(with_incoming(("one", message.text))) == (("one", FULL),)


def test_without_a_channel_a_robot_is_alone_and_says_nothing():
    team = Team(briefing(channels=0))
    assert (team.members, team.others, team.call(FULL)) == (("one",), (), ())
    assert team.receive(with_incoming(("two", report_text(40.0)))) == ()


def test_nothing_is_said_on_a_channel_that_is_too_narrow():
    assert Team(briefing("one", "two", max_bytes=10)).call(FULL) == ()


def test_members_number_themselves_alike():
    members = ("one", "two", "three")
    assert [Team(briefing(*members, name=name)).index for name in members] == [0, 2, 1]
