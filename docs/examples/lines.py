"""An agent behind the gateway, with JSON lines over standard input and output; needs nothing but Python."""

import json
import math
import sys

height_m = 0.0
for line in sys.stdin:
    message = json.loads(line)
    if message["message"] == "Ending":
        break
    if message["message"] == "Briefing":
        height_m = message["search_height_m"]
    elif message["awaiting_command"]:
        x_m, y_m, _ = message["position_world_m"]
        wind = next(reading for reading in message["readings"] if reading["sensor"] == "wind")
        _, upwind_rad = wind["values"]
        target = [x_m + 0.5 * math.cos(upwind_rad), y_m + 0.5 * math.sin(upwind_rad), height_m]
        command = {"tick": message["tick"], "kind": "waypoint", "position_world_m": target}
        sys.stdout.write(json.dumps(command) + "\n")
        sys.stdout.flush()
