"""Bundled search methods keep every rule of the conformance kit, with all that their cards need; all in `make soak`."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from some_methods import every_method

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import build_program_command
from gslcosim_conformance import ConnectionSpec, SessionLimits, check_agent

LIMITS = SessionLimits(answer_s=300.0, exit_s=20.0)  # first answers may compile, and right agents exit by themselves
# A check mostly waits: for processes to start, join and exit.
N_AT_ONCE = 4

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]


@pytest.fixture(scope="module")
def reports(request):
    """The reports of the methods that are to be tested, made several at a time."""
    names = [item.callspec.params["name"] for item in request.session.items if item.path == request.path]
    with ThreadPoolExecutor(N_AT_ONCE) as pool:
        yield {name: pool.submit(check_agent, wiring_of(name), LIMITS) for name in names}


def wiring_of(name):
    return ConnectionSpec(command=tuple(build_program_command(bundled_agents()[name])))


@every_method()
def test_a_method_keeps_every_rule(name, reports):
    report = reports[name].result()
    assert report.has_passed, report.as_text()
