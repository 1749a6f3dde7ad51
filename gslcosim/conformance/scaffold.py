"""New agents and participants from templates, renamed."""

import json
import re
import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from gslcosim.base.bundled import bundled_agents, bundled_schemas
from gslcosim.base.errors import UsageError
from gslcosim.base.kernel_cache import get_cache_root
from gslcosim.base.yaml_core import EDITOR_HEADER
from gslcosim.conformance.scripted_world import PARTICIPANT_NAME
from gslcosim.runtime.external.protocol import is_valid_name

TEMPLATES = Path(__file__).parent / "templates"
ORIGINAL_AGENT = "dung_beetle"
RULES_FILE = "RULES.md"
DESCRIPTION_FILE = "agent.yaml"
_NOT_COPIED = shutil.ignore_patterns("target", "node_modules", "build", "__pycache__", "*.pyc", ".*")
_NAME_PATTERN = re.compile(r"[a-z][a-z0-9_]{0,39}")


@dataclass(frozen=True, kw_only=True)
class CreatedAgent:
    """A new agent: where it is, and the commands that build, check and fly it."""

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
        options_text = f"door: {self.transport}, format: {self.format}, observations: {self.observations}"
        command = f"command: {json.dumps(self.start)}"
        return ("gslcosim", "up", "tiny_room", "--set", f"agents[0].start={{{command}, {options_text}}}")

    def as_text(self) -> str:
        """Return what there is and what to do next."""
        steps = {"build": self.build, "check": self.check_command, "fly": self.fly_command}
        lines = [f"  {name:<6} {shlex.join(step)}" for name, step in steps.items() if step]
        return "\n".join([f"{self.folder} holds a working agent. From that folder:", *lines])


def list_languages() -> dict[str, Path]:
    """Return the languages that have a template, with its folder."""
    agents = next(iter(bundled_agents().values())).parents[1]
    found = {
        path.parent.name.removeprefix(f"{ORIGINAL_AGENT}_"): path.parent
        for path in agents.glob(f"{ORIGINAL_AGENT}_*/{DESCRIPTION_FILE}")
    }
    return {"python": TEMPLATES / "python", **dict(sorted(found.items()))}


def create_agent(language: str, name: str, folder: Path) -> CreatedAgent:
    """Write a new agent into a folder.

    Raises:
        UsageError: there is no template for the language, the name cannot be one, or the folder is in use.
    """
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
    _rename(folder, template.name, name)
    if template.name.startswith(ORIGINAL_AGENT):
        shutil.copy(template.parent / ORIGINAL_AGENT / "README.md", folder / RULES_FILE)
    return _read_description(folder.absolute(), name)


# Identifiers of the original in all their spellings, names of files and folders, and links out of the folder.
def _rename(folder: Path, original: str, name: str) -> None:
    camel = "".join(part.capitalize() for part in name.split("_"))
    if original == "python":
        names, texts = {"Searcher": camel}, {r"\bNAME\b": name, r"\bPATH\b": str(folder)}
    else:
        names = {
            original: name,
            ORIGINAL_AGENT.replace("_", "-"): name.replace("_", "-"),
            ORIGINAL_AGENT.replace("_", ""): name.replace("_", ""),
            "DungBeetle": camel,
        }
        texts = {
            rf"(\.\.|agents)/{ORIGINAL_AGENT}/README\.md": RULES_FILE,
            rf"\[\.\./{ORIGINAL_AGENT}\]": f"[{RULES_FILE}]",
            r"\n[^\n]*\]\(\.\./\.\./[^\n]*": "",
            # Cargo sorts its lock file by name, so it has to write it once.
            r" --locked,": "",
        }
    texts |= {re.escape(old): new for old, new in names.items()}
    for path in sorted(folder.rglob("*"), key=lambda path: len(path.parts), reverse=True):
        if path.is_file():
            path.write_text(_replace_all(path.read_text(encoding="utf-8"), texts), encoding="utf-8")
        path.rename(path.with_name(_replace_all(path.name, {re.escape(old): new for old, new in names.items()})))


def _replace_all(text: str, changes: dict[str, str]) -> str:
    for old, new in changes.items():
        text = re.sub(old, lambda _, new=new: new, text)
    return text


def _read_description(folder: Path, name: str) -> CreatedAgent:
    fields: dict[str, Any] = yaml.safe_load((folder / DESCRIPTION_FILE).read_text(encoding="utf-8"))
    build_folder = str(get_cache_root() / "agents" / name)

    def filled(key: str) -> tuple[str, ...]:
        words = [str(word).replace("{build}", build_folder) for word in fields.get(key) or ()]
        words = [sys.executable if word == "python" else word for word in words]
        return tuple(str(folder / word) if (folder / word).is_file() else word for word in words)

    return CreatedAgent(
        folder=folder,
        build=filled("build"),
        start=filled("start"),
        transport=fields["door"],
        format=fields["format"],
        observations=fields.get("observations", "all"),
    )


PARTICIPANT_TEMPLATES = TEMPLATES / "participants"
ORIGINAL_PARTICIPANT = "air_conditioner"
SCENARIO_FILE = "ventilated_room.yaml"
PARTICIPANT_SUFFIXES = {"c": ".c", "python": ".py", "rust": ".rs"}


def create_participant(language: str, name: str, folder: Path) -> str:
    """Write a new participant into a folder; return what to do next.

    Raises:
        UsageError: there is no template for the language, the name cannot be one, or the folder is in use.
    """
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
