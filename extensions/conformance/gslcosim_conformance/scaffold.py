"""New agents and participants from templates, renamed."""

import re
import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from gslcosim.base.bundled import bundled_schemas
from gslcosim.base.errors import UsageError
from gslcosim.base.yaml_core import EDITOR_HEADER
from gslcosim.runtime.external.protocol import is_valid_name
from gslcosim_conformance.scripted_world import PARTICIPANT_NAME

TEMPLATES = Path(__file__).parent / "templates"
AGENT_TEMPLATES = TEMPLATES / "agents"
DESCRIPTION_FILE = "agent.yaml"
_NOT_COPIED = shutil.ignore_patterns("target", "node_modules", "__pycache__", "*.pyc", DESCRIPTION_FILE)
_NAME_PATTERN = re.compile(r"[a-z][a-z0-9_]{0,39}")
_README = """# {name}

A search method for gslcosim in {language}.
`{program}` is the whole method: {does}.
Change that, and run these commands from this folder:

```sh
{commands}
```
"""
PARTICIPANT_TEMPLATES = TEMPLATES / "participants"
ORIGINAL_PARTICIPANT = "air_conditioner"
SCENARIO_FILE = "ventilated_room.yaml"
PARTICIPANT_SUFFIXES = {"c": ".c", "python": ".py", "rust": ".rs"}


@dataclass(frozen=True, kw_only=True)
class CreatedAgent:
    """A new agent: where it is, and the commands that build, check and fly it from its folder."""

    folder: Path
    build: tuple[str, ...]
    start: tuple[str, ...]
    transport: str
    format: str
    observations: str

    @property
    def check_command(self) -> tuple[str, ...]:
        """The command line that checks it."""
        options = ["--door", self.transport] if self.transport != "zenoh" else []
        options += ["--format", self.format] if self.transport != "zenoh" else []
        options += ["--observations", self.observations] if self.observations != "all" else []
        return ("gslcosim", "agent", "check", *options, "--", *self.start)

    @property
    def fly_command(self) -> tuple[str, ...]:
        """The command line that flies it in a small room."""
        if self.transport == "zenoh":
            start = f"python: ./{self.start[-1]}"
        else:
            start = f"command: [{', '.join(self.start)}], door: {self.transport}, format: {self.format}"
            start += f", observations: {self.observations}" if self.observations != "all" else ""
        return ("gslcosim", "up", "tiny_room", "--set", f"agents[0].start={{{start}}}")

    @property
    def commands(self) -> tuple[tuple[str, ...], ...]:
        """The command lines that build, check and fly it, in that order."""
        return tuple(step for step in (self.build, self.check_command, self.fly_command) if step)

    def as_text(self) -> str:
        """Return where the agent is and the commands to run next."""
        steps = [("cd", str(self.folder)), *self.commands]
        return "\n".join([f"{self.folder} holds a working agent. Next:", *(f"  {shlex.join(step)}" for step in steps)])


def list_languages() -> dict[str, Path]:
    """Return the languages that have a template, with its folder; Python first."""
    found = {path.parent.name: path.parent for path in AGENT_TEMPLATES.glob(f"*/{DESCRIPTION_FILE}")}
    return dict(sorted(found.items(), key=lambda item: (item[0] != "python", item[0])))


def create_agent(language: str, name: str, folder: Path) -> CreatedAgent:
    """Write a new agent into a folder: a small program, its build files and a README."""
    known = list_languages()
    template = known.get(language.lower().replace("c++", "cpp"))
    if template is None:
        raise UsageError(f"agent new: expected one of the languages {', '.join(known)}, was {language!r}.")
    if _NAME_PATTERN.fullmatch(name) is None:
        raise UsageError(
            f"agent new: expected a name of lower-case letters, digits and _ that begins with a letter, was {name!r}."
        )
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"agent new: expected a folder that is new or empty, it has files.\nFolder: {folder}")
    shutil.copytree(template, folder, ignore=_NOT_COPIED, dirs_exist_ok=True)
    _rename(folder, name)
    fields: dict[str, Any] = yaml.safe_load((template / DESCRIPTION_FILE).read_text(encoding="utf-8"))
    created = CreatedAgent(
        folder=folder.absolute(),
        build=tuple(fields.get("build", ())),
        start=tuple(_find_python() if word == "python" else word for word in fields["start"]),
        transport=fields["door"],
        format=fields["format"],
        observations=fields.get("observations", "all"),
    )
    commands = "\n".join(shlex.join(step) for step in created.commands)
    readme = _README.format(
        name=name, commands=commands, **{key: fields[key] for key in ("language", "program", "does")}
    )
    (folder / "README.md").write_text(readme, encoding="utf-8")
    return created


# The agent's name, also in the names of types, and the permission to run scripts, which packages may lose.
def _rename(folder: Path, name: str) -> None:
    camel = "".join(part.capitalize() for part in name.split("_"))
    for path in folder.rglob("*"):
        if path.is_file():
            text = path.read_text(encoding="utf-8")
            path.write_text(re.sub(r"\bNAME\b", name, text).replace("Searcher", camel), encoding="utf-8")
            if text.startswith("#!"):
                path.chmod(0o755)


# A person's `python` need not be the one that has gslcosim.
def _find_python() -> str:
    return "python" if shutil.which("python") == sys.executable else sys.executable


def create_participant(language: str, name: str, folder: Path) -> str:
    """Write a new participant into a folder; return what to do next."""
    ending = PARTICIPANT_SUFFIXES.get(language.lower())
    if ending is None:
        raise UsageError(
            f"participant new: expected one of the languages {', '.join(PARTICIPANT_SUFFIXES)}, was {language!r}."
        )
    if not is_valid_name(name):
        raise UsageError(
            "participant new: expected a name of lower-case letters, digits and _ that begins with a letter, such as "
            f"{PARTICIPANT_NAME}, was {name!r}."
        )
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"participant new: expected a folder that is new or empty, it has files.\nFolder: {folder}")
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / f"{name}{ending}"
    shutil.copy(PARTICIPANT_TEMPLATES / f"{ORIGINAL_PARTICIPANT}{ending}", program)
    program.write_text(program.read_text().replace(ORIGINAL_PARTICIPANT, name))
    scenario = (PARTICIPANT_TEMPLATES / SCENARIO_FILE).read_text().replace(ORIGINAL_PARTICIPANT, name)
    is_python = ending == ".py"
    if is_python:
        scenario = scenario.replace(
            f"start: {{command: [./{name}]}}",
            f"start: {{command: [{sys.executable}, ./{program.name}], format: json}}",
        )
    # The schema of this installation: what it knows is what the scenario may say here.
    header = f"{EDITOR_HEADER}$schema={bundled_schemas()['scenario'].as_uri()}\n"
    (folder / SCENARIO_FILE).write_text(header + scenario)
    builds = {
        ".c": f"cc -O2 -ffp-contract=off -o {name} {name}.c -lm",
        ".rs": f"rustc --edition 2021 -O -o {name} {name}.rs",
    }
    check = f"--format json -- {sys.executable} ./{program.name}" if is_python else f"-- ./{name}"
    steps = [
        *([] if is_python else [builds[ending]]),
        f"gslcosim participant check {check}",
        f"gslcosim up {SCENARIO_FILE}",
    ]
    return "\n".join([f"{folder} holds a working participant. From that folder:", *(f"  {step}" for step in steps)])
