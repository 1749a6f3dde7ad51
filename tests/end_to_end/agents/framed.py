"""Flies the bundled dung beetle through the gateway: `framed.py stdio|socket msgpack|json [VERSION KEYS]`.

With a version it is an agent of that contract: it does not know KEYS, separated by commas, which are newer, and states
the version in its first command.
"""

import importlib.util
import json
import os
import socket
import struct
import sys
from pathlib import Path

import msgpack

from gslcosim.contract import codec
from gslcosim.contract.messages import Briefing, Observation

ROOT = Path(__file__).resolve().parents[3]


def open_streams(door, frame_format):
    """Return where frames are read and written, for a socket with the token already sent."""
    if door == "stdio":
        return sys.stdin.buffer, sys.stdout.buffer
    kind, _, address = os.environ["GSLCOSIM_GATEWAY"].partition(":")
    if kind == "unix":
        connection = socket.socket(socket.AF_UNIX)
        connection.connect(address)
    else:
        host, _, port = address.rpartition(":")
        connection = socket.create_connection((host, int(port)))
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    send(connection.makefile("wb"), frame_format, {"token": os.environ["GSLCOSIM_TOKEN"]})
    return connection.makefile("rb"), connection.makefile("wb")


def receive(stream, frame_format):
    """Return the next map, or nothing at the end."""
    if frame_format == "json":
        line = stream.readline()
        return json.loads(line) if line else None
    header = stream.read(4)
    return msgpack.unpackb(stream.read(struct.unpack(">I", header)[0])) if header else None


def send(stream, frame_format, fields):
    """Send a map as one frame."""
    if frame_format == "json":
        stream.write(json.dumps(fields).encode() + b"\n")
    else:
        payload = msgpack.packb(fields)
        stream.write(struct.pack(">I", len(payload)) + payload)
    stream.flush()


def load_beetle():
    """Return the class of the bundled dung beetle."""
    spec = importlib.util.spec_from_file_location("beetle", ROOT / "agents" / "dung_beetle" / "agent.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.DungBeetle


def message_of(message_type, fields):
    """Return a message from a frame's map, by way of its bytes as lists are not tuples."""
    return codec.decode(message_type, msgpack.packb(fields))


def main():
    """Fly until the ending, or the end of the stream."""
    door, frame_format, *past = sys.argv[1:]
    beetle_type = load_beetle()
    stream_in, stream_out = open_streams(door, frame_format)
    stated, unknown = ({"contract": past[0]}, past[1].split(",")) if past else ({}, ())
    agent = None
    while (fields := receive(stream_in, frame_format)) and fields["message"] != "Ending":
        fields = {key: value for key, value in fields.items() if key not in unknown}
        if fields["message"] == "Briefing":
            agent = beetle_type(message_of(Briefing, fields))
            continue
        observation = message_of(Observation, fields)
        agent.observe(observation)
        if observation.awaiting_command:
            send(stream_out, frame_format, agent.decide(observation).model_dump(exclude_none=True) | stated)
            stated = {}


if __name__ == "__main__":
    main()
