"""Questions at stops in a steady wind from -x, and the places that a reactive agent answers them with."""

import math

from briefings import briefing, observation

from gslcosim.agent_kit import Agent

WEST_RAD = math.pi  # the wind comes from -x
PID = (("pid", "nose"), ("anemometer", "vane"))
START_M = (7.0, 5.0, 2.0)


def made(agent_type: type[Agent], **changes) -> Agent:
    return agent_type(briefing(**{"sensors": PID, **changes}))


def at(tick, place_m=START_M, *, ppm=0.0, upwind_rad=WEST_RAD, speed_m_s=0.5, notice=None, status="holding"):
    readings = {"nose": ppm, "vane": (speed_m_s, upwind_rad)}
    return observation(tick=tick, position_m=place_m, readings=readings, notice=notice, status=status)


def flown(agent, amounts, place_m=START_M):
    """Places commanded at one question after the other, each of them reached."""
    places = []
    for i, ppm in enumerate(amounts):
        place_m = agent.decide(at(40 + 40 * i, place_m, ppm=ppm)).position_world_m
        places.append(place_m)
    return places
