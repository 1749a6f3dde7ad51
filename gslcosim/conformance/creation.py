"""New agents from templates: Python's own, and for other languages the dung beetle of that language, renamed."""

import json
import re
import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from gslcosim._kernel_cache import cache_root
from gslcosim.errors import UsageError
from gslcosim.scenario.bundled import bundled_agents

TEMPLATES = Path(__file__).parent / "templates"
ORIGINAL = "dung_beetle"
RULES_FILE = "RULES.md"
DESCRIPTION = "agent.yaml"
_NOT_COPIED = shutil.ignore_patterns("target", "node_modules", "build", "__pycache__", "*.pyc", ".*")
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


@dataclass(frozen=True, kw_only=True)
class Created:
    """A new agent: where it is, and the commands that build, check and fly it."""

    folder: Path
    build: tuple[str, ...]
    start: tuple[str, ...]
    door: str
    format: str
    observations: str

    @property
    def check_command(self) -> tuple[str, ...]:
        """The command line that checks it."""
        options = ["--door", self.door] if self.door != "zenoh" else []
        options += ["--format", self.format] if self.door != "zenoh" else []
        options += ["--observations", self.observations] if self.observations != "all" else []
        return ("gslcosim", "agent", "check", *options, "--", *self.start)

    @property
    def fly_command(self) -> tuple[str, ...]:
        """The command line that flies it in a small room."""
        ways = f"door: {self.door}, format: {self.format}, observations: {self.observations}"
        command = f"command: {json.dumps(self.start)}"
        return ("gslcosim", "up", "tiny_room", "--set", f"agents[0].start={{{command}, {ways}}}")

    def as_text(self) -> str:
        """Return what there is and what to do next."""
        steps = {"build": self.build, "check": self.check_command, "fly": self.fly_command}
        lines = [f"  {name:<6} {shlex.join(step)}" for name, step in steps.items() if step]
        return "\n".join([f"{self.folder} holds a working agent. From that folder:", *lines])


def languages() -> dict[str, Path]:
    """Return the languages that have a template, with its folder."""
    agents = next(iter(bundled_agents().values())).parents[1]
    found = {
        path.parent.name.removeprefix(f"{ORIGINAL}_"): path.parent
        for path in agents.glob(f"{ORIGINAL}_*/{DESCRIPTION}")
    }
    return {"python": TEMPLATES / "python", **dict(sorted(found.items()))}


def create_agent(language: str, name: str, folder: Path) -> Created:
    """Write a new agent into a folder.

    Raises:
        UsageError: there is no template for the language, the name cannot be one, or the folder is in use.
    """
    known = languages()
    template = known.get(language.lower().replace("c++", "cpp"))
    if template is None:
        raise UsageError(f"agent new: expected one of the languages {', '.join(known)}, was {language!r}.")
    if _NAME.fullmatch(name) is None:
        raise UsageError(
            f"agent new: expected a name of lower-case letters, digits and _ that begins with a letter, was {name!r}."
        )
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"agent new: expected a folder that is new or empty, it has files.\nFolder: {folder}")
    shutil.copytree(template, folder, ignore=_NOT_COPIED, dirs_exist_ok=True)
    _rename(folder, template.name, name)
    if template.name.startswith(ORIGINAL):
        shutil.copy(template.parent / ORIGINAL / "README.md", folder / RULES_FILE)
    return _described(folder.absolute(), name)


# Identifiers of the original in all their spellings, names of files and folders, and links out of the folder.
def _rename(folder: Path, original: str, name: str) -> None:
    camel = "".join(part.capitalize() for part in name.split("_"))
    if original == "python":
        names, texts = {"Searcher": camel}, {r"\bNAME\b": name, r"\bPATH\b": str(folder)}
    else:
        names = {
            original: name,
            ORIGINAL.replace("_", "-"): name.replace("_", "-"),
            ORIGINAL.replace("_", ""): name.replace("_", ""),
            "DungBeetle": camel,
        }
        texts = {
            rf"(\.\.|agents)/{ORIGINAL}/README\.md": RULES_FILE,
            rf"\[\.\./{ORIGINAL}\]": f"[{RULES_FILE}]",
            r"\n[^\n]*\]\(\.\./\.\./[^\n]*": "",
            # Cargo sorts its lock file by name, so it has to write it once.
            r" --locked,": "",
        }
    texts |= {re.escape(old): new for old, new in names.items()}
    for path in sorted(folder.rglob("*"), key=lambda path: len(path.parts), reverse=True):
        if path.is_file():
            path.write_text(_changed(path.read_text(encoding="utf-8"), texts), encoding="utf-8")
        path.rename(path.with_name(_changed(path.name, {re.escape(old): new for old, new in names.items()})))


def _changed(text: str, changes: dict[str, str]) -> str:
    for old, new in changes.items():
        text = re.sub(old, lambda _, new=new: new, text)
    return text


def _described(folder: Path, name: str) -> Created:
    fields: dict[str, Any] = yaml.safe_load((folder / DESCRIPTION).read_text(encoding="utf-8"))
    build_folder = str(cache_root() / "agents" / name)

    def filled(key: str) -> tuple[str, ...]:
        words = [str(word).replace("{build}", build_folder) for word in fields.get(key) or ()]
        words = [sys.executable if word == "python" else word for word in words]
        return tuple(str(folder / word) if (folder / word).is_file() else word for word in words)

    return Created(
        folder=folder,
        build=filled("build"),
        start=filled("start"),
        door=fields["door"],
        format=fields["format"],
        observations=fields.get("observations", "all"),
    )
