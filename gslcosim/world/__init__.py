"""World and physics: vehicles with control, flown in MuJoCo through the room and its wind."""

from gslcosim.world.core import PHYSICS_STEP_MS, WorldCore

__all__ = ["PHYSICS_STEP_MS", "WorldCore"]
