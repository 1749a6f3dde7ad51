"""Figures of the code of commits: lines by part, helpers that are called once, docstrings and names of modules.

`python tests/benchmarks/code_figures.py fade373 HEAD` prints a column for each commit; HEAD alone by default. Lines are
those of Python without tests and templates: of the core, of each extension, of agents, and their sum. Of a commit
before there were extensions, the packages that became one count as that extension.
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
FOLDERS = ("gslcosim", "services", "agents", "extensions")
# Packages by what they became; the first that a path begins with counts.
FORMER_EXTENSIONS = {
    "archive": (
        "gslcosim/bench/audits.py", "gslcosim/bench/dataset", "gslcosim/bench/sealing.py", "gslcosim/bench/signing",
        "gslcosim/bench/site", "gslcosim/bench/submissions.py",
    ),
    "bench": ("gslcosim/bench",),
    "conformance": ("gslcosim/conformance", "gslcosim/teleop"),
    "fmi": ("gslcosim/runtime/external/fmi", "gslcosim/data/export/room_fmu.py"),
    "ros": (
        "gslcosim/ros", "gslcosim/simulation/ros_services", "services/ros2", "gslcosim/data/export/ros_topics.py",
        "gslcosim/data/log_bags.py",
    ),
    "data": ("gslcosim/data",),
    "search": ("gslcosim/search",),
    "training": ("gslcosim/training",),
    "validation": ("gslcosim/validation",),
}  # fmt: skip
# These stayed in the core under other names.
STAYED = ("gslcosim/data/recording", "gslcosim/data/run_summary.py")
# Sentences that begin so say what is asked, not what the thing is.
ODD = re.compile(r"(What|Who|How|Whether|Of)\b")
GERUND = re.compile(r"[a-z]{2,}ing$")


def git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def read_texts(commit: str, names: list[str]) -> dict[str, str]:
    """Return the texts of files of a commit by their names."""
    asked = "".join(f"{commit}:{name}\n" for name in names).encode()
    answer = subprocess.run(["git", "cat-file", "--batch"], cwd=ROOT, input=asked, capture_output=True, check=True)
    texts, at = {}, 0
    for name in names:
        end = answer.stdout.index(b"\n", at)
        start, size = end + 1, int(answer.stdout[at:end].split()[2])
        texts[name], at = answer.stdout[start : start + size].decode(), start + size + 1
    return texts


def find_part(name: str) -> str:
    """Return the part that a file belongs to: core, agents or an extension."""
    first, _, rest = name.partition("/")
    if first == "extensions":
        return rest.partition("/")[0]
    if first == "agents":
        return "agents"
    if not name.startswith(STAYED):
        for extension, packages in FORMER_EXTENSIONS.items():
            if any(name == package or name.startswith((f"{package}/", f"{package}.py")) for package in packages):
                return extension
    return "core"


def is_counted(name: str) -> bool:
    return name.endswith(".py") and not {"templates", "tests", "benchmarks"} & set(name.split("/"))


def count_lines(texts: dict[str, str]) -> dict[str, int]:
    """Return the lines of each part, core first, and their sum."""
    lines: Counter[str] = Counter()
    for name, text in texts.items():
        lines[find_part(name)] += len(text.splitlines())
    extensions = sorted(lines.keys() - {"core", "agents"})
    parts = {f"lines, {part}": lines[part] for part in ("core", *extensions, "agents")}
    return parts | {"lines, sum": lines.total()}


def count(commit: str, since: str | None = None) -> dict[str, float]:
    """Return figures of a commit by their names; `since` is the commit after which subjects of commits count."""
    listed = git("ls-tree", "-r", "--name-only", commit, *FOLDERS).splitlines()
    everything = read_texts(commit, [name for name in listed if is_counted(name)])
    texts = {name: text for name, text in everything.items() if not name.startswith("agents/")}
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
        **count_lines(everything),
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
    names = [*dict.fromkeys(name for column in reversed(columns) for name in column)]
    width = max(map(len, names))
    print(f"{'':{width}}  " + "  ".join(f"{commit:>12}" for commit in commits))
    for name in names:
        print(f"{name:{width}}  " + "  ".join(f"{column.get(name, ''):>12}" for column in columns))


if __name__ == "__main__":
    main()
