"""`gslcosim cache`: contents of the cache, by size and last use; removal of entries; kernels compiled ahead."""

import argparse
import re
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from gslcosim.base.disk_cache import FOLDERS
from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import Command, parse_positive_number
from gslcosim.cli.commands.runs import format_age
from gslcosim.cli.completion_words import find_named
from gslcosim.cli.terminal import add_json_option, table, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.base.disk_cache import CacheEntry

EXAMPLES = """  gslcosim cache
  gslcosim cache --kind tape --sort size --limit 10
  gslcosim cache --json
  gslcosim cache free --older-than 30d
  gslcosim cache free --keep 1GB --yes
  gslcosim cache free --kind kernels --all --yes
  gslcosim cache compile
  gslcosim cache compile warehouse_empty mine.yaml"""

_HEADINGS = ("kind", "entry", "size", "unused for", "in use")
_AGE = re.compile(r"(\d+(?:\.\d+)?)\s*(min|h|d|w)")
_UNITS_S = {"min": 60.0, "h": 3600.0, "d": 86400.0, "w": 604800.0}


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "action",
        nargs="?",
        choices=("list", "free", "compile"),
        default="list",
        help="list entries (default), free room, or compile kernels ahead of runs",
    )
    parser.add_argument(
        "scenarios",
        nargs="*",
        metavar="SCENARIO",
        default=[],
        help="with compile: only what runs of these files or bundled scenarios need",
    )
    parser.add_argument(
        "--kind",
        action="append",
        metavar="KIND",
        default=[],
        help="only room, tape, kernels, files or program; repeatable",
    )
    parser.add_argument("--sort", choices=("age", "size"), default="age", help="most recently used, or largest, first")
    parser.add_argument("--limit", type=parse_positive_number, metavar="N", help="show only the first N entries")
    parser.add_argument("--older-than", metavar="AGE", help="with free: entries unused for this long: 12h, 30d, 8w")
    parser.add_argument(
        "--keep", metavar="SIZE", help="with free: least recently used entries, until at most SIZE is left: 1GB"
    )
    parser.add_argument("--all", action="store_true", help="with free: all entries that are not in use")
    parser.add_argument("--yes", action="store_true", help="with free: remove them instead of only listing them")
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    wrong = [kind for kind in arguments.kind if kind not in FOLDERS]
    if wrong:
        raise UsageError(f"gslcosim cache: expected --kind of {', '.join(FOLDERS)}, was {wrong[0]!r}.")
    if arguments.scenarios and arguments.action != "compile":
        raise UsageError(f"gslcosim cache: expected scenarios with compile only, was {arguments.scenarios[0]!r}.")
    is_freeing = arguments.older_than is not None or arguments.keep is not None or arguments.all
    if arguments.action != "free":
        if is_freeing or arguments.yes:
            raise UsageError("gslcosim cache: expected --older-than, --keep, --all and --yes with free only.")
        return _list(arguments) if arguments.action == "list" else _compile(arguments)
    if not is_freeing:
        raise UsageError("gslcosim cache free: expected --older-than, --keep or --all, which say what to remove.")
    return _free(arguments)


def _list(arguments: argparse.Namespace) -> int:
    from gslcosim.base.disk_cache import LIMIT_VARIABLE, limit_from_environment, list_entries
    from gslcosim.base.kernel_cache import get_cache_root

    entries, limit_bytes = _select_kinds(list_entries(), arguments.kind), limit_from_environment()
    total_bytes = sum(entry.size_bytes for entry in entries)
    shown = sorted(entries, key=lambda entry: -entry.size_bytes) if arguments.sort == "size" else entries
    shown = shown[: arguments.limit]
    if arguments.json:
        limit_mb = None if limit_bytes == float("inf") else limit_bytes / 1e6
        write_json(
            {
                "folder": str(get_cache_root()), "size_mb": _mb(total_bytes), "limit_mb": limit_mb,
                "entries": [_row(entry) for entry in shown],
            }
        )  # fmt: skip
        return 0
    if shown:
        write(table(_HEADINGS, [_cells(entry) for entry in shown]))
        write()
    if len(shown) < len(entries):
        write_note(f"{len(shown)} of {len(entries)}")
    for kind in dict.fromkeys(entry.kind for entry in entries):
        of_kind = [entry for entry in entries if entry.kind == kind]
        write(f"{kind:<9}{len(of_kind):>6}   {_size(sum(entry.size_bytes for entry in of_kind))}")
    limit = "no limit" if limit_bytes == float("inf") else f"limit {_size(limit_bytes)}"
    write(f"{'all':<9}{len(entries):>6}   {_size(total_bytes)}, {limit} ({LIMIT_VARIABLE})")
    write(f"folder   {get_cache_root()}")
    return 0


