"""Every agent that ships keeps every rule, over every transport that it speaks."""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from deadlines import BUILD_S, PROCESS_S
from languages import of_every_language

from gslcosim_conformance import ConnectionSpec, SessionLimits, check_agent

ROOT = Path(__file__).parents[4]
FRAMED = ROOT / "tests" / "end_to_end" / "agents" / "framed.py"
LIMITS = SessionLimits(answer_s=300.0, exit_s=20.0)  # right agents answer and exit by themselves

# The first test of a language builds it.
pytestmark = [pytest.mark.slow, pytest.mark.end_to_end, pytest.mark.timeout(BUILD_S + PROCESS_S)]


# The other bundled methods are checked in test_methods.py.
PYTHON = {"dung_beetle": (sys.executable, str(ROOT / "agents" / "dung_beetle" / "agent.py"))}
WAYS = [(transport, frame_format) for transport in ("stdio", "tcp", "unix") for frame_format in ("msgpack", "json")]
N_AT_ONCE = 3


def python_wirings():
    """Yield the Python agents over Zenoh, and one over each transport and format of the gateway."""
    for name, command in PYTHON.items():
        yield name, ConnectionSpec(command=command)
    for transport, frame_format in WAYS:
        command = (sys.executable, str(FRAMED), "stdio" if transport == "stdio" else "socket", frame_format)
        yield f"{transport}-{frame_format}", ConnectionSpec(command=command, transport=transport, format=frame_format)


@pytest.fixture(scope="module")
def reports():
    """The reports of the Python agents, made several at a time: a check mostly waits."""
    with ThreadPoolExecutor(N_AT_ONCE) as pool:
        yield {name: pool.submit(check_agent, connection, LIMITS) for name, connection in python_wirings()}


@pytest.mark.parametrize("name", [name for name, _ in python_wirings()])
def test_a_python_agent_keeps_every_rule(name, reports):
    report = reports[name].result()
    assert report.has_passed, report.as_text()


@of_every_language()
@pytest.mark.debian
def test_an_agent_of_another_language_keeps_every_rule(agent):
    agent.build()
    connection = ConnectionSpec(
        command=tuple(agent.started_by()), transport=agent.door, format=agent.format, observations=agent.observations
    )
    report = check_agent(connection, LIMITS)
    assert report.has_passed, report.as_text()
