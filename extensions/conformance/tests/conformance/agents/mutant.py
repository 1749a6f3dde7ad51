"""Agents that are right but for one thing: `mutant.py NAME stdio|zenoh msgpack|json`; the name `right` has no fault."""
# ruff: noqa: N801 - classes have the names that are given on the command line

import json
import math
import os
import queue
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import msgpack

LEG_M = 0.25


class Pipes:
    """Frames over standard input and output."""

    def __init__(self, frame_format):
        self.format = frame_format
        self.source, self.sink = sys.stdin.buffer, sys.stdout.buffer

    def messages(self) -> Iterator[dict]:
        while True:
            header = self.source.readline() if self.format == "json" else self.source.read(4)
            if not header:
                return
            yield (
                json.loads(header)
                if self.format == "json"
                else msgpack.unpackb(self.source.read(int.from_bytes(header, "big")))
            )

    def close(self):
        """Leave the pipes to the process's end."""

    def send(self, fields):
        self.send_bytes(json.dumps(fields).encode() if self.format == "json" else msgpack.packb(fields))

    def send_bytes(self, payload):
        self.send_raw(payload + b"\n" if self.format == "json" else len(payload).to_bytes(4, "big") + payload)

    def send_raw(self, data):
        self.sink.write(data)
        self.sink.flush()


class Session:
    """Messages over Zenoh."""

    def __init__(self):
        from gslcosim.bus.interface import JoinData
        from gslcosim.bus.zenoh_bus import ZenohBus

        self.join = JoinData.from_environment()
        self.events: queue.SimpleQueue = queue.SimpleQueue()
        self.bus = ZenohBus.open_member(self.adapted(self.join))
        self.bus.on_disconnect(lambda: self.events.put(("lost", b"")))
        self.declare()

    def adapted(self, join):
        return join

    def declare(self):
        self.subscribe()
        self.bus.declare_alive(f"agents/{self.join.name}/alive")

    def subscribe(self):
        for kind in ("briefing", "observation", "ending"):
            self.bus.subscribe(f"agents/{self.join.name}/{kind}", lambda key, payload: self.events.put((key, payload)))

    def messages(self) -> Iterator[dict]:
        while True:
            key, payload = self.events.get()
            if key == "lost":
                return
            name = {"briefing": "Briefing", "observation": "Observation", "ending": "Ending"}[key.rsplit("/", 1)[-1]]
            yield {"message": name, **msgpack.unpackb(payload)}

    def close(self):
        self.bus.close()

    def send(self, fields):
        self.send_bytes(msgpack.packb(fields))

    def send_bytes(self, payload):
        self.bus.publish(f"agents/{self.join.name}/command", payload, urgent=True)


class RightAgent:
    """Walks in small steps that depend on the seed and on what it smells, and breaks no rule."""

    session_type = Session

    def __init__(self, door, frame_format):
        self.prepare()
        self.wire = Pipes(frame_format) if door == "stdio" else self.session_type()
        self.state = None
        self.n_answers = 0
        self.seen = -1
        self.answer = None

    def prepare(self):
        """Nothing is in the way."""

    def fly(self):
        for fields in self.wire.messages():
            message = fields.pop("message")
            if message == "Ending":
                self.wire.close()
                return self.end()
            if message == "Briefing":
                self.brief(fields)
            else:
                self.observe(fields)
        self.wire.close()
        return self.lose()

    def brief(self, fields):
        if self.state is None:
            self.state = fields["seed"]

    def observe(self, fields):
        if not fields["awaiting_command"]:
            self.look(fields)
        elif fields["tick"] > self.seen:
            self.seen = fields["tick"]
            self.answer = self.decide(fields)
            self.reply(self.answer)
            self.n_answers += 1
        elif fields["tick"] == self.seen:
            self.reply_again(fields)

    def look(self, fields):
        """Remember nothing."""

    def reply(self, command):
        self.wire.send(command)

    def reply_again(self, fields):
        self.wire.send(self.answer)

    def decide(self, fields):
        heading_rad = 2 * math.pi * self.draw()
        x_m, y_m, z_m = fields["position_world_m"]
        goal_m = [x_m + LEG_M * math.cos(heading_rad), y_m + LEG_M * math.sin(heading_rad), z_m]
        return {"tick": fields["tick"], "kind": "waypoint", "position_world_m": goal_m}

    def draw(self):
        self.state = (self.state * 1103515245 + 12345) % 2**31
        return self.state / 2**31

    def end(self):
        return 0

    def lose(self):
        return 0


