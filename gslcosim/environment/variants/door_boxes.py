"""Box of a closed door; apart from `doors`, since checks of a scenario compute nothing."""

from gslcosim.environment.model import Box
from gslcosim.scenario.models.layouts import DoorSpec

DOOR_RGBA = (0.55, 0.36, 0.20, 1.0)


def door_box(door: DoorSpec) -> Box:
    """Return the box of a closed door."""
    return Box(name=door.name, kind="obstacle", min_m=door.min_m, max_m=door.max_m, rgba=DOOR_RGBA)
