"""A Python agent that flies or drives a fixed programme: every kind of command that its vehicle obeys."""

from gslcosim.agent_kit import (
    Agent,
    AttitudeSetpoint,
    Briefing,
    Command,
    DriveSetpoint,
    Observation,
    RateSetpoint,
    Waypoint,
    run,
)


def mission(x_m, y_m, z_m):
    """Through a place with a velocity, and on to rest."""
    return {
        "kind": "mission",
        "waypoints": (
            Waypoint(position_world_m=(x_m + 0.5, y_m, z_m), velocity_world_m_s=(0.3, 0.0, 0.0), after_s=1.5),
            Waypoint(position_world_m=(x_m + 0.8, y_m + 0.3, z_m), hold_s=0.2, yaw_rad=1.0),
        ),
    }


HOVER = {"kind": "attitude", "attitude": AttitudeSetpoint(pitch_rad=0.05, yaw_rad=0.3)}
TURN = {"kind": "rates", "rates": RateSetpoint(rates_body_rad_s=(0.0, 0.0, 0.5))}
CIRCLE = {"kind": "drive", "drive": DriveSetpoint(speed_m_s=0.3, yaw_rate_rad_s=0.6)}
ALONG = {"kind": "velocity", "velocity_world_m_s": (0.0, 0.3, 0.0), "faces_path": True}
LAND, TAKE_OFF, HOLD = {"kind": "land"}, {"kind": "take_off"}, {"kind": "hold", "yaw_rad": -0.5}

# For each vehicle what it begins at which tick; it repeats itself until the next.
PROGRAMMES = {
    "iris": {30: "mission", 65: HOVER, 70: TURN, 74: HOLD, 85: LAND, 110: TAKE_OFF},
    "crazyflie": {30: ALONG, 40: HOVER, 46: "mission", 80: LAND, 105: TAKE_OFF},
    "holonomic": {30: ALONG, 40: "mission", 80: LAND, 105: TAKE_OFF},
    "rover": {2: "mission", 60: CIRCLE, 90: ALONG, 110: HOLD},
}


class EveryCommand(Agent):
    def __init__(self, briefing: Briefing) -> None:
        self.programme = dict(PROGRAMMES[briefing.agent])
        self.fields = {"kind": "noop"}

    def decide(self, observation: Observation) -> Command:
        begun = self.programme.pop(observation.tick, None)
        if begun is not None:
            self.fields = mission(*observation.position_world_m) if begun == "mission" else begun
        return Command(tick=observation.tick, **self.fields)


if __name__ == "__main__":
    run(EveryCommand)
