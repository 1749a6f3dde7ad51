"""Doors as bodies of the scene: an open one is still there, and touches nothing."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

from gslcosim.environment.doors import boxes_of_doors
from gslcosim.environment.model import Environment
from gslcosim.environment.room_in_time import RoomInTime
from gslcosim.world.physics.scene import Scene


class DoorGeoms:
    """Opens and closes the doors of a scene as the room says; there is nothing to do in a room without.

    State: none of its own. MuJoCo's model follows the room with each `show`.
    """

    def __init__(self, environment: Environment, scene: Scene, room: RoomInTime | None) -> None:
        """Show the doors as they are now."""
        self._model = scene.model
        self._room = room
        boxes = boxes_of_doors(environment) if room is not None else ()
        self._geoms = {box.name: int(scene.model.geom(box.name).id) for box in boxes}
        self.show()

    def show(self) -> None:
        """Let closed doors collide, and open ones not."""
        if self._room is None:
            return
        closed = self._room.situation.closed
        for name, i in self._geoms.items():
            # As all boxes of the room, by MuJoCo's default.
            self._model.geom_contype[i] = self._model.geom_conaffinity[i] = int(name in closed)
