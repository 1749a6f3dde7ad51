"""The page of building blocks, made from the docstrings of `gslcosim.search`: `make docs` writes docs/search.md."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

SEARCH = Path(__file__).resolve().parents[1] / "search"

_HEAD = """# Building blocks of search methods

<!-- Made by `make docs` from the docstrings of gslcosim/search; do not edit. -->

`gslcosim.search` is what the bundled methods are made of, for methods of your own: pure functions and small states, seeded, without the truth.
Each docstring has the equation with its units, the source, and the test that holds it: `help(gslcosim.search.ground.hits)` in Python.
[methods.md](methods.md) shows which method does what with them; [write-an-agent.md](write-an-agent.md) is the way from a block to a flying agent.

```python
from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.ground.draws import Draws
from gslcosim.search.ground.flying import waypoint
from gslcosim.search.ground.instruments import noses_of
from gslcosim.search.ground.legs import Room, free_heading


class Wanderer(Agent):
    \"\"\"Flies short legs where there is gas and long ones where there is none.\"\"\"

    def __init__(self, briefing: Briefing) -> None:
        self.nose = noses_of(briefing)[0]
        self.room = Room.of(briefing, 0.5)
        self.draws = Draws(briefing.seed)

    def decide(self, observation: Observation) -> Command:
        leg_m = 0.3 if self.nose.ppm(observation) > 1.0 else 1.5
        heading_rad = self.draws.angle_rad()
        leg = free_heading(observation.position_world_m, self.room, self.draws, leg_m=leg_m)
        return waypoint(observation, *leg.end_m)


if __name__ == "__main__":
    run(Wanderer)
```
"""


def blocks_markdown() -> str:
    """Return the whole page: a section for each room, a table for each module."""
    rooms = [room for room in sorted(SEARCH.iterdir()) if (room / "__init__.py").is_file()]
    return "\n".join([_HEAD, *(_section(room) for room in rooms)])


def _section(room: Path) -> str:
    parts = [f"## {room.name}\n", f"{_docstring(room / '__init__.py')}\n"]
    for module in sorted(room.glob("*.py")):
        if module.name != "__init__.py" and not module.stem.endswith("_kernels"):
            parts.append(_table(module))
    return "\n".join(parts)


def _table(module: Path) -> str:
    name = ".".join(module.relative_to(SEARCH.parents[1]).with_suffix("").parts)
    rows = [f"| `{block}` | {text} |" for block, text in _blocks(module)]
    lines = [f"### {name}\n", f"{_first_sentence(_docstring(module))}\n"]
    return "\n".join([*lines, "| name | |", "|---|---|", *rows, ""] if rows else lines)


def _blocks(module: Path) -> Iterator[tuple[str, str]]:
    for node in ast.parse(module.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node.name, _first_sentence(ast.get_docstring(node) or "").replace("|", "\\|")


def _docstring(module: Path) -> str:
    return ast.get_docstring(ast.parse(module.read_text(encoding="utf-8"))) or ""


def _first_sentence(text: str) -> str:
    return " ".join(text.partition("\n\n")[0].split())


if __name__ == "__main__":
    sys.stdout.write(blocks_markdown())
