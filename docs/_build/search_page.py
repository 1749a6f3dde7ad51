"""Pages of search building blocks, from the docstrings of `gslcosim_search`: `make docs` writes docs/search*."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import gslcosim_search

SEARCH = Path(gslcosim_search.__file__).parent
# A program in the repository that the page shows.
EXAMPLE = Path("docs") / "examples" / "wanderer.py"
PAGE = "search.md"
# Packages by what they are for; modules beside them are in the last one.
_PACKAGES = {
    "motion": "Motion and declaration",
    "senses": "Readings",
    "reactive": "Reactive search",
    "bayes": "Beliefs",
    "information": "Information-driven search",
    "maps": "Gas maps",
    "swarms": "Swarms",
    "learned": "Learned policies",
    "fixed_sensors": "Fixed sensors",
    "shared": "Shared parts",
}

_NOTE = "<!-- Made by `make docs` from the docstrings of extensions/search/gslcosim_search; do not edit. -->"
_HEAD = """# Building blocks of search methods

{note}

`gslcosim_search` contains the parts of the bundled methods: pure functions and small states, with seeds and without access to the truth.
Each docstring has the equation with units, the source, and the test that checks it.

- Bundled methods: [methods.md](methods.md).
- From a block to an agent: [write-an-agent.md](write-an-agent.md).

This agent is complete.
Run it in docs/examples with `gslcosim up tiny_room --set "agents[0].start={{python: $PWD/wanderer.py}}"`.

<!-- from {example} -->
```python
{program}```
"""  # noqa: E501


def build_search_pages(root: Path) -> dict[str, str]:
    """Return the pages by their paths in docs: search.md with a table for each package, and a page for each package.

    Args:
        root: The repository, for the example.
    """
    program = (root / EXAMPLE).read_text(encoding="utf-8")
    overview = [_HEAD.format(note=_NOTE, example=EXAMPLE.as_posix(), program=program)]
    pages: dict[str, str] = {}
    others = {path.parent.name for path in SEARCH.glob("*/__init__.py")} - {*_PACKAGES}
    for package, title in (*_PACKAGES.items(), *((name, name) for name in sorted(others))):
        modules = _list_modules(package)
        rows = [_row(package, module) for module in modules]
        overview.append("\n".join([f"## {title}\n", "| module | contents | names |", "|---|---|---|", *rows, ""]))
        head = f"# {title}: gslcosim_search{'' if package == 'shared' else '.' + package}\n\n{_NOTE}\n"
        pages[f"search/{package}.md"] = "\n".join([head, *map(_section, modules)])
    return {PAGE: "\n".join(overview), **pages}


def _list_modules(package: str) -> list[Path]:
    folder = SEARCH if package == "shared" else SEARCH / package
    return [path for path in sorted(folder.glob("*.py")) if not path.stem.endswith(("_kernels", "__init__"))]


def _module_name(module: Path) -> str:
    return ".".join(("gslcosim_search", *module.relative_to(SEARCH).with_suffix("").parts))


def _row(package: str, module: Path) -> str:
    tree = ast.parse(module.read_text(encoding="utf-8"))
    anchor = "".join(c for c in _module_name(module) if c.isalnum() or c in "_-")
    names = ", ".join(f"`{name}`" for name, _ in _blocks(tree))
    return f"| [{module.stem}](search/{package}.md#{anchor}) | {_first_sentence(tree)} | {names} |"


def _section(module: Path) -> str:
    tree = ast.parse(module.read_text(encoding="utf-8"))
    rows = [f"| `{name}` | {text} |" for name, text in _blocks(tree)]
    lines = [f"## {_module_name(module)}\n", f"{_first_sentence(tree)}\n"]
    return "\n".join([*lines, "| name | contents |", "|---|---|", *rows, ""] if rows else lines)


def _blocks(tree: ast.Module) -> Iterator[tuple[str, str]]:
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node.name, _first_sentence(node).replace("|", "\\|")


def _first_sentence(node: ast.Module | ast.FunctionDef | ast.ClassDef) -> str:
    return " ".join((ast.get_docstring(node) or "").partition("\n\n")[0].split())


if __name__ == "__main__":
    docs_dir = Path(sys.argv[1])
    for name, text in build_search_pages(Path.cwd()).items():
        (docs_dir / name).parent.mkdir(exist_ok=True)
        (docs_dir / name).write_text(text, encoding="utf-8")
