"""Settings of the documentation's site, which `make docs-site` builds from the pages of the repository."""

import re
import sys
from importlib.metadata import version as find_version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
# Where the repository can be browsed, with a slash at the end; links to files that are no pages lead there.
REPOSITORY_URL = ""

sys.path.insert(0, str(ROOT))

project = "gslcosim"
author = "the developers of gslcosim"
project_copyright = author
release = version = find_version("gslcosim")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinxcontrib.mermaid",
]
# The index is the page that a person sees first in the repository as well.
root_doc = "docs/README"
include_patterns = [
    "docs/**",
    "agents/*/README.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
]
exclude_patterns = [
    "docs/_build",
    "docs/studies/*.py",
    ".*",
    "build",
    "dist",
    "extensions",
    "gslcosim",
    "services",
    "tests",
    "runs",
]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb"}

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]
# Notebooks are executed by tests; a build of the site takes a minute without that.
nb_execution_mode = "off"
suppress_warnings = ["mystnb.unknown_mime_type", "myst.header"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
napoleon_google_docstring = True
default_role = "code"

html_theme = "furo"
html_title = f"gslcosim {release}"
html_static_path: list[str] = []
html_extra_path = ["_build/site"]
html_copy_source = False
copybutton_exclude = ".linenos, .gp, .go"

# Pages that have pages below them, which they name.
_SUBPAGES = {
    "docs/decisions/README": ["docs/decisions/*.md"],
    "docs/write-an-agent": ["docs/agents/*.md"],
    "docs/methods": ["docs/methods/*.md", "agents/*/README.md"],
    "docs/search": ["docs/search/*.md"],
    "docs/examples/adapters/README": ["docs/examples/adapters/*/README.md"],
    "docs/benchmark/measured": ["docs/examples/leak_alarm/README.md"],
}
_LISTED_ELSEWHERE = ("agents/contract/README",)
_ROW = re.compile(r"^\| .*$", re.MULTILINE)
_TARGET = re.compile(r"\]\(([^)#]+\.(?:md|ipynb))\)")


def add_contents(app: Any, docname: str, source: list[str]) -> None:
    """Add tables of contents: to the index a part for each of its sections, to others the pages that belong to them."""
    if docname == root_doc:
        sections = re.split(r"^## (.+)$", source[0], flags=re.MULTILINE)
        for title, text in zip(sections[1::2], sections[2::2], strict=True):
            targets = [target for row in _ROW.findall(text) for target in _TARGET.findall(row)]
            _append_toctree(source, [_find_document(target) for target in targets], caption=title)
    elif docname in _SUBPAGES:
        pages = sorted(path for pattern in _SUBPAGES[docname] for path in ROOT.glob(pattern))
        found = [page.relative_to(ROOT).with_suffix("").as_posix() for page in pages]
        _append_toctree(source, [page for page in found if page != docname and page not in _LISTED_ELSEWHERE])


def _append_toctree(source: list[str], documents: list[str], *, caption: str = "") -> None:
    lines = "\n".join(f"/{document}" for document in documents)
    options = ":hidden:\n" + (f":caption: {caption}\n" if caption else "")
    source[0] += f"\n\n```{{toctree}}\n{options}\n{lines}\n```\n"


def _find_document(target: str) -> str:
    path = (ROOT / "docs" / target).resolve().relative_to(ROOT.resolve())
    return path.with_suffix("").as_posix()


def link_files(app: Any, docname: str, source: list[str]) -> None:
    """Turn links to files and folders that are no pages of the site into links to the repository, or into words."""
    folder = (ROOT / docname).parent

    def replace(found: re.Match[str]) -> str:
        text, target = found[1], found[2]
        path = (folder / target.partition("#")[0]).resolve()
        is_page = path.suffix in source_suffix and app.env is not None and _is_in_site(app, path)
        if "://" in target or target.startswith(("#", "mailto:")) or is_page or path.suffix in (".png", ".webp"):
            return found[0]
        if path.is_dir() and _is_in_site(app, path / "README.md"):
            return f"[{text}]({target.rstrip('/')}/README.md)"
        name = path.relative_to(ROOT.resolve()).as_posix()
        return f"[{text}]({REPOSITORY_URL}{name})" if REPOSITORY_URL else text

    source[0] = re.sub(r"(?<!!)\[([^\]\[]+)\]\(([^)\s]+)\)", replace, source[0])


def _is_in_site(app: Any, path: Path) -> bool:
    try:
        return path.relative_to(ROOT.resolve()).with_suffix("").as_posix() in app.env.found_docs
    except ValueError:
        return False


def escape_docstring(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep bars and stars of equations in docstrings from being read as markup."""
    lines[:] = [re.sub(r"(?<!\\)([|*])", r"\\\1", line) for line in lines]


def setup(app: Any) -> None:
    """Connect what changes pages while they are read."""
    app.connect("source-read", link_files)
    app.connect("source-read", add_contents)
    app.connect("autodoc-process-docstring", escape_docstring, priority=900)
