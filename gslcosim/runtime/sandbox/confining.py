"""From an agent or participant of a scenario to how its process is confined."""

import os
from collections.abc import Sequence
from pathlib import Path

from gslcosim.errors import UsageError
from gslcosim.runtime.sandbox.cells import (
    NUMBA_VARIABLE,
    SYSTEM,
    AgentCell,
    always_hidden,
    is_bundled,
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
        UsageError: the sandbox that the scenario demands does not work here, or the command names the truth.
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
            f"agents.{agent.name}.start: expected a command that names no file of a run, of results or of an "
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
    if kernels is not None and is_bundled(command):
        # Ours may add to what is compiled; others could put there what services would run.
        kernels.mkdir(parents=True, exist_ok=True)
        writes.append(kernels)
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


def _places_of(setup: Setup) -> list[Path]:
    run = setup.run_dir.path.absolute()
    return [run.parent, run, setup.environment_dir]


def _existing(paths: Sequence[Path]) -> tuple[Path, ...]:
    return tuple(path for path in dict.fromkeys(paths) if path.exists())
