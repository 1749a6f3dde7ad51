"""Observations that a person gets in tests."""

from gslcosim.contract.messages import CONTRACT_VERSION, Bounds, Briefing, Observation, Reading


def briefing(**changes):
    fields = {
        "tick": 0, "agent": "beetle", "contract_version": CONTRACT_VERSION, "mission": "Find the source.",
        "tick_ns": 100_000_000, "seed": 1, "mode": "on_request", "latency_ticks": 1, "gas": "ethanol",
        "bounds": Bounds(min_m=(0.0, 0.0, 0.0), max_m=(6.0, 5.0, 3.0)), "search_height_m": 1.0, "hold_s": 1.0,
        "time_limit_s": 20.0, "sensors": (),
    }  # fmt: skip
    return Briefing(**{**fields, **changes})


def observation(tick, **changes):
    fields = {
        "tick": tick, "agent": "beetle", "time_s": 0.1 * tick, "position_world_m": (3.0, 2.0, 1.0), "yaw_rad": 0.0,
        "velocity_world_m_s": (0.0, 0.0, 0.0), "status": "holding", "awaiting_command": False, "readings": (),
    }  # fmt: skip
    return Observation(**{**fields, **changes})


def reading(value, *, sensor="nose", quantity="mixing_ratio", unit="ppm", **changes):
    values = value if isinstance(value, tuple) else (float(value),)
    return Reading(sensor=sensor, quantity=quantity, unit=unit, values=values, **changes)
