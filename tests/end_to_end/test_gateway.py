"""Agents behind the gateway: the same digest over every transport, and every wrong byte attributed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import EVENT_S
from real_runs import AGENTS, TINY_ROOM, fly, fly_command, fly_here, start

from gslcosim.contract.messages import Briefing

ASKED_LESS = ("--set", "referee.stop.time_limit_s=8")
CONTRACT_1_2 = TINY_ROOM.parents[1] / "tests" / "golden" / "contract_1_2.json"
DOORS = [(door, form) for door in ("stdio", "tcp", "unix") for form in ("msgpack", "json")]


def through(door, frame_format, **more):
    """Return the override that flies the dung beetle through a transport of the gateway."""
    streams = "stdio" if door == "stdio" else "socket"
    return overriding([sys.executable, str(AGENTS / "framed.py"), streams, frame_format], door, frame_format, **more)


def overriding(command, door, frame_format, **more):
    fields = {"command": command, "door": door, "format": frame_format, **more}
    return "--set", f"agents[0].start={json.dumps(fields)}"


def wrong(what, frame_format):
    chosen = overriding([sys.executable, str(AGENTS / "framed_wrong.py"), what, frame_format], "stdio", frame_format)
    return (*chosen, "--set", "agents[0].answer_within_s=1") if what == "silent" else chosen


def digest_of(ended):
    assert ended.result.get("valid"), ended.errors
    assert ended.result["faults"] == []
    return ended.result["digest"]


@pytest.fixture(scope="module")
def digest_over_zenoh(tmp_path_factory):
    return digest_of(fly(TINY_ROOM, tmp_path_factory.mktemp("zenoh")))


@pytest.mark.parametrize(("door", "frame_format"), [DOORS[0], DOORS[5]])
def test_every_transport_gives_the_same_digest(tmp_path, digest_over_zenoh, door, frame_format):
    assert digest_of(fly(TINY_ROOM, tmp_path, *through(door, frame_format))) == digest_over_zenoh


@pytest.mark.parametrize(
    ("door", "frame_format"),
    [pytest.param(*each, marks=[] if each in DOORS[1:5:3] else [pytest.mark.soak]) for each in DOORS],
)
def test_processes_run_with_the_others_in_one_process(tmp_path, digest_over_zenoh, door, frame_format):
    ended = fly_here(TINY_ROOM, tmp_path, *through(door, frame_format))
    assert digest_of(ended) == digest_over_zenoh


def test_an_agent_of_contract_1_2_runs_as_one_of_today(tmp_path, digest_over_zenoh):
    """It does not know the briefing's task."""
    known = json.loads(CONTRACT_1_2.read_text())["schemas"]["Briefing"]["properties"]
    newer = [name for name in Briefing.__struct_fields__ if name not in known]
    assert newer == ["task"]
    command = [sys.executable, str(AGENTS / "framed.py"), "stdio", "json", "1.2", ",".join(newer)]
    assert digest_of(fly_here(TINY_ROOM, tmp_path, *overriding(command, "stdio", "json"))) == digest_over_zenoh


@pytest.mark.tour
def test_only_what_is_asked_gives_the_same_digest(tmp_path, digest_over_zenoh):
    """The beetle looks at nothing else."""
    asked = fly_here(TINY_ROOM, tmp_path, *through("stdio", "json", observations="asked"))
    assert digest_of(asked) == digest_over_zenoh


def test_a_temporary_directory_with_a_long_name_changes_nothing(tmp_path, monkeypatch, digest_over_zenoh):
    """Addresses of unix sockets are short: the router's, a transport's, and those of `agent check` and `doctor`."""
    long = tmp_path / ("l" * 100)
    long.mkdir()
    monkeypatch.setenv("TMPDIR", str(long))
    ended = fly_command(TINY_ROOM, tmp_path / "runs", *through("unix", "msgpack"))
    assert digest_of(ended) == digest_over_zenoh
    assert list(long.glob("gslcosim-*")) == []


@pytest.mark.parametrize(("mode", "flying"), [("lockstep", fly_here), ("{latency: 3}", fly)])
def test_parity_holds_in_every_mode(tmp_path, mode, flying):
    change = ("--set", f"agents[0].mode={mode}", *ASKED_LESS)
    gated = flying(TINY_ROOM, tmp_path / "gated", *change, *through("stdio", "msgpack"))
    in_python = fly_here(TINY_ROOM, tmp_path / "kit", *change)
    assert digest_of(in_python) == digest_of(gated)


@pytest.mark.parametrize(("door", "more"), [("tcp", ()), ("unix", ("--in-process",))])
def test_an_agent_may_attach_itself(tmp_path, digest_over_zenoh, door, more):
    """It finds address and token in its join file, which nobody else can read."""
    joins = tmp_path / "join"
    attach = f"agents[0].start={{attach: true, door: {door}, format: json}}"
    flight = start(TINY_ROOM, tmp_path / "runs", "--set", attach, f"--join-dir={joins}", *more)
    file = joins / "agents" / "beetle.json"
    flight.wait_for(file.exists)
    join = json.loads(file.read_text())
    assert file.stat().st_mode & 0o077 == 0
    assert (join["name"], join["format"]) == ("beetle", "json")
    environment = {**os.environ, "GSLCOSIM_GATEWAY": join["gateway"], "GSLCOSIM_TOKEN": join["token"]}
    agent = subprocess.Popen([sys.executable, AGENTS / "framed.py", "socket", "json"], env=environment)
    try:
        assert digest_of(flight.end()) == digest_over_zenoh
        assert agent.wait(timeout=EVENT_S) == 0
    finally:
        agent.kill()
        agent.wait()


