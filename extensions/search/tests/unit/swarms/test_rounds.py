from collections import deque

import pytest
from briefings import observation, sensor
from built_messages import build_briefing

from gslcosim.contract.messages import ChannelDescription
from gslcosim_search.senses.instruments import find_noses, find_vanes
from gslcosim_search.swarms.rounds import Rounds

NAMES = ("ada", "bob", "cyd")
SENSORS = (sensor("pid", "nose"), sensor("anemometer", "vane"))


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


def test_slots_follow_the_sorted_names():
    assert [rounds_of(name, members=("cyd", "ada", "bob")).index for name in NAMES] == [0, 1, 2]
    assert rounds_of("ada").n_members == 3