MUTANTS = {"right": RightAgent}


def mutant(agent_type):
    """Register a mutant by its class's name."""
    MUTANTS[agent_type.__name__] = agent_type
    return agent_type


# Fields that are wrong in each command.
WRONG_FIELDS = {
    "not_a_number": {"position_world_m": [math.nan, 1.0, 1.0]},
    "infinite": {"hold_s": math.inf},
    "reason_is_a_number": {"reason": 5},
    "unknown_kind": {"kind": "goto"},
    "claims_to_have_failed": {"kind": "failed"},
    "waypoint_to_nowhere": {"position_world_m": None},
    "other_contract": {"contract": "9.0"},
    "number_as_key": {7: "seven"},
    "huge": {"map": bytes(8_000_000)},
}
# Wrong ticks, of the right one and the number of answers before.
WRONG_TICKS = {
    "tick_plus_one": lambda tick, _: tick + 1,
    "tick_minus_one": lambda tick, _: tick - 1,
    "tick_counted": lambda _, n_answers: n_answers,
    "tick_float": lambda tick, _: float(tick),
    "tick_text": lambda tick, _: str(tick),
    "tick_32_bit": lambda tick, _: tick & 0xFFFF,
}
# Wrong positions of a command, of the right one; the first are those of a hand-written packer on a common machine.
WRONG_POSITIONS = {
    "numbers_little_endian": lambda _: [struct.unpack("<d", struct.pack(">d", v))[0] for v in (2.0, 3.5, 1.5)],
    "position_as_big_endian_array": lambda place: {
        "dtype": "float64",
        "shape": [3],
        "data": struct.pack(">3d", *place),
    },
}
# How a command is sent where that is not right.
WRONG_SENDING = {
    "not_msgpack": lambda wire, _: wire.send_bytes(b"\xc1 garbage"),
    "without_length": lambda wire, command: wire.send_raw(msgpack.packb(command)),
    "in_latin_1": lambda wire, command: wire.send_bytes(
        json.dumps(command | {"reason": "größe"}, ensure_ascii=False).encode("latin-1")
    ),
    "a_list": lambda wire, command: wire.send_bytes(
        msgpack.packb([command["tick"], "waypoint", *command["position_world_m"]])
    ),
    "two_objects_on_a_line": lambda wire, command: wire.send_bytes((json.dumps(command) * 2).encode()),
    "wrong_map": lambda wire, command: wire.send(
        {"tick": command["tick"], "cmd": "goto", "target": command["position_world_m"]}
    ),
}
WRONG_COMMANDS = {
    **{name: lambda _, command, f=fields: command | f for name, fields in WRONG_FIELDS.items()},
    **{
        name: lambda agent, command, f=tick_of: command | {"tick": f(command["tick"], agent.n_answers)}
        for name, tick_of in WRONG_TICKS.items()
    },
    **{
        name: lambda _, command, f=place_of: command | {"position_world_m": f(command["position_world_m"])}
        for name, place_of in WRONG_POSITIONS.items()
    },
}
# What it does at the message that ends a run, and where the transport ends without one.
WRONG_ENDS = {
    "never_exits": {"end": lambda _: threading.Event().wait(), "lose": lambda _: threading.Event().wait()},
    "thread_left_over": {"end": lambda _: threading.Thread(target=threading.Event().wait).start()},
    "ignores_stream_end": {"lose": lambda _: threading.Event().wait()},
    "exits_with_3": {"end": lambda _: 3},
}


