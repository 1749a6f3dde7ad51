"""Joining a run on another host as one of its agents."""

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

from gslcosim.base.command_lines import build_parent_death_prefix, build_python_command, describe_exit
from gslcosim.base.errors import SimulationFault, UsageError
from gslcosim.base.interruption import Interruption
from gslcosim.bus.interface import INHERITED_FILES, JOIN_VARIABLE
from gslcosim.runtime.agents.gateway_transport import GATEWAY_VARIABLE, TOKEN_VARIABLE
from gslcosim.runtime.agents.loader import find_python_agent
from gslcosim.runtime.network import JoinFile
from gslcosim.runtime.processes.children import check_program
from gslcosim.runtime.processes.sandbox.launcher_client import write_memory_file
from gslcosim.runtime.processes.short_environment import build_short_environment
from gslcosim.runtime.remote.run_server import ProgressHandler


def build_agent_command(words: Sequence[str], *, is_behind_gateway: bool) -> list[str]:
    """Return the command line of an agent: a bundled one by its name, a file of Python, or a command as it is.

    Args:
        words: What stands for the agent.
        is_behind_gateway: Whether it has to connect to the gateway by TCP itself.

    Raises:
        UsageError: there are no words, or it cannot be started.
    """
    if not words:
        raise UsageError("gslcosim join: expected a program after agent, found none. For example agent dung_beetle.")
    is_python = len(words) == 1 and (words[0].endswith(".py") or "/" not in words[0])
    if is_python:
        try:
            found = find_python_agent(words[0], Path.cwd())
        except UsageError:
            if words[0].endswith(".py"):
                raise
        else:
            if is_behind_gateway:
                raise UsageError(
                    f"agent: expected a command that connects to the gateway, was {words[0]!r}: Python agents attach "
                    "with start: {attach: true}, without door: tcp."
                )
            return build_python_command(str(found))
    check_program("agent", words, None)
    return list(words)


def join_as_agent(joined: JoinFile, command: Sequence[str], *, say: ProgressHandler) -> None:
    """Start an agent's program with its join data, and return when it has ended well; Ctrl-C ends it.

    It is not in a sandbox: this host has nothing of the run but what the agent may know. Its environment is the short
    one of all agents.

    Args:
        joined: The agent's join file.
        command: Its command line.
        say: Receives progress reports.

    Raises:
        SimulationFault: it has ended otherwise.
        KeyboardInterrupt: a signal has ended it.
    """
    variables = build_short_environment(command)
    keep: tuple[int, ...] = ()
    if (gateway := joined.gateway) is not None:
        variables |= {GATEWAY_VARIABLE: gateway.gateway, TOKEN_VARIABLE: gateway.token}
        variables |= {"GSLCOSIM_AGENT": ",".join(gateway.agents or [gateway.name])}
    elif joined.join is not None:
        text = joined.join.model_dump_json(exclude_none=True)
        inherited = write_memory_file(text) if INHERITED_FILES.is_dir() else None
        keep = () if inherited is None else (inherited,)
        variables |= {JOIN_VARIABLE: text if inherited is None else str(INHERITED_FILES / str(inherited))}
    process = subprocess.Popen([*build_parent_death_prefix(), *command], env=variables, pass_fds=keep)
    for descriptor in keep:
        os.close(descriptor)
    say(f"agent {joined.name}: started (process {process.pid})")
    with Interruption(process.terminate) as interruption:
        code = process.wait()
    if interruption.is_set():
        raise KeyboardInterrupt
    if code != 0:
        raise SimulationFault(f"agent {joined.name}: the program {describe_exit(code)}.")
    say(f"agent {joined.name}: has ended with the run")
