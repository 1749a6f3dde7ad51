"""An agent on native Zenoh without the kit; needs the packages eclipse-zenoh and msgpack."""

import json
import math
import os
import queue

import msgpack
import zenoh

# 1. Where, as whom, and under which namespace.
text = os.environ["GSLCOSIM_JOIN"]
if not text.startswith("{"):
    with open(text, encoding="utf-8") as file:  # noqa: PTH123
        text = file.read()
join = json.loads(text)

# 2. A client of the run's router, which looks for nobody else.
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([join["endpoint"]]))
config.insert_json5("namespace", json.dumps(join["namespace"]))
config.insert_json5("transport/auth/usrpwd/user", json.dumps(join["user"]))
config.insert_json5("transport/auth/usrpwd/password", json.dumps(join["password"]))
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("scouting/gossip/enabled", "false")
if join.get("is_watched"):
    config.insert_json5("transport/link/tx/lease", "86400000")
session = zenoh.open(config)

# 3. Listen first, then say that you are there: nothing is sent to you before.
home = f"agents/{join['name']}"
inbox = queue.SimpleQueue()
held = [
    session.declare_subscriber(f"{home}/{kind}", lambda sample, kind=kind: inbox.put((kind, sample.payload.to_bytes())))
    for kind in ("briefing", "observation", "ending")
]
publisher = session.declare_publisher(
    f"{home}/command",
    encoding=zenoh.Encoding("application/msgpack;gslcosim.Command/1"),
    congestion_control=zenoh.CongestionControl.BLOCK,
    express=True,
)


# A link that is lost is the end as well.
def on_transport(event) -> None:  # noqa: ANN001
    """Note that the router is gone."""
    if event.kind == zenoh.SampleKind.DELETE:
        inbox.put(("lost", b""))


held.append(session.info.declare_transport_events_listener(on_transport))
held.append(session.liveliness().declare_token(f"{home}/alive"))

# 4. Answer each observation that awaits a command; one that comes again gets the same bytes again.
height_m, answered_tick, answer = 0.0, -1, b""
while True:
    kind, payload = inbox.get()
    if kind in ("ending", "lost"):
        break
    message = msgpack.unpackb(payload)
    if kind == "briefing":
        height_m = message["search_height_m"]
    elif message["awaiting_command"] and message["tick"] >= answered_tick:
        if message["tick"] > answered_tick:
            x_m, y_m, _ = message["position_world_m"]
            wind = next(reading for reading in message["readings"] if reading["sensor"] == "wind")
            _, upwind_rad = wind["values"]
            target = [x_m + 0.5 * math.cos(upwind_rad), y_m + 0.5 * math.sin(upwind_rad), height_m]
            answered_tick = message["tick"]
            answer = msgpack.packb({"tick": answered_tick, "kind": "waypoint", "position_world_m": target})
        publisher.put(answer)

# 5. Leave.
session.close()
