"""New participants from templates: the air conditioner of the page, under another name, with a scenario around it."""

import shutil
import sys
from pathlib import Path

from gslcosim.conformance.participants.scripted_inputs import NAME
from gslcosim.errors import UsageError
from gslcosim.runtime.foreign.hearing import is_name

TEMPLATES = Path(__file__).parents[1] / "templates" / "participants"
ORIGINAL = "air_conditioner"
SCENARIO = "ventilated_room.yaml"
_ENDINGS = {"c": ".c", "python": ".py", "rust": ".rs"}


def create_participant(language: str, name: str, folder: Path) -> str:
    """Write a new participant into a folder; return what to do next.

    Raises:
        UsageError: there is no template for the language, the name cannot be one, or the folder is in use.
    """
    ending = _ENDINGS.get(language.lower())
    if ending is None:
        raise UsageError(f"participant new: expected one of the languages {', '.join(_ENDINGS)}, was {language!r}.")
    if not is_name(name):
        raise UsageError(
            "participant new: expected a name of lower-case letters, digits and _ that begins with a letter, such as "
            f"{NAME}, was {name!r}."
        )
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"participant new: expected a folder that is new or empty, it has files.\nFolder: {folder}")
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / f"{name}{ending}"
    shutil.copy(TEMPLATES / f"{ORIGINAL}{ending}", program)
    program.write_text(program.read_text().replace(ORIGINAL, name))
    scenario = (TEMPLATES / SCENARIO).read_text().replace(ORIGINAL, name)
    is_python = ending == ".py"
    if is_python:
        scenario = scenario.replace(
            f"start: {{command: [./{name}]}}",
            f"start: {{command: [{sys.executable}, ./{program.name}], format: json}}",
        )
    (folder / SCENARIO).write_text(scenario)
    builds = {
        ".c": f"cc -O2 -ffp-contract=off -o {name} {name}.c -lm",
        ".rs": f"rustc --edition 2021 -O -o {name} {name}.rs",
    }
    check = f"--format json -- {sys.executable} ./{program.name}" if is_python else f"-- ./{name}"
    steps = [*([] if is_python else [builds[ending]]), f"gslcosim participant check {check}", f"gslcosim up {SCENARIO}"]
    return "\n".join([f"{folder} holds a working participant. From that folder:", *(f"  {step}" for step in steps)])
