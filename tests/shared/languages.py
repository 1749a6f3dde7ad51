"""The agents in other languages as tests see them: what they need, how they are built, what they answer."""

import fcntl
import hashlib
import json
import os
import shutil
import subprocess
import threading
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO

import pytest
import yaml
from briefings import sensor
from built_messages import build_briefing, build_observation
from deadlines import BUILD_S, EVENT_S
from real_runs import ROOT

from gslcosim.contract import codec
from gslcosim.contract.messages import Bounds, Briefing, Command, Ending, Message, Observation, Reading
from gslcosim.gateway.frame_codec import Frame, FrameOrRefusal, Splitter, build_splitter, decode_payload, encode_message
from gslcosim_conformance.scaffold import list_languages

SERIES = json.loads((ROOT / "tests" / "golden" / "dung_beetle_commands.json").read_text())


@dataclass(frozen=True)
class LanguageAgent:
    """One `agents/*/agent.yaml`."""

    folder: Path
    door: str
    format: str
    build_command: tuple[str, ...]
    start_command: tuple[str, ...]
    needs: tuple[str, ...]
    libraries: tuple[str, ...]
    observations: str
    is_slow_to_build: bool
    methods: tuple[str, ...] = ()

    @property
    def build_folder(self) -> Path:
        base = os.environ.get("GSLCOSIM_CACHE") or (
            Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "gslcosim"
        )
        # One for each checkout: tests of two checkouts at the same time must not build into each other's. What takes
        # minutes to build is shared; its build tool locks it.
        own = "" if self.is_slow_to_build else f"-{hashlib.sha256(str(self.folder).encode()).hexdigest()[:8]}"
        return Path(base) / "agents" / f"{self.folder.name}{own}"

    @property
    def is_for_soak_only(self) -> bool:
        """Whether only `make soak` has the time to build it."""
        built = [Path(part) for part in self._filled(self.start_command) if str(self.build_folder) in part]
        return self.is_slow_to_build and not all(path.exists() for path in built)

    @property
    def lacks(self) -> str:
        """What this machine lacks to build and start the agent, in words; empty when nothing."""
        lacking = [name for name in self.needs if shutil.which(name) is None]
        if not lacking:
            lacking = [f"the library {name}" for name in self.libraries if not has_library(name)]
        return ", ".join(lacking)

    def build(self) -> None:
        """Build the agent, or skip the test when something is missing for it."""
        if self.lacks:
            pytest.skip(f"{self.folder.name} is not tested: this machine has no {self.lacks}")
        if not self.build_command:
            return
        if problem := build_once(self.folder, self.build_folder, self._filled(self.build_command)):
            pytest.fail(problem)

    def started_by(self, *methods: str) -> list[str]:
        """Return the command line that starts the agent from any folder, with a method where it has several."""
        program, *arguments = self._filled(self.start_command)
        return [self._placed(program) if "/" in program else program, *map(self._placed, arguments), *methods]

    def start_override(self, *methods: str) -> tuple[str, str]:
        """Return the arguments of `gslcosim up` that fly this agent instead of the scenario's."""
        command = json.dumps(self.started_by(*methods))
        options = f"door: {self.door}, format: {self.format}, observations: {self.observations}"
        return "--set", f"agents[0].start={{command: {command}, {options}}}"

    # Relative paths of agent.yaml start at its folder.
    def _placed(self, argument: str) -> str:
        return str(self.folder / argument) if (self.folder / argument).is_file() else argument

    def _filled(self, command: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(part.replace("{build}", str(self.build_folder)) for part in command)


def language_agents() -> list[LanguageAgent]:
    """Return the dung beetles of all languages."""
    return [agent for agent in _agents() if not agent.methods]


def ports() -> list[tuple[LanguageAgent, str]]:
    """Return the agents that fly methods of the Python ones in another language, with each method."""
    return [(agent, method) for agent in _agents() for method in agent.methods]


def stub_of(language: str) -> LanguageAgent:
    """Return what `gslcosim agent new` begins with in a language."""
    return _read(list_languages()[language] / "agent.yaml")


def _agents() -> list[LanguageAgent]:
    return [_read(path) for path in sorted((ROOT / "agents").glob("*/agent.yaml"))]


def of_every_language(agents: Iterable[LanguageAgent] | None = None) -> pytest.MarkDecorator:
    """Parametrise a test with agents, all by default; those that take minutes to build are for `make soak`."""
    return pytest.mark.parametrize(
        "agent",
        [
            pytest.param(agent, id=agent.folder.name, marks=[pytest.mark.soak] if agent.is_for_soak_only else [])
            for agent in language_agents()
            if agents is None or agent in agents
        ],
    )


def _read(path: Path) -> LanguageAgent:
    fields = yaml.safe_load(path.read_text())
    return LanguageAgent(
        folder=path.parent,
        door=fields["door"],
        format=fields["format"],
        build_command=tuple(fields.get("build") or ()),
        start_command=tuple(fields["start"]),
        needs=tuple(fields["needs"]),
        libraries=tuple(fields.get("libraries", ())),
        observations=fields.get("observations", "all"),
        is_slow_to_build=fields.get("slow_to_build", False),
        methods=tuple(fields.get("methods", ())),
    )


@cache
def has_library(name: str) -> bool:
    """Return whether pkg-config knows a library."""
    return subprocess.run(["pkg-config", "--exists", name], check=False).returncode == 0


@cache
def build_once(folder: Path, build_folder: Path, command: tuple[str, ...]) -> str:
    """Build an agent the first time it is asked for; return what went wrong, empty when nothing.

    Once in all processes of a test run: a second build would take away the program that the first one's test flies.
    """
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID", str(os.getpid()))
    build_folder.parent.mkdir(parents=True, exist_ok=True)
    with build_folder.with_name(f"{build_folder.name}.built").open("a+") as built:
        fcntl.flock(built, fcntl.LOCK_EX)
        built.seek(0)
        built_by, _, problem = built.read().partition("\n")
        if built_by != run:
            problem = build(folder, command)
            built.truncate(0)
            built.write(f"{run}\n{problem}")
    return problem


def build(folder: Path, command: tuple[str, ...]) -> str:
    """Build an agent; return what went wrong, empty when nothing."""
    outcome = subprocess.run(
        command,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=BUILD_S,
        check=False,
    )
    return f"{folder.name}: {' '.join(command)}\n{outcome.stdout}" if outcome.returncode else ""


def golden_briefing(seed: int) -> Briefing:
    """Return the briefing of the golden series."""
    return build_briefing(
        contract_version="1.0",
        seed=seed,
        bounds=Bounds(min_m=(0.0, 0.0, 0.0), max_m=(15.0, 9.0, 8.0)),
        search_height_m=2.0,
        hold_s=2.0,
        time_limit_s=300.0,
        sensors=(sensor("tgs2600", "nose"), sensor("anemometer", "wind")),
    )


def golden_observations(steps: list[dict]) -> Iterator[Observation]:
    """Yield the observations of one golden series, each awaiting a command."""
    for tick, step in enumerate(steps):
        yield build_observation(
            tick,
            position_world_m=tuple(step["position_m"]),
            readings=(
                Reading(sensor="nose", quantity="resistance", unit="ohm", values=(step["ohm"],)),
                Reading(sensor="wind", quantity="wind", unit="m/s, rad", values=(0.5, step["upwind_rad"])),
            ),
            notice=step["notice"],
        )


def answers(command: list[str], frame_format: str, messages: list[Message]) -> tuple[list[Command], int]:
    """Start an agent on pipes, play the messages, and return its commands and its exit code.

    As in a run, what comes after an observation that awaits a command is sent when the command has come: an agent
    that does not flush its output does not get by.
    """
    commands: list[Command] = []
    splitter = build_splitter(frame_format)
    agent = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
    limit = threading.Timer(EVENT_S, agent.kill)
    limit.start()
    with ExitStack() as on_exit:
        on_exit.callback(limit.cancel)
        on_exit.enter_context(agent)
        on_exit.enter_context(suppress(BrokenPipeError))
        for message in messages:
            agent.stdin.write(encode_message(frame_format, type(message).__name__, codec.encode(message)))
            if isinstance(message, Observation) and message.awaiting_command:
                commands += _next_commands(agent.stdout, splitter, frame_format)
        agent.stdin.close()
        assert not agent.stdout.read(), "more was sent than asked for"
    assert not splitter.rest(), splitter.rest()
    return commands, agent.returncode


# None when the agent has gone.
def _next_commands(stream: IO[bytes], splitter: Splitter, frame_format: str) -> list[Command]:
    items: list[FrameOrRefusal] = []
    while not items and (data := stream.read(65536)):
        items = splitter.feed(data)
    assert all(isinstance(item, Frame) for item in items), items
    return [codec.decode(Command, decode_payload(frame_format, item.payload)) for item in items]


def golden_session(seed_series: dict) -> list[Message]:
    """Return all messages of one golden series, from the briefing to the end."""
    steps = seed_series["steps"]
    return [
        golden_briefing(seed_series["seed"]),
        *golden_observations(steps),
        Ending(tick=len(steps), reason="time_limit"),
    ]