@pytest.mark.parametrize(
    ("what", "frame_format", "expected"),
    [
        ("garbage", "msgpack", "expected a msgpack map"),
        ("garbage", "json", "expected a line in UTF-8"),
        ("not_utf8", "json", "expected a line in UTF-8"),
        ("debug_text", "json", "was 17 bytes starting 'thinking about it'"),
        ("array", "msgpack", "expected a msgpack map, was "),
        ("array", "json", "expected one JSON object a line, was 6 bytes starting '[1, 2]'"),
        ("float_tick", "json", "Command: tick: "),
        ("not_a_number", "json", "Command: position_world_m.0: "),
        ("not_a_number", "msgpack", "Command: position_world_m.0: "),
        ("other_agent", "json", "Command: agent: expected beetle, was 'somebody_else'"),
        ("huge", "msgpack", "expected at most 1048576 bytes, was 100000000"),
        ("huge", "json", "expected a line of at most 1048576 bytes"),
    ],
)
def test_a_wrong_agent_is_answered_and_the_run_goes_on(tmp_path, what, frame_format, expected):
    """The vehicle holds, the fault says what was expected, and the referee ends the run as always."""
    ended = fly_here(TINY_ROOM, tmp_path, *wrong(what, frame_format), *ASKED_LESS)
    assert ended.result["valid"] is True, ended.errors
    assert ended.result["end_reason"] == "time_limit"
    assert expected in ended.result["faults"][0]["text"]
    assert ended.result["faults"][0]["participant"] == "agent beetle"


USELESS = [
    ("endless_line", "json", "given up: expected a line of at most"),
    ("debug_text", "msgpack", "It is the text 'thin'"),
    ("little_endian", "msgpack", "As little-endian it is 20."),
    ("half_frame", "json", "ended with exit code 0 before the end of the run. Expected a line feed"),
    ("half_frame", "msgpack", "Expected whole frames"),
    ("closes_output", "json", "closed its output before the end of the run"),
    ("crashes", "json", "lost my way"),
    ("exits", "msgpack", "exit code 7"),
    ("silent", "json", "did not answer within 1 s"),
]


@pytest.mark.parametrize(("what", "frame_format", "expected"), USELESS)
def test_an_agent_that_is_no_use_fails_the_task(tmp_path, what, frame_format, expected):
    """What cannot be read on, and who is gone or silent, is agent_failed with the reason."""
    assert_agent_failed(fly_here(TINY_ROOM, tmp_path, *wrong(what, frame_format)), expected)


@pytest.mark.parametrize(("what", "frame_format", "expected"), [USELESS[6]])
def test_among_many_processes_it_fails_in_the_same_words(tmp_path, what, frame_format, expected):
    assert_agent_failed(fly(TINY_ROOM, tmp_path, *wrong(what, frame_format)), expected)


def assert_agent_failed(ended, expected):
    assert ended.result["valid"] is True, ended.errors
    assert ended.result["end_reason"] == "agent_failed"
    assert any(expected in fault["text"] for fault in ended.result["faults"]), ended.result["faults"]


def test_a_slow_reader_changes_nothing(tmp_path):
    """The world flies on to the next waypoint while the agent is still reading about the last leg."""
    ended = fly(TINY_ROOM, tmp_path, *wrong("slow_reader", "json"), *ASKED_LESS)
    assert ended.result["valid"] is True, ended.errors
    assert ended.result["end_reason"] == "time_limit"
    assert ended.result["faults"] == []


def test_an_agent_that_cannot_connect_is_reported_why(tmp_path):
    """A wrong token is said together with the end of the process."""
    script = (
        "import os, socket; k, _, a = os.environ['GSLCOSIM_GATEWAY'].partition(':'); s = socket.socket(socket.AF_UNIX);"
        's.connect(a); s.sendall(b\'{"token": "guessed"}\\n\'); s.recv(1)'
    )
    ended = fly_here(TINY_ROOM, tmp_path, *overriding([sys.executable, "-c", script], "unix", "json"))
    assert ended.result["end_reason"] == "agent_failed", ended.errors
    assert "expected a first frame with the token of GSLCOSIM_TOKEN" in ended.result["faults"][0]["text"]


def test_nothing_of_the_run_is_handed_to_an_agent(tmp_path):
    """Neither the bus's password nor a place in another run."""
    script = "import os, sys; sys.stderr.write(str([key for key in os.environ if key.startswith('GSLCOSIM_')]))"
    ended = fly(TINY_ROOM, tmp_path, *overriding([sys.executable, "-c", script], "stdio", "json"))
    log = next((ended.run_dir / "logs").glob("agent_*.log")).read_text()
    assert "GSLCOSIM_AGENT" in log
    assert "GSLCOSIM_JOIN" not in log


def test_the_agents_process_ends_with_the_run(tmp_path):
    """Even one that neither reads the ending nor leaves."""
    flight = start(TINY_ROOM, tmp_path, *wrong("silent", "json"), "--in-process")
    pid = flight.child("framed_wrong.py")
    flight.end()
    assert not Path(f"/proc/{pid}").exists()
