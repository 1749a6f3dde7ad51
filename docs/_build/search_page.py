"""Page of search building blocks, made from the docstrings of `gslcosim.search`: `make docs` writes docs/search.md."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import gslcosim.search

SEARCH = Path(gslcosim.search.__file__).parent
# A program in the repository that the page shows.
EXAMPLE = Path("docs") / "examples" / "wanderer.py"

_HEAD = (
    "# Building blocks of search methods\n\n"
    "<!-- Made by `make docs` from the docstrings of gslcosim/search; do not edit. -->\n\n"
    "`gslcosim.search` is what the bundled methods are made of, for methods of your own: pure functions and small "
    "states, seeded, without the truth.\n"
    "Each docstring has the equation with its units, the source, and the test that holds it; the tables below have the "
    "first sentences.\n"
    "[methods.md](methods.md) shows which methods there are; [write-an-agent.md](write-an-agent.md) is the way from a "
    "block to a flying agent.\n\n"
    "This agent is complete; in docs/examples, "
    '`gslcosim up tiny_room --set "agents[0].start={{python: $PWD/wanderer.py}}"` flies it.\n\n'
    "<!-- from {example} -->\n```python\n{program}```\n\n## The modules\n"
)


def build_search_page(root: Path) -> str:
    """Return the whole page.

    Args:
        root: The repository, for the example.
    """
    head = _HEAD.format(example=EXAMPLE.as_posix(), program=(root / EXAMPLE).read_text(encoding="utf-8"))
    modules = [path for path in sorted(SEARCH.rglob("*.py")) if not path.stem.endswith(("_kernels", "__init__"))]
    return "\n".join([head, *map(_section, modules)])


def _section(module: Path) -> str:
    tree = ast.parse(module.read_text(encoding="utf-8"))
    rows = [f"| `{name}` | {text} |" for name, text in _blocks(tree)]
    name = ".".join(module.relative_to(SEARCH).with_suffix("").parts)
    lines = [f"### gslcosim.search.{name}\n", f"{_first_sentence(tree)}\n"]
    return "\n".join([*lines, "| name | |", "|---|---|", *rows, ""] if rows else lines)


def _blocks(tree: ast.Module) -> Iterator[tuple[str, str]]:
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node.name, _first_sentence(node).replace("|", "\\|")


def _first_sentence(node: ast.Module | ast.FunctionDef | ast.ClassDef) -> str:
    return " ".join((ast.get_docstring(node) or "").partition("\n\n")[0].split())


if __name__ == "__main__":
    sys.stdout.write(build_search_page(Path.cwd()))
