"""Observations that a person gets in tests."""

from built_messages import build_briefing, build_observation

from gslcosim.contract.messages import Bounds, Reading


def briefing(**changes):
    bounds = Bounds(min_m=(0.0, 0.0, 0.0), max_m=(6.0, 5.0, 3.0))
    return build_briefing(**{"mission": "Find the source.", "bounds": bounds, "time_limit_s": 20.0, **changes})


def observation(tick, **changes):
    return build_observation(tick, **{"position_world_m": (3.0, 2.0, 1.0), "awaiting_command": False, **changes})


def reading(value, *, sensor="nose", quantity="mixing_ratio", unit="ppm", **changes):
    values = value if isinstance(value, tuple) else (float(value),)
    return Reading(sensor=sensor, quantity=quantity, unit=unit, values=values, **changes)
