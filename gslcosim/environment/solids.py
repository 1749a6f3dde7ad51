"""The solid boxes of a room, as physics and rays meet them."""

from collections import Counter

from gslcosim.environment.model import Box, Environment
from gslcosim.errors import EnvironmentDataError


def solid_boxes(environment: Environment) -> list[Box]:
    """Return the boxes of a room; one without a floor of its own (an imported one, say) gets one to stand on.

    Raises:
        EnvironmentDataError: two boxes have one name.
    """
    boxes = list(environment.boxes)
    doubles = sorted(name for name, n in Counter(box.name for box in boxes).items() if n > 1)
    if doubles:
        raise EnvironmentDataError(f"environment {environment.name}: expected boxes of different names, was {doubles}.")
    if not any(box.kind == "floor" for box in boxes):
        (x0, y0, z0), (x1, y1, _) = environment.grid.origin_m, environment.grid.max_m
        boxes.append(Box(name="floor", kind="floor", min_m=(x0, y0, z0 - 0.2), max_m=(x1, y1, z0)))
    return boxes
