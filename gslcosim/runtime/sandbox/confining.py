"""From an agent or participant of a scenario to how its process is confined."""

import itertools
import os
from collections.abc import Sequence
from pathlib import Path

from gslcosim._kernel_cache import NUMBA_VARIABLE
from gslcosim.errors import UsageError
from gslcosim.runtime.agents.starting import resolved_command, start_command
from gslcosim.runtime.sandbox.cells import (
    SYSTEM,
    AgentCell,
    always_hidden,
    code_folders,
    lies_in_truth,
    own_folders,
    python_folders,
    truth_within,
)
from gslcosim.runtime.sandbox.choosing import Confined, sandbox_kind
from gslcosim.runtime.sandbox.launching import Confinement
from gslcosim.runtime.setup import Setup


def confinement_of(
    agent: Confined,
    command: Sequence[str],
    setup: Setup,
    *,
    directory: Path,
    private_dir: Path,
    sockets: Sequence[Path] = (),
    tcp_port: int | None = None,
) -> Confinement:
    """Return how the process of an agent or participant is confined.

    Args:
        agent: The agent or participant whose process it is.
        command: What starts it.
        setup: The run, none of which it sees.
        directory: The scenario's folder.
        private_dir: Where private folders may be made.
        sockets: The unix sockets of its door.
        tcp_port: The port of its door.

    Raises:
        UsageError: the sandbox that the scenario demands does not work here, the command names the truth, or it may
            write where others read code or where the run is.
    """
    kind = sandbox_kind(agent)
    if kind == "none":
        return Confinement(limits=agent.limits)
    scratch = private_dir / f"scratch-{agent.name}"
    scratch.mkdir(mode=0o700)
    own = own_folders(command, directory)
    granted = [(directory / Path(path).expanduser()).absolute() for path in agent.may_read]
    if told := next((folder for folder in own if folder not in granted and lies_in_truth(folder)), None):
        raise UsageError(
            f"{agent.place}.start: expected a command that names no file of a run, of results or of an "
            f"environment, which an agent in a sandbox does not see, was one in {told}. Move the program elsewhere, or "
            "name the folder in may_read."
        )
    of_python = python_folders()
    searched = {*own, *granted, directory}.difference(of_python)
    hidden = [*always_hidden(), *truth_within(searched), *_places_of(setup)]
    hidden = [path for path in hidden if path not in (*own, *granted)]
    is_python = Path(command[0]).name.startswith("python") and NUMBA_VARIABLE in os.environ
    kernels = Path(os.environ[NUMBA_VARIABLE]) if is_python else None
    writes = [(directory / Path(path).expanduser()).absolute() for path in agent.may_write]
    _check_writes(agent, writes, setup, directory)
    readable = [*own, *granted, *of_python, *map(Path, SYSTEM)]
    cell = AgentCell(
        directory=directory.absolute(),
        reads=_existing([*readable, *([kernels] if kernels is not None else [])]),
        hidden=_existing([*hidden, *(path.resolve() for path in hidden)]),
        writes=_existing(writes),
        sockets=tuple(sockets),
        tcp_port=tcp_port,
        kernels=kernels,
        scratch=scratch,
    )
    return Confinement(kind=kind, cell=cell, limits=agent.limits)


# Where code or runs are nothing may be written, nor around it; agents may share a folder within that of their programs.
def _check_writes(agent: Confined, writes: Sequence[Path], setup: Setup, directory: Path) -> None:
    closed = [*code_folders(), *always_hidden(), *_places_of(setup)]
    programs = _programs_of_others(agent, setup, directory)
    for given, folder in zip(agent.may_write, writes, strict=True):
        for place in dict.fromkeys((folder, folder.resolve())):
            within = (each for each in (*closed, *programs) if each.is_relative_to(place))
            around = (each for each in closed if place.is_relative_to(each))
            if (other := next(itertools.chain(within, around), None)) is not None:
                raise UsageError(
                    f"{agent.place}.may_write: expected a folder from which no other process reads code and which "
                    f"holds nothing of runs, was {given!r}, which is part of {other} or has it within. Name a folder "
                    "of its own."
                )


def _programs_of_others(agent: Confined, setup: Setup, directory: Path) -> list[Path]:
    scenario = setup.scenario
    commands = [start_command(each, directory) for each in scenario.agents if each.name != agent.name]
    commands += [
        resolved_command(each.start.command, directory) for each in scenario.participants if each.name != agent.name
    ]
    own = [folder for command in commands if command is not None for folder in own_folders(command, directory)]
    return [*own, *(folder.resolve() for folder in own)]


def _places_of(setup: Setup) -> list[Path]:
    run = setup.run_dir.path.absolute()
    return [run.parent, run, setup.environment_dir]


def _existing(paths: Sequence[Path]) -> tuple[Path, ...]:
    return tuple(path for path in dict.fromkeys(paths) if path.exists())
