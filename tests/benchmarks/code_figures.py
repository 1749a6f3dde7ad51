"""Figures of the code of commits: sizes, helpers that are called once, docstrings and names of modules.

`python tests/benchmarks/code_figures.py fade373 HEAD` prints a column for each commit; HEAD alone by default.
"""

# ruff: noqa: T201 - this is a script

import argparse
import ast
import re
import statistics
import subprocess
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("gslcosim", "services")
# Sentences that begin so say what is asked, not what the thing is.
ODD = re.compile(r"(What|Who|How|Whether|Of)\b")
GERUND = re.compile(r"[a-z]{2,}ing$")


def git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def count(commit: str, since: str | None = None) -> dict[str, float]:
    """Return figures of a commit by their names; `since` is the commit after which subjects of commits count."""
    listed = git("ls-tree", "-r", "--name-only", commit, *FOLDERS).splitlines()
    names = [name for name in listed if name.endswith(".py")]
    texts = {name: git("show", f"{commit}:{name}") for name in names if "/templates/" not in name}
    n_lines, n_classes, n_docstrings, n_odd, n_once = 0, 0, 0, 0, 0
    for text in texts.values():
        tree = ast.parse(text)
        n_lines += len(text.splitlines())
        used = Counter(node.id for node in ast.walk(tree) if isinstance(node, ast.Name))
        used.update(node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute))
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (said := ast.get_docstring(node)):
                n_docstrings += 1
                n_odd += bool(ODD.match(said))
            n_classes += isinstance(node, ast.ClassDef) and not node.name.startswith("_")
            is_helper = isinstance(node, ast.FunctionDef) and re.match(r"_[a-z]", node.name) is not None
            n_once += is_helper and used[node.name] == 1
    modules = [Path(name).stem for name in texts]
    figures = {
        "files": len(texts),
        "lines": n_lines,
        "lines a file, median": statistics.median(len(text.splitlines()) for text in texts.values()),
        "public classes": n_classes,
        "private helpers called once, per 1,000 lines": round(1000 * n_once / n_lines, 2),
        "docstrings that begin with What, Who, How, Whether, Of [%]": round(100 * n_odd / n_docstrings, 2),
        "modules named by a gerund": sum(GERUND.match(name) is not None for name in modules),
    }
    if since is not None:
        subjects = git("log", "--no-merges", "--format=%s", f"{since}..{commit}").splitlines()
        figures["subject of commits, median length"] = statistics.median(map(len, subjects)) if subjects else 0
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commits", nargs="*", default=["HEAD"], help="commits, oldest first")
    commits = parser.parse_args().commits
    columns = [count(commit, before) for commit, before in zip(commits, [None, *commits[:-1]], strict=True)]
    width = max(map(len, columns[-1]))
    print(f"{'':{width}}  " + "  ".join(f"{commit:>12}" for commit in commits))
    for name in columns[-1]:
        print(f"{name:{width}}  " + "  ".join(f"{column.get(name, ''):>12}" for column in columns))


if __name__ == "__main__":
    main()
