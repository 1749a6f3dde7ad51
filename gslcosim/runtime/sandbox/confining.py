"""From an agent or participant of a scenario to how its process is confined."""

import itertools
import os
import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path

from gslcosim._kernel_cache import NUMBA_VARIABLE
from gslcosim.errors import UsageError
from gslcosim.runtime.agents.starting import resolved_command, start_command
from gslcosim.runtime.sandbox.cells import (
    SYSTEM,
    AgentCell,
    always_hidden,
    code_folders,
    own_folders,
    python_folders,
)
from gslcosim.runtime.sandbox.choosing import Confined, sandbox_kind
from gslcosim.runtime.sandbox.environment import environment_for
from gslcosim.runtime.sandbox.launching import Confinement
from gslcosim.runtime.sandbox.truth import MAX_BYTES, MAX_ENTRIES, TooMuchToSearchError, lies_in_truth, truth_within
from gslcosim.runtime.setup import Setup
from gslcosim.scenario.sources import source_files


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
    environment = environment_for(agent, command)
    if kind == "none":
        return Confinement(limits=agent.limits, environment=environment)
    scratch = private_dir / f"scratch-{agent.name}"
    scratch.mkdir(mode=0o700)
    own = own_folders(command, directory)
    granted = [(directory / Path(path).expanduser()).absolute() for path in agent.may_read]
    sources = [*setup.sources, *source_files(setup.scenario, directory)]
    _check_program(agent, [folder for folder in own if folder not in granted], setup, sources)
    of_python = python_folders()
    searched = {*own, *granted}.difference(of_python)
    hidden = [*always_hidden(), *_truth_within(agent, searched, sources), *_places_of(setup), *sources]
    hidden = [path for path in hidden if path not in (*own, *granted)]
    is_python = Path(command[0]).name.startswith("python") and NUMBA_VARIABLE in os.environ
    kernels = Path(os.environ[NUMBA_VARIABLE]) if is_python else None
    writes = [(directory / Path(path).expanduser()).absolute() for path in agent.may_write]
    _check_writes(agent, writes, setup, directory)
    readable = [*own, *granted, *of_python, *map(Path, SYSTEM)]
    hidden += [path.resolve() for path in hidden]
    cell = AgentCell(
        directory=directory.absolute(),
        reads=_existing([*readable, *([kernels] if kernels is not None else [])]),
        hidden=_existing([*hidden, *_under_other_names(hidden, readable)]),
        writes=_existing(writes),
        sockets=tuple(sockets),
        tcp_port=tcp_port,
        kernels=kernels,
        scratch=scratch,
    )
    return Confinement(kind=kind, cell=cell, limits=agent.limits, environment=environment)


# What stands beside a program is seen by it.
def _check_program(agent: Confined, own: Sequence[Path], setup: Setup, sources: Sequence[Path]) -> None:
    runs, temporary = setup.run_dir.path.absolute().parent, Path(tempfile.gettempdir())
    for folder in own:
        place = folder.resolve()
        if lies_in_truth(folder) or any(place.is_relative_to(each.resolve()) for each in sources):
            raise UsageError(
                f"{agent.place}.start: expected a command that names no file of a run, of results or of an "
                f"environment, which an agent in a sandbox does not see, was one in {folder}. Move the program "
                "elsewhere, or name the folder in may_read."
            )
        if place == runs.resolve() or temporary.resolve().is_relative_to(place):
            what = "runs are made" if place == runs.resolve() else "other processes keep their temporary files"
            raise UsageError(
                f"{agent.place}.start: expected a program in a folder of its own, which the agent in a sandbox sees "
                f"with all that comes to lie there, was one in {folder}, where {what}. Move the program, or name "
                "the folder in may_read."
            )


def _truth_within(agent: Confined, searched: Collection[Path], sources: Collection[Path]) -> list[Path]:
    try:
        return truth_within(searched, sources)
    except TooMuchToSearchError as error:
        raise UsageError(
            f"{agent.place}: expected at most {MAX_ENTRIES} files of {MAX_BYTES >> 20} MB in folders that the agent "
            f"reads, which are searched for scenarios and runs that it must not see, was more in {error.folder}. Move "
            "the program into a folder of its own, or name smaller folders in may_read."
        ) from error


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


# Where a folder is read by way of a link, what is hidden in it has that name too.
def _under_other_names(hidden: Sequence[Path], readable: Sequence[Path]) -> list[Path]:
    return [
        folder / path.relative_to(folder.resolve())
        for folder in readable
        if folder.resolve() != folder
        for path in hidden
        if path.is_relative_to(folder.resolve())
    ]


def _existing(paths: Sequence[Path]) -> tuple[Path, ...]:
    return tuple(path for path in dict.fromkeys(paths) if path.exists())
