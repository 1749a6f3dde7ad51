"""Summary of a run from the small files of its folder, and filters of rows in the notation of the command line.

No large package is imported, and no YAML is parsed: a run's `scenario.yaml` has our own layout.
"""

import contextlib
import fnmatch
import math
import operator
import os
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

from gslcosim.base.checksums import check_files
from gslcosim.base.errors import UsageError
from gslcosim.base.files import read_regular_file
from gslcosim.base.method_names import join_methods, name_method
from gslcosim.base.untrusted_input import JsonObject, MalformedFileError, read_json

_FORM = re.compile(r"\s*([^\s!<>=]+)\s*(!=|<=|>=|=|<|>)\s*(.*?)\s*", re.DOTALL)
_ORDERS: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
Row = Mapping[str, Any]
State = Literal["ended", "running", "broken", "foreign"]
RESULT_SCHEMA = "gslcosim/result/1"
_SCENARIO_SCHEMA = "schema: gslcosim/scenario/"
_NAME = re.compile(r"^name: (.+)$", re.MULTILINE)
_SEED = re.compile(r"^seed: (\d+)$", re.MULTILINE)
# The blocks of `agents`, each from its name to its start.
_AGENT = re.compile(r"^- name: (.+)\n  start:\n((?:    .*\n)+)", re.MULTILINE)
_START = re.compile(r"^    (python|attach|process_of|method): (.+)$", re.MULTILINE)
_COMMAND = re.compile(r"^    command:\n((?:    - .*\n)+)", re.MULTILINE)
_MANIFEST, _RESULT, _SCENARIO = "manifest.json", "result.json", "scenario.yaml"
_S_PER_H = 3600.0
_MAX_SCENARIO_BYTES = 20_000_000
_MAX_SEED_DIGITS = 20


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One condition; a row without a value in the column fulfils only `!=`."""

    column: str
    relation: str
    value: str | float

    @classmethod
    def of(
        cls, text: str, *, numbers: Sequence[str], texts: Sequence[str], short: Mapping[str, str] | None = None
    ) -> Self:
        """Read a condition on columns of numbers and of texts; `short` has other names for columns."""
        match = _FORM.fullmatch(text)
        if match is None:
            raise UsageError(f"--where: expected COLUMN=VALUE, or !=, <, <=, > or >= for =, was '{text}'.")
        column, relation, value = match.groups()
        column = (short or {}).get(column, column)
        check_column("--where", column, (*texts, *numbers))
        if column in texts:
            if relation in _ORDERS:
                raise UsageError(f"--where {text}: expected = or != for the texts of {column}, was {relation}.")
            return cls(column=column, relation=relation, value=value)
        try:
            return cls(column=column, relation=relation, value=float(value))
        except ValueError as error:
            raise UsageError(f"--where {text}: expected a number for {column}, was '{value}'.") from error

    def holds(self, row: Row) -> bool:
        """Return whether a row fulfils the condition; texts may have `*` and `?` for any characters."""
        found = row[self.column]
        if self.relation in _ORDERS:
            return found is not None and _ORDERS[self.relation](found, float(self.value))
        if isinstance(self.value, str):
            is_equal = fnmatch.fnmatchcase(str(found), self.value)
        else:
            is_equal = found is not None and float(found) == self.value
        return is_equal is (self.relation == "=")


def sorted_rows(rows: Iterable[Row], key: str, columns: Sequence[str]) -> list[Row]:
    """Return rows sorted by a column, `-COLUMN` for the largest first; rows without a value come last."""
    column, is_reversed = key.removeprefix("-"), key.startswith("-")
    check_column("--sort", column, columns)
    having, lacking = [], []
    for row in rows:
        (lacking if row[column] in (None, "") else having).append(row)
    return [*sorted(having, key=lambda row: row[column], reverse=is_reversed), *lacking]


def check_column(option: str, column: str, columns: Sequence[str]) -> None:
    """Refuse a column that does not exist."""
    if column not in columns:
        raise UsageError(f"{option}: expected one of the columns {', '.join(columns)}, was '{column}'.")


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """One run, or a folder that looks like one.

    Attributes:
        run: Name of its folder, or of a trial.
        scenario: Name of its scenario; empty if no file has it.
        method: Method of its agents, `+` between several.
        seed: Its seed; None if no file has it.
        state: `ended` with a result; `running`; `broken`: without a result and without a process; `foreign`: no run.
        outcome: The referee's end reason, or the reason why there is none; in other states the defect.
        time_s: Simulated time [s].
        speed: Simulated time by wall time of the run.
        faults: Number of faults in the result.
        time_to_source_s: First success of any agent [s].
        distance_m: Distance of the nearest agent to a source at the end [m].
        path_m: Length of the paths of all agents [m].
        agents: Number of agents.
        size_mb: Size of all its files [MB].
        age_h: Time since the last change of its small files [h].
        version: gslcosim's version in the run.
        folder: Path of the folder.
    """

    run: str
    folder: str
    state: State
    outcome: str
    scenario: str = ""
    method: str = ""
    seed: int | None = None
    time_s: float | None = None
    speed: float | None = None
    faults: int | None = None
    time_to_source_s: float | None = None
    distance_m: float | None = None
    path_m: float | None = None
    agents: int | None = None
    size_mb: float | None = None
    age_h: float | None = None
    version: str = ""


def read_run_summary(folder: Path, *, now_s: float | None = None) -> RunSummary:
    """Return the summary of a folder by its files; whether a process runs it now is not checked.

    Args:
        now_s: Time from which its age counts, by `time.time`; by default now.
    """
    sizes, changed_s = _files(folder)
    size_mb = sum(sizes.values()) / 1e6
    age_h = round(max((time.time() if now_s is None else now_s) - changed_s, 0.0) / _S_PER_H, 4)
    result, manifest = (_read_json(folder / name) if name in sizes else {} for name in (_RESULT, _MANIFEST))
    text = _read_text(folder / _SCENARIO) if _SCENARIO in sizes else ""
    is_ours = text.startswith(_SCENARIO_SCHEMA) or "run_id" in manifest or result.get("schema") == RESULT_SCHEMA
    # A folder that was just created has no more than this.
    is_begun = set(sizes) <= {".reserve"} and (folder / "logs").is_dir()
    if folder.is_symlink() or not (is_ours or is_begun):
        what = "a link" if folder.is_symlink() else "not a run"
        return RunSummary(run=folder.name, folder=str(folder), state="foreign", outcome=what, size_mb=round(size_mb, 3),
                        age_h=age_h)  # fmt: skip
    has_result = result.get("schema") == RESULT_SCHEMA
    defect = "result.json cannot be read" if _RESULT in sizes else "no result.json"
    listed = result.get("agents")
    agents = [agent for agent in listed if isinstance(agent, dict)] if isinstance(listed, list) else []
    return RunSummary(
        run=folder.name,
        folder=str(folder),
        state="ended" if has_result else "broken",
        outcome=str(result.get("end_reason", "")) if has_result else defect,
        scenario=str(result.get("scenario") or _first(_NAME, text)),
        method=find_methods(text),
        seed=_whole(result.get("seed", manifest.get("seed", _first(_SEED, text)))),
        time_s=_number(result.get("sim_time_s")),
        speed=_number(result.get("real_time_factor")),
        faults=len(result["faults"]) if isinstance(result.get("faults"), list) else None,
        time_to_source_s=min(_numbers(agents, "time_to_source_s"), default=None),
        distance_m=min(_numbers(agents, "final_distance_m"), default=None),
        path_m=sum(_numbers(agents, "path_length_m")) if agents else None,
        agents=len(agents) or len(_AGENT.findall(text)) or None,
        size_mb=round(size_mb, 3),
        age_h=age_h,
        version=str(manifest.get("gslcosim", "")),
    )


def is_run_folder(folder: Path) -> bool:
    """Return whether a folder is a run, and not a folder of runs."""
    return any((folder / name).is_file() for name in (_RESULT, _MANIFEST, _SCENARIO)) and (folder / "logs").is_dir()


def find_methods(scenario_text: str) -> str:
    """Return the methods of the agents of a resolved scenario, each once, with `+` between them."""
    starts: dict[str, str] = {}
    for name, block in _AGENT.findall(scenario_text):
        found = dict(_START.findall(block))
        if "process_of" in found:
            starts[name] = starts.get(_bare(found["process_of"]), "")
        elif "python" in found:
            starts[name] = name_method(python=_bare(found["python"]))
        elif command := _COMMAND.search(block):
            words = [_bare(line.removeprefix("    - ")) for line in command[1].splitlines()]
            starts[name] = name_method(command=words)
        elif found.get("attach") == "true":
            starts[name] = name_method(method=_bare(found.get("method", "")))
    return join_methods(starts.values())


# Sizes by name, with the folder in front for files in folders, and the time of the last change [s].
def _files(folder: Path) -> tuple[dict[str, int], float]:
    sizes: dict[str, int] = {}
    changed_s = folder.stat(follow_symlinks=False).st_mtime
    waiting = [("", folder)]
    while waiting:
        before, inside = waiting.pop()
        try:
            entries = list(os.scandir(inside))
        except OSError:
            continue
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                waiting.append((f"{before}{entry.name}/", Path(entry.path)))
                continue
            with contextlib.suppress(OSError):
                stat = entry.stat(follow_symlinks=False)
                sizes[f"{before}{entry.name}"], changed_s = stat.st_size, max(changed_s, stat.st_mtime)
    return sizes, changed_s


def _read_json(path: Path) -> dict[str, Any]:
    with contextlib.suppress(MalformedFileError):
        check_files(path.parent, path.name)
        return read_json(path, JsonObject)
    return {}


def _read_text(path: Path) -> str:
    with contextlib.suppress(OSError, MalformedFileError):
        check_files(path.parent, path.name)
        return read_regular_file(path, max_bytes=_MAX_SCENARIO_BYTES).decode(errors="replace")
    return ""


def _numbers(agents: Iterable[Mapping[str, Any]], key: str) -> list[float]:
    return [number for agent in agents if (number := _number(agent.get(key))) is not None]


def _number(value: Any) -> float | None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number and math.isfinite(value) else None


def _whole(value: Any) -> int | None:
    text = str(value)
    return int(text) if text.isdecimal() and len(text) <= _MAX_SEED_DIGITS else None


def _first(pattern: re.Pattern[str], text: str) -> str:
    found = pattern.search(text)
    return _bare(found[1]) if found else ""


def _bare(text: str) -> str:
    return text.strip().strip("'\"")
