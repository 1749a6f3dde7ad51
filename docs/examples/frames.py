"""An agent behind the gateway, with msgpack frames over TCP or a unix socket; needs the package msgpack."""

import math
import os
import socket

import msgpack


def connect() -> socket.socket:
    """Return a connection to the gateway."""
    kind, _, address = os.environ["GSLCOSIM_GATEWAY"].partition(":")
    if kind == "unix":
        connection = socket.socket(socket.AF_UNIX)
        connection.connect(address)
        return connection
    host, _, port = address.rpartition(":")
    connection = socket.create_connection((host, int(port)))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def send(connection: socket.socket, fields: dict) -> None:
    """Send one frame: the length in 4 bytes, big-endian, and the map."""
    payload = msgpack.packb(fields)
    connection.sendall(len(payload).to_bytes(4, "big") + payload)


def receive(stream) -> dict:  # noqa: ANN001
    """Return the next map; at the end of the stream an ending of our own."""
    length = int.from_bytes(stream.read(4), "big")
    return msgpack.unpackb(stream.read(length)) if length else {"message": "Ending"}


connection = connect()
stream = connection.makefile("rb")
send(connection, {"token": os.environ["GSLCOSIM_TOKEN"]})
height_m = 0.0
while (message := receive(stream))["message"] != "Ending":
    if message["message"] == "Briefing":
        height_m = message["search_height_m"]
    elif message["awaiting_command"]:
        x_m, y_m, _ = message["position_world_m"]
        wind = next(reading for reading in message["readings"] if reading["sensor"] == "wind")
        _, upwind_rad = wind["values"]
        target = [x_m + 0.5 * math.cos(upwind_rad), y_m + 0.5 * math.sin(upwind_rad), height_m]
        send(connection, {"tick": message["tick"], "kind": "waypoint", "position_world_m": target})
