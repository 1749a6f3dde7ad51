"""A participant without any library that does one thing wrong: the arguments say what, and at which tick."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

FAULT, AT = sys.argv[1:]
MARKER = ""
if FAULT == "exits_once":
    AT, _, MARKER = AT.partition(":")


def streams():
    """Return what it reads and writes: its standard streams, or a connection."""
    kind, _, address = os.environ.get("GSLCOSIM_GATEWAY", "").partition(":")
    if not kind:
        return sys.stdin, sys.stdout
    if kind == "unix":
        connection = socket.socket(socket.AF_UNIX)
        connection.connect(address)
    else:
        host, _, port = address.rpartition(":")
        connection = socket.create_connection((host, int(port)))
    return connection.makefile("r"), connection.makefile("w")


input_stream, output_stream = streams()


def say(message):
    output_stream.write((message if isinstance(message, str) else json.dumps(message)) + "\n")
    output_stream.flush()


n_stepped = 0
hello = {"tick": 0, "reads": ["truth/samples"], "writes": ["state"]}
if FAULT == "wrong_reads":
    hello["reads"] = ["truth/bodies"]
if FAULT == "wrong_writes":
    hello["writes"] = ["state", "gas"]
if FAULT == "unknown_port":
    hello["reads"] = ["truth/everything"]
if FAULT == "other_contract":
    hello["contract"] = "2.0"
if FAULT == "no_share":
    hello["writes"] = ["state", "ventilation"]
if FAULT == "never_says_hello":
    sys.exit(4)
if FAULT == "once_only":
    os.close(os.open(AT, os.O_CREAT | os.O_EXCL))
if FAULT == "leaves":
    subprocess.Popen(["sleep", "600"], start_new_session=True, stdout=subprocess.DEVNULL)
if output_stream is not sys.stdout:
    say({"token": os.environ["GSLCOSIM_TOKEN"] if FAULT != "wrong_token" else "?"})
say(hello)
for line in input_stream:
    message = json.loads(line)
    if message["message"] == "Ending":
        break
    if message["message"] != "ParticipantInputs":
        if FAULT == "unasked":
            say({"tick": 0, "outputs": {"state": {}}})
        continue
    tick, inputs = message["tick"], message["inputs"]
    n_stepped += 1
    if FAULT == "needs_inputs":
        assert "truth/samples" in inputs
    if FAULT == "knows_all_fields":
        assert message.keys() == {"message", "tick", "time_s", "inputs"}
    outputs = {"state": {"n_samples": len(inputs.get("truth/samples", {}).get("samples", [])), "tick": tick}}
    answer = {"tick": tick, "outputs": outputs}
    if FAULT == "counts":
        outputs["state"]["n_stepped"] = n_stepped
    if FAULT == "random":
        outputs["state"]["chance"] = int.from_bytes(os.urandom(4))
    if FAULT == "real_tick":
        answer["tick"] = float(tick)
    if FAULT == "no_share":
        answer["outputs"] = {"state": {}, "ventilation": {}}
    if str(tick) == AT:
        if FAULT == "exits":
            sys.stderr.write("the model has blown up\n")
            sys.exit(7)
        if FAULT == "exits_once" and not Path(MARKER).exists():
            os.close(os.open(MARKER, os.O_CREAT))
            sys.exit(7)
        if FAULT == "is_killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if FAULT == "hangs":
            time.sleep(600)
        if FAULT == "closes":
            os.close(1)
            time.sleep(600)
        if FAULT == "garbage":
            answer = "hello world"
        if FAULT == "wrong_tick":
            answer["tick"] = tick - 1
        if FAULT == "other_output":
            answer["outputs"] = {"gas": {}}
        if FAULT == "nan":
            answer = f'{{"tick": {tick}, "outputs": {{"state": {{"level": NaN}}}}}}'
        if FAULT == "too_big":
            answer["outputs"]["state"]["text"] = "x" * 2_000_000
        if FAULT == "twice":
            say(answer)
        if FAULT == "memory":
            answer["outputs"]["state"]["n"] = len(bytearray(400_000_000) + bytes(1))
            time.sleep(5)
    say(answer)
else:
    if FAULT == "stays_behind":
        time.sleep(600)
if FAULT == "lingers":
    time.sleep(600)
if FAULT == "ends_badly":
    sys.exit(5)
if FAULT == "needs_a_step" and not n_stepped:
    sys.exit(6)