def _free(arguments: argparse.Namespace) -> int:
    from gslcosim.base.disk_cache import list_entries, remove_entries

    choose = _build_choice(arguments)
    if arguments.yes:
        chosen = remove_entries(choose)
        kept: Sequence[CacheEntry] = ()
    else:
        found = choose(list_entries())
        chosen = [entry for entry in found if not entry.is_in_use]
        kept = [entry for entry in found if entry.is_in_use]
    size_bytes = sum(entry.size_bytes for entry in chosen)
    if arguments.json:
        write_json({"removed": arguments.yes, "entries": [_row(e) for e in chosen], "size_mb": _mb(size_bytes)})
        return 0
    if chosen:
        write(table(_HEADINGS, [_cells(entry) for entry in chosen]))
        write()
    for entry in kept:
        write(f"kept       {entry.folder}: a process uses it")
    verb = "Removed" if arguments.yes else "Would remove"
    n = "1 entry" if len(chosen) == 1 else f"{len(chosen)} entries"
    write(f"{verb} {n}, {_size(size_bytes)}." + ("" if arguments.yes or not chosen else " Do it with --yes."))
    return 0


def _compile(arguments: argparse.Namespace) -> int:
    import subprocess

    from gslcosim.cli.progress import ProgressLine
    from gslcosim.runtime.kernel_compilation import compile_kernels

    before_bytes, began_s = _measure_kernels_bytes(), time.monotonic()
    with ProgressLine("compiling kernels", is_quiet=arguments.json) as line:

        def report(fraction: float) -> None:
            line.show("", fraction=fraction, plain=f"{100 * fraction:.0f} %")

        try:
            compile_kernels(arguments.scenarios, report)
        except subprocess.CalledProcessError as error:
            raise UsageError("gslcosim cache compile: a process has failed, for the reason above.") from error
    added_bytes, took_s = _measure_kernels_bytes() - before_bytes, time.monotonic() - began_s
    if arguments.json:
        write_json({"added_mb": _mb(added_bytes), "took_s": round(took_s, 1)})
    else:
        write(f"Compiled {_size(added_bytes)} of kernels in {took_s:.0f} s.")
    return 0


def _measure_kernels_bytes() -> int:
    from gslcosim.base.disk_cache import list_entries

    return sum(entry.size_bytes for entry in list_entries() if entry.kind == "kernels")


def _build_choice(arguments: argparse.Namespace) -> "Callable[[Sequence[CacheEntry]], list[CacheEntry]]":
    from gslcosim.base.disk_cache import parse_size_bytes

    limit_s = None if arguments.older_than is None else _parse_age_s(arguments.older_than)
    keep_bytes = None if arguments.keep is None else parse_size_bytes(arguments.keep, place="gslcosim cache --keep")

    def choose(entries: "Sequence[CacheEntry]") -> "list[CacheEntry]":
        entries = _select_kinds(entries, arguments.kind)
        left_bytes = sum(entry.size_bytes for entry in entries)
        chosen: list[CacheEntry] = []
        for entry in sorted(entries, key=lambda entry: entry.used_at_s):
            is_old = limit_s is not None and time.time() - entry.used_at_s > limit_s
            if arguments.all or is_old or (keep_bytes is not None and left_bytes > keep_bytes):
                chosen.append(entry)
                left_bytes -= 0 if entry.is_in_use else entry.size_bytes
        return chosen

    return choose


def _parse_age_s(text: str) -> float:
    found = _AGE.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"gslcosim cache --older-than: expected an age such as 90min, 12h, 30d or 8w, was {text!r}.")
    return float(found[1]) * _UNITS_S[found[2]]


def _select_kinds(entries: "Sequence[CacheEntry]", kinds: Sequence[str]) -> "list[CacheEntry]":
    return [entry for entry in entries if not kinds or entry.kind in kinds]


def _cells(entry: "CacheEntry") -> tuple[str, ...]:
    age_h = (time.time() - entry.used_at_s) / 3600
    in_use = "yes" if entry.is_in_use else "-"
    return entry.kind, entry.folder.name, _size(entry.size_bytes), format_age(max(0.0, age_h)), in_use


def _row(entry: "CacheEntry") -> dict[str, Any]:
    return {
        "kind": entry.kind,
        "entry": entry.folder.name,
        "folder": str(entry.folder),
        "size_mb": _mb(entry.size_bytes),
        "unused_h": round(max(0.0, time.time() - entry.used_at_s) / 3600, 3),
        "is_in_use": entry.is_in_use,
    }


def _mb(size_bytes: float) -> float:
    return round(size_bytes / 1e6, 3)


def _size(size_bytes: float) -> str:
    if size_bytes >= 1e9:
        return f"{size_bytes / 1e9:.1f} GB"
    return f"{size_bytes / 1e6:.1f} MB" if size_bytes >= 1e6 else f"{size_bytes / 1e3:.0f} kB"


COMMAND = Command(
    name="cache",
    summary="list the cache (rooms, gas tapes, compiled kernels) by size and last use; free space; compile ahead",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    completes={"KIND": [find_named(lambda: FOLDERS)]},
    run=_run,
)
