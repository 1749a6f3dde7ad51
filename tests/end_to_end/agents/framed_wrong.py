"""Does one of many wrong things through the gateway: `framed_wrong.py WHAT msgpack|json`, over standard streams."""

import os
import struct
import sys
import time

from framed import receive, send

WHAT, FORMAT = sys.argv[1:3]
IN, OUT = sys.stdin.buffer, sys.stdout.buffer


def questions():
    """Yield observations that await a command."""
    while (fields := receive(IN, FORMAT)) and fields["message"] != "Ending":
        if fields.get("awaiting_command"):
            yield fields


def hold(question, **more):
    """Answer in the right way."""
    send(OUT, FORMAT, {"tick": question["tick"], "kind": "hold", **more})


def write(data):
    """Send any bytes."""
    OUT.write(data)
    OUT.flush()


def framed(payload):
    """Send any payload within a frame."""
    write(payload + b"\n" if FORMAT == "json" else struct.pack(">I", len(payload)) + payload)


def endlessly(data):
    """Send the same for as long as somebody takes it, and then wait for the end of the run."""
    try:
        while True:
            write(data)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), OUT.fileno())
        while IN.read(65536):
            pass


def flood(question):
    """Answer, and then send for a second what nobody asked for, as fast as it is taken."""
    hold(question)
    stop_at, n_sent = time.monotonic() + 1.0, 0
    junk = b'{"kind":"noop"}\n' if FORMAT == "json" else b"\0\0\0\x0b\x81\xa4kind\xa4noop"
    while time.monotonic() < stop_at:
        write(junk * 1000)
        n_sent += 1000
    sys.stderr.write(f"sent {n_sent} messages in a second\n")
    sys.stderr.flush()


def crash():
    """End with an exception."""
    raise RuntimeError("lost my way")


DEEDS = {
    "hold": hold,
    "garbage": lambda question: framed(b"\xc1 not a message"),
    "not_utf8": lambda question: framed(b'{"reason": "\xff"}'),
    "debug_text": lambda question: (write(b"thinking about it\n"), hold(question)),
    "array": lambda question: send(OUT, FORMAT, [1, 2]),
    "float_tick": lambda question: send(OUT, FORMAT, {"tick": float(question["tick"]), "kind": "hold"}),
    "not_a_number": lambda question: hold(question, kind="waypoint", position_world_m=[float("nan"), 1.0, 1.0]),
    "other_agent": lambda question: hold(question, agent="somebody_else"),
    "huge": lambda question: framed(b" " * 100_000_000),
    "endless_line": lambda question: endlessly(b"x" * 65536),
    "little_endian": lambda question: endlessly(struct.pack("<I", 20) + bytes(20)),
    "half_frame": lambda question: (write(b"\0\0\0" if FORMAT == "msgpack" else b'{"tick'), sys.exit(0)),
    "closes_output": lambda question: (os.close(OUT.fileno()), IN.read()),
    "crashes": lambda question: crash(),
    "exits": lambda question: os._exit(7),
    "silent": lambda question: None,
    "flood": flood,
    "slow_reader": lambda question: (time.sleep(0.5), hold(question, hold_s=3.0)),
}

for asked in questions():
    DEEDS[WHAT](asked)
