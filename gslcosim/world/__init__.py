"""World and physics: vehicles with control, flown in MuJoCo through the room and its wind; see `core.WorldCore`."""
