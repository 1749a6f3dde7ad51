"""Leak alarm: sensors that stand, events against a background that drifts, and the place whose puffs fit best.

README.md beside this file has the rules, method.yaml the parameters.
"""

import math
from collections import deque

import numpy as np

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import declaration
from gslcosim.agent_kit.settings import load_settings
from gslcosim.contract.messages import Note
from gslcosim_search.fixed_sensors.events import DetectionSettings
from gslcosim_search.fixed_sensors.leak_monitor import LeakMonitor, LeakReport
from gslcosim_search.senses.instruments import find_noses, find_vane

_ROUNDING_S = 1e-6


class LeakAlarm(Agent):
    """Stands, averages all its sensors over a row of time, and declares each leak once it is over."""

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, __file__)
        self.noses = [nose for nose in find_noses(briefing) if nose.unit == "ppm" or nose.estimate is not None]
        self.vane = find_vane(briefing)
        self.height_m = briefing.search_height_m
        self.row_s = max(settings.row_s, briefing.tick_ns * 1e-9)
        self.check_every_s = settings.check_every_s
        self.places_m = {str(i): place_m for i, place_m in enumerate(np.reshape(settings.places_m, (-1, 3)))}
        self.detection = DetectionSettings(least_ppm=settings.least_ppm, gap_s=settings.gap_s)
        self.monitor: LeakMonitor | None = None
        self.row_began_s = 0.0
        self.samples: list[tuple[list[float], tuple[float, float]]] = []
        self.reports: deque[LeakReport] = deque()
        self.last_tick = -1

    def observe(self, observation: Observation) -> None:
        """Add an observation to the row under way; a tick counts once."""
        if observation.tick == self.last_tick:
            return
        self.last_tick = observation.tick
        if self.monitor is None:
            self.monitor = self.build_monitor(observation)
            self.row_began_s = observation.time_s
        if observation.time_s >= self.row_began_s + self.row_s - _ROUNDING_S:
            self.close_row(self.monitor)
            self.row_began_s = observation.time_s
        ppm = [nose.ppm(observation) if nose.is_ready(observation) else math.nan for nose in self.noses]
        wind_m_s = self.vane.wind_world_m_s(observation) if self.vane.is_ready(observation) else (math.nan, math.nan)
        self.samples.append((ppm, wind_m_s))

    def build_monitor(self, observation: Observation) -> LeakMonitor:
        """Return the monitor of sensors where they stand now."""
        cos, sin = math.cos(observation.yaw_rad), math.sin(observation.yaw_rad)
        world_from_body = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        mounts_m = np.array([nose.mount_body_m for nose in self.noses])
        return LeakMonitor(
            np.array(observation.position_world_m) + mounts_m @ world_from_body.T,
            source_height_m=self.height_m,
            period_s=self.row_s,
            places_m=self.places_m,
            check_every_s=self.check_every_s,
            settings=self.detection,
        )

    def close_row(self, monitor: LeakMonitor) -> None:
        """Hand the means of a row to the monitor; a row with a gap in a sensor has none of it."""
        ppm = np.array([sample[0] for sample in self.samples]).mean(axis=0)
        wind_m_s = np.array([sample[1] for sample in self.samples]).mean(axis=0)
        self.samples.clear()
        self.reports.extend(monitor.add(self.row_began_s, ppm.tolist(), wind_m_s.tolist()))

    def decide(self, observation: Observation) -> Command:
        """Return the declaration of a leak that is over, or stay."""
        self.observe(observation)
        if not self.reports:
            return Command(tick=observation.tick, kind="hold")
        report = self.reports.popleft()
        certainty = report.certainty
        command = declaration(observation, (*report.position_m, self.height_m), certainty.confidence)
        values = {"start_s": report.start_s, "end_s": report.end_s, "margin": certainty.margin}
        values |= {"rate_m3_s": report.rate_m3_s, "is_upper_bound": float(report.is_upper_bound)}
        known = {name: value for name, value in values.items() if math.isfinite(value)}
        return command.model_copy(update={"note": Note(mode="leak", values=known)})


if __name__ == "__main__":
    run(LeakAlarm)
