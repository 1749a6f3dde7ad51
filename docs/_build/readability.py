"""Readability of the pages, at a commit and now: `python docs/_build/readability.py COMMIT [PAGE ...]`.

Words count everything a reader sees but programs. Sentences are those of paragraphs and lists, without headings,
tables and programs. A sentence is long above 25 words. It counts as passive when a form of *be* stands at most two
words before a participle (a word that ends in -ed, or an irregular one of the list below), as in `is never written`;
that heuristic finds some adjectives too ("is limited"). Habits are phrases that a reader stumbles over.
"""

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

PAGES = ("*.md", "docs/**/*.md", "docs/**/*.ipynb", "agents/*/README.md", "scenarios/**/README.md")
# Records of the past and generated lists: they are printed, but the second total leaves them out.
RECORDS = re.compile(r"^(CHANGELOG\.md|docs/decisions/|docs/studies/)")
LONG_WORDS = 25

_IRREGULAR = (
    "begun bound bought broken brought built caught chosen cut done drawn driven found given gone held hidden kept "
    "known laid left lost made meant met paid proven put read run said seen sent set shown shut slept solved spent split spread "
    "stored stopped sought taken taught thrown told thought understood withdrawn won worn written"
)
_PASSIVE = re.compile(
    r"\b(?:is|are|was|were|be|been|being|isn't|aren't)\s+(?:[\w'-]+\s+){0,2}?(?:\w+ed|"
    + "|".join(_IRREGULAR.split())
    + r")\b",
    re.IGNORECASE,
)
HABITS = re.compile(
    r"\b(?:of one's own|what counts as|says? (?:what|how|which|whether|who|why)|tells? (?:what|how|which|whether)|"
    r"is told|are told|whoever|nobody|anew|there is no telling|what it comes to|goes on|go on|flown)\b",
    re.IGNORECASE,
)
_WORD = re.compile(r"[A-Za-z0-9À-ž][\w'./:-]*")
# A full stop ends a sentence before a capital letter, a quotation, code or the end, but not after these.
_END = re.compile(r"(?<=[.!?])(?<!e\.g\.)(?<!i\.e\.)(?<!eq\.)(?<!al\.)(?<!vs\.)[\"')*_]*\s+(?=[A-Z\"'(`*_\[])")
_ITEM = re.compile(r"^\s*(?:[-*+]|\d+[.)])\s+")


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Counts of a page or of several together."""

    words: int = 0
    sentences: int = 0
    long: int = 0
    passive: int = 0
    habits: int = 0

    def __add__(self, other: "Counts") -> "Counts":
        return Counts(**{name: getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__})


def count_page(text: str) -> Counts:
    """Count words, sentences and their faults in the text of a Markdown page."""
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"^ *(```|~~~).*?^ *\1 *$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    sentences = split_sentences(text)
    return Counts(
        words=len(_WORD.findall(text)),
        sentences=len(sentences),
        long=sum(len(_WORD.findall(sentence)) > LONG_WORDS for sentence in sentences),
        passive=sum(bool(_PASSIVE.search(sentence)) for sentence in sentences),
        habits=len(HABITS.findall(text)),
    )


def split_sentences(text: str) -> list[str]:
    """Return the sentences of paragraphs and list items; headings and tables have none."""
    blocks: list[str] = [""]
    for line in text.splitlines():
        if not line.strip() or line.lstrip().startswith(("#", "|")):
            blocks.append("")
        elif _ITEM.match(line):
            blocks.append(_ITEM.sub("", line))
        else:
            blocks[-1] += " " + line.strip()
    parts = [part.strip() for block in blocks for part in _END.split(block)]
    return [part for part in parts if len(_WORD.findall(part)) > 1]


def read_markdown(path: str, content: str) -> str:
    """Return the Markdown of a page; of a notebook, that of its text cells."""
    if not path.endswith(".ipynb"):
        return content
    cells = json.loads(content)["cells"]
    return "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")


def list_pages(root: Path) -> list[str]:
    """Return the pages of a checkout, relative to it."""
    found = {path.relative_to(root).as_posix() for pattern in PAGES for path in root.glob(pattern)}
    return sorted(found, key=lambda page: (page.count("/") > 0, page))


def list_pages_at(root: Path, commit: str) -> list[str]:
    """Return the pages of a commit."""
    names = _git(root, "ls-tree", "-r", "--name-only", commit).splitlines()
    pattern = r"([^/]+\.md|docs/.*\.(md|ipynb)|agents/[^/]+/README\.md|scenarios/(.*/)?README\.md)"
    return [name for name in names if re.fullmatch(pattern, name)]


def count_all(pages: Iterable[str], read: Callable[[str], str]) -> dict[str, Counts]:
    """Return the counts of each page."""
    return {page: count_page(read_markdown(page, read(page))) for page in pages}


def format_table(before: dict[str, Counts], now: dict[str, Counts]) -> str:
    """Return a line for each page and two totals: words, long and passive shares, habits, each before and now."""
    pages = [*now, *(page for page in before if page not in now)]
    rows = [_row(page, before.get(page), now.get(page)) for page in pages]
    kept = [page for page in pages if not RECORDS.match(page)]
    none = Counts()
    for title, chosen in (("all pages", pages), ("without changelog, decisions and studies", kept)):
        rows.append(_row(title, *(sum((part.get(page, none) for page in chosen), none) for part in (before, now))))
    head = f"{'page':<68} {'words':>15} {'> 25 words':>13} {'passive':>13} {'habits':>11}"
    return "\n".join([head, *rows])


def _row(name: str, before: Counts | None, now: Counts | None) -> str:
    words, long, passive, habits = zip(*map(_cells, (before, now)), strict=True)
    return (
        f"{name:<68} {words[0]:>7} {words[1]:>7} {long[0]:>6} {long[1]:>6} {passive[0]:>6} {passive[1]:>6} "
        f"{habits[0]:>5} {habits[1]:>5}"
    )


def _cells(counts: Counts | None) -> tuple[str, str, str, str]:
    if counts is None:
        return "-", "-", "-", "-"
    n_sentences = max(counts.sentences, 1)
    return (
        f"{counts.words}",
        f"{counts.long / n_sentences:.0%}",
        f"{counts.passive / n_sentences:.0%}",
        f"{counts.habits}",
    )


def _git(root: Path, *arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True).stdout


def main(commit: str, *pages: str) -> None:
    """Print the table of all pages, or of the given ones."""
    root = Path.cwd()
    then, today = list_pages_at(root, commit), list_pages(root)
    if pages:
        then, today = ([page for page in found if page in pages] for found in (then, today))
    before = count_all(then, lambda page: _git(root, "show", f"{commit}:{page}"))
    now = count_all(today, lambda page: (root / page).read_text(encoding="utf-8"))
    sys.stdout.write(format_table(before, now) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