def add_mutants():
    """Register the mutants of the tables."""
    methods = {
        **{name: {"reply": lambda agent, command, f=f: agent.wire.send(f(agent, command))}
           for name, f in WRONG_COMMANDS.items()},
        **{name: {"reply": lambda agent, command, f=f: f(agent.wire, command)} for name, f in WRONG_SENDING.items()},
        **WRONG_ENDS,
    }  # fmt: skip
    for name, own in methods.items():
        MUTANTS[name] = type(name, (RightAgent,), own)


# ---------------------------------------------------------------- start, time, end


@mutant
class crash_at_start(RightAgent):
    def prepare(self):
        raise RuntimeError("no licence found")


@mutant
class lock_file(RightAgent):
    def prepare(self):
        Path("running.lock").touch(exist_ok=False)


@mutant
class late(RightAgent):
    def decide(self, fields):
        time.sleep(15.0)
        return super().decide(fields)


@mutant
class silent(RightAgent):
    def reply(self, command):
        pass


@mutant
class unflushed(RightAgent):
    def prepare(self):
        self.sink = open(1, "wb", buffering=65536, closefd=False)  # noqa: SIM115 - never closed, that is its fault

    def reply(self, command):
        self.sink.write(json.dumps(command).encode() + b"\n")


@mutant
class crash_in_flight(RightAgent):
    def decide(self, fields):
        return super().decide(fields) | ({} if self.n_answers < 5 else {}["plume"])


@mutant
class leaves_early(RightAgent):
    def look(self, fields):
        if self.n_answers == 5:
            os._exit(0)


@mutant
class closes_output(RightAgent):
    def look(self, fields):
        if self.n_answers == 5:
            os.close(1)
            threading.Event().wait()


@mutant
class waits_for_a_question(RightAgent):
    def end(self):
        if self.n_answers == 0:
            threading.Event().wait()
        return 0


@mutant
class slow_starter(RightAgent):
    """Right, but it loads a large model first: longer than an agent has to exit."""

    def prepare(self):
        time.sleep(3.0)


@mutant
class leaves_a_daemon(RightAgent):
    def prepare(self):
        subprocess.Popen(["sleep", "1000"], start_new_session=True, stdin=-3, stdout=-3, stderr=-3)


@mutant
class leaves_a_nameless_daemon(RightAgent):
    """Forked twice, and without an environment that could tell whose it is."""

    def prepare(self):
        program = "import os; os.fork() or (os.setsid(), os.execve('/bin/sleep', ['sleep', '1000'], {}))"
        subprocess.run([sys.executable, "-c", program], check=True, stdin=-3, stdout=-3, stderr=-3)


@mutant
class waits_for_its_helper(RightAgent):
    """Right: what it starts has ended before it."""

    def end(self):
        return subprocess.run(["true"], start_new_session=True, check=True).returncode


# ---------------------------------------------------------------- what it sends


@mutant
class key_twice(RightAgent):
    """As of a writer that joins pieces of text."""

    def reply(self, command):
        pairs = [("tick", command["tick"] - 1), *command.items()]
        text = ",".join(f"{json.dumps(key)}:{json.dumps(value)}" for key, value in pairs)
        is_json = isinstance(self.wire, Pipes) and self.wire.format == "json"
        self.wire.send_bytes(f"{{{text}}}".encode() if is_json else msgpack.Packer().pack_map_pairs(pairs))


@mutant
class prints(RightAgent):
    def reply(self, command):
        self.wire.send_raw(b"deciding for tick %d\n" % command["tick"])
        super().reply(command)


@mutant
class twice(RightAgent):
    def reply(self, command):
        super().reply(command)
        super().reply(command)


@mutant
class unasked(RightAgent):
    def look(self, fields):
        self.wire.send(RightAgent.decide(self, fields))


@mutant
class floods(RightAgent):
    def reply(self, command):
        super().reply(command)
        for n in range(20_000):
            super().reply(command | {"tick": 10**6 + n})


