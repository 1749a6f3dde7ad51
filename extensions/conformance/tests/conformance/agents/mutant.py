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


def with_command(**changes):
    """Return a decide method that changes some fields of the right command."""
    return lambda self, fields: {**RightAgent.decide(self, fields), **changes}


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
class never_exits(RightAgent):
    def end(self):
        threading.Event().wait()

    def lose(self):
        threading.Event().wait()


@mutant
class thread_left_over(RightAgent):
    def end(self):
        threading.Thread(target=threading.Event().wait).start()
        return 0


@mutant
class ignores_stream_end(RightAgent):
    def lose(self):
        threading.Event().wait()


@mutant
class exits_with_3(RightAgent):
    def end(self):
        return 3


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
class tick_plus_one(RightAgent):
    def reply(self, command):
        super().reply(command | {"tick": command["tick"] + 1})


@mutant
class tick_minus_one(RightAgent):
    def reply(self, command):
        super().reply(command | {"tick": command["tick"] - 1})


@mutant
class tick_counted(RightAgent):
    def reply(self, command):
        super().reply(command | {"tick": self.n_answers})


@mutant
class tick_float(RightAgent):
    def reply(self, command):
        super().reply(command | {"tick": float(command["tick"])})


@mutant
class tick_text(RightAgent):
    def reply(self, command):
        super().reply(command | {"tick": str(command["tick"])})


@mutant
class tick_32_bit(RightAgent):
    def reply(self, command):
        super().reply(command | {"tick": command["tick"] & 0xFFFF})


@mutant
class not_a_number(RightAgent):
    decide = with_command(position_world_m=[math.nan, 1.0, 1.0])


@mutant
class infinite(RightAgent):
    decide = with_command(hold_s=math.inf)


@mutant
class reason_is_a_number(RightAgent):
    decide = with_command(reason=5)


@mutant
class number_as_key(RightAgent):
    def reply(self, command):
        super().reply(command | {7: "seven"})


@mutant
class numbers_little_endian(RightAgent):
    """As of a hand-written packer on a common machine."""

    def decide(self, fields):
        command = super().decide(fields)
        command["position_world_m"] = [struct.unpack("<d", struct.pack(">d", v))[0] for v in (2.0, 3.5, 1.5)]
        return command


@mutant
class position_as_big_endian_array(RightAgent):
    def decide(self, fields):
        command = super().decide(fields)
        data = struct.pack(">3d", *command["position_world_m"])
        return command | {"position_world_m": {"dtype": "float64", "shape": [3], "data": data}}


@mutant
class not_msgpack(RightAgent):
    def reply(self, command):
        self.wire.send_bytes(b"\xc1 garbage")


@mutant
class key_twice(RightAgent):
    """As of a writer that joins pieces of text."""

    def reply(self, command):
        pairs = [("tick", command["tick"] - 1), *command.items()]
        text = ",".join(f"{json.dumps(key)}:{json.dumps(value)}" for key, value in pairs)
        is_json = isinstance(self.wire, Pipes) and self.wire.format == "json"
        self.wire.send_bytes(f"{{{text}}}".encode() if is_json else msgpack.Packer().pack_map_pairs(pairs))


@mutant
class without_length(RightAgent):
    def reply(self, command):
        self.wire.send_raw(msgpack.packb(command))


@mutant
class in_latin_1(RightAgent):
    def reply(self, command):
        self.wire.send_bytes(json.dumps(command | {"reason": "größe"}, ensure_ascii=False).encode("latin-1"))


@mutant
class a_list(RightAgent):
    def reply(self, command):
        self.wire.send_bytes(msgpack.packb([command["tick"], "waypoint", *command["position_world_m"]]))


@mutant
class prints(RightAgent):
    def reply(self, command):
        self.wire.send_raw(b"deciding for tick %d\n" % command["tick"])
        super().reply(command)


@mutant
class two_objects_on_a_line(RightAgent):
    def reply(self, command):
        self.wire.send_bytes((json.dumps(command) + json.dumps(command)).encode())


@mutant
class wrong_map(RightAgent):
    def reply(self, command):
        self.wire.send({"tick": command["tick"], "cmd": "goto", "target": command["position_world_m"]})


@mutant
class unknown_kind(RightAgent):
    decide = with_command(kind="goto")


@mutant
class claims_to_have_failed(RightAgent):
    decide = with_command(kind="failed")


@mutant
class waypoint_to_nowhere(RightAgent):
    decide = with_command(position_world_m=None)


@mutant
class huge(RightAgent):
    def reply(self, command):
        super().reply(command | {"map": bytes(8_000_000)})


@mutant
class other_contract(RightAgent):
    decide = with_command(contract="9.0")


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
    name, door, frame_format = sys.argv[1:4]
    sys.exit(MUTANTS[name](door, frame_format).fly())