@mutant
class believes_too_often(RightAgent):
    def decide(self, fields):
        even = struct.pack("<4f", 0.25, 0.25, 0.25, 0.25)
        probability = {"dtype": "float32", "shape": [2, 2], "data": even}
        return super().decide(fields) | {
            "belief": {"origin_m": [0.0, 0.0, 1.0], "cell_m": 1.0, "probability": probability}
        }


# ---------------------------------------------------------------- repeatability and evolution


@mutant
class unseeded(RightAgent):
    def draw(self):
        return int.from_bytes(os.urandom(4), "big") / 2**32


@mutant
class reads_the_clock(RightAgent):
    def draw(self):
        return int(time.time()) % 60 / 60


@mutant
class remembers_the_last_run(RightAgent):
    def draw(self):
        n_draws = len(Path("memory").read_text()) if Path("memory").exists() else 0
        Path("memory").write_text("." * (n_draws + 1))
        return n_draws % 11 / 11


@mutant
class stops_at_an_unknown_field(RightAgent):
    def observe(self, fields):
        unknown = fields.keys() - {
            "tick", "agent", "time_s", "position_world_m", "yaw_rad", "velocity_world_m_s", "status",
            "awaiting_command", "readings", "notice", "incoming", "radio_refusals",
        }  # fmt: skip
        if unknown:
            raise KeyError(f"unexpected {sorted(unknown)[0]}")
        super().observe(fields)


@mutant
class wants_its_own_minor_version(RightAgent):
    def brief(self, fields):
        if fields["contract_version"].endswith("99"):
            sys.exit("built for an older contract")
        super().brief(fields)


@mutant
class needs_optional_fields(RightAgent):
    def decide(self, fields):
        return RightAgent.decide(self, fields) | {"reason": fields["notice"] or "going on"}


@mutant
class takes_absence_for_news(RightAgent):
    def draw(self):
        return super().draw() if self.has_notice else 0.5

    def decide(self, fields):
        self.has_notice = "notice" in fields
        return RightAgent.decide(self, fields)


# ---------------------------------------------------------------- over Zenoh only


class OtherKeySession(Session):
    def send_bytes(self, payload):
        self.bus.publish("agents/agent_2/command", payload, urgent=True)


@mutant
class answers_for_another(RightAgent):
    session_type = OtherKeySession


@mutant
class forges_truth(RightAgent):
    def reply(self, command):
        super().reply(command)
        self.wire.bus.publish("truth/bodies", b"forged")


@mutant
class spies(RightAgent):
    def brief(self, fields):
        super().brief(fields)
        self.wire.bus.subscribe("**", lambda key, payload: None)


@mutant
class asks_for_the_truth(RightAgent):
    def brief(self, fields):
        super().brief(fields)
        self.wire.bus.ask("truth/bodies", b"", lambda key, payload: None)


class NoNamespaceSession(Session):
    def adapted(self, join):
        return join.model_copy(update={"namespace": "somewhere"})


@mutant
class forgets_the_namespace(RightAgent):
    session_type = NoNamespaceSession


class TokenFirstSession(Session):
    def declare(self):
        self.bus.declare_alive(f"agents/{self.join.name}/alive")
        time.sleep(0.3)
        self.subscribe()


@mutant
class token_first(RightAgent):
    session_type = TokenFirstSession


@mutant
class decides_anew(RightAgent):
    def reply_again(self, fields):
        self.wire.send(self.decide(fields))


@mutant
class silent_at_repeats(RightAgent):
    def reply_again(self, fields):
        pass


@mutant
class begins_anew_with_each_briefing(RightAgent):
    def brief(self, fields):
        self.state = fields["seed"]


@mutant
class hangs_up(RightAgent):
    def look(self, fields):
        if self.n_answers == 5:
            self.wire.bus.close()
            threading.Event().wait()


if __name__ == "__main__":
    add_mutants()
    name, door, frame_format = sys.argv[1:4]
    sys.exit(MUTANTS[name](door, frame_format).fly())
