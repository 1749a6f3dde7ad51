"""Freeze: results to the bit, and texts, that must not change unless somebody means it.

`make freeze` computes and writes tests/freeze/frozen.json, `make freeze-check` computes and compares. What is computed
is in jobs.py; it depends on the command line and public names alone, so that code can move below it.
An interrupted freeze goes on where it was, as long as no source file has changed.
"""

# ruff: noqa: T201 - this is a script

import argparse
import concurrent.futures as futures
import fcntl
import fnmatch
import hashlib
import json
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

from commands import Skipped
from jobs import ROOT, Entry, Job, all_jobs
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from versions import differing, installed_versions

FROZEN = Path(__file__).resolve().parent / "frozen.json"
STATE = ROOT / ".freeze"
CODE = ("gslcosim", "agents", "services", "extensions")
# What else decides an entry.
INPUTS = ("scenarios", "tests/end_to_end", "tests/golden", *(f"tests/freeze/{name}" for name in (
    "jobs.py", "learning.py", "commands.py", "bad_inputs.jsonl")))  # fmt: skip
N_WORKERS = 2
# A run of many processes may fail on a machine that is busy with something else.
N_TRIES = 2


# --- the frozen file -------------------------------------------------------------------------------------------------


@dataclass
class Frozen:
    """What is frozen: the versions it was made with, entries by name, and reasons of those that are missing."""

    versions: dict[str, str]
    entries: dict[str, Entry] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)

    @classmethod
    def load(cls, path: Path) -> "Frozen":
        """Read a frozen file."""
        content = json.loads(path.read_text(encoding="utf-8"))
        return cls(content["versions"], content["entries"], content["skipped"])

    def save(self, path: Path) -> None:
        """Write a frozen file, an entry a line."""
        blocks = [_block(name, getattr(self, name)) for name in ("versions", "skipped", "entries")]
        part = path.with_suffix(".part")
        part.write_text("{\n" + ",\n".join(blocks) + "\n}\n", encoding="utf-8")
        part.replace(path)


def _block(name: str, items: dict[str, Any]) -> str:
    lines = [f"  {json.dumps(key)}: {json.dumps(items[key], ensure_ascii=False)}" for key in sorted(items)]
    return f"{json.dumps(name)}: {{\n" + ",\n".join(lines) + ("\n}" if lines else "}")


def differences(frozen: dict[str, Entry], now: dict[str, Entry]) -> dict[str, str]:
    """Return what differs between frozen and present entries of the same jobs, by name; new entries do not."""
    found = {name: "gone" for name in frozen if name not in now}
    for name in sorted(frozen.keys() & now.keys()):
        if frozen[name] != now[name]:
            found[name] = _difference(frozen[name], now[name])
    return dict(sorted(found.items()))


def _difference(then: Entry, now: Entry) -> str:
    keys = [key for key in {**then, **now} if then.get(key) != now.get(key)]
    texts = [f"{key}: was {_short(then.get(key))}, is {_short(now.get(key))}" for key in keys]
    return "; ".join(texts[:6]) + (f"; and {len(texts) - 6} more" if len(texts) > 6 else "")


def _short(value: Any) -> str:
    text = "missing" if value is None else str(value)
    return text if len(text) <= 400 else f"{text[:400]}…"


# --- computing -------------------------------------------------------------------------------------------------------


@dataclass
class Done:
    """What came of one job, and what it cost."""

    job: str
    entries: dict[str, Entry] = field(default_factory=dict)
    skipped: str = ""
    failed: str = ""
    wall_s: float = 0.0
    cpu_s: float = 0.0


def compute(name: str) -> Done:
    """Compute a job in a working directory that is gone afterwards."""
    (job,) = (job for job in all_jobs() if job.name == name)
    done, began_s, began_cpu_s = Done(name), time.monotonic(), _cpu_s()
    for _ in range(N_TRIES):
        with tempfile.TemporaryDirectory(prefix="freeze-") as folder:
            os.chdir(folder)
            try:
                done.entries, done.failed = job.entries(), ""
                break
            except Skipped as reason:
                done.skipped = str(reason)
                break
            except Exception as error:
                done.failed = "".join(traceback.format_exception_only(error)).strip()
                done.failed += f" ({traceback.extract_tb(error.__traceback__)[-1]})"
            finally:
                os.chdir(ROOT)
    done.wall_s, done.cpu_s = time.monotonic() - began_s, _cpu_s() - began_cpu_s
    return done


def _cpu_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _ignore_interrupts() -> None:
    # Ctrl-C reaches every process of the terminal; the first one ends in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class Partial:
    """What an interrupted freeze has computed already, in a file that is added to as jobs end."""

    def __init__(self, path: Path, versions: dict[str, str]) -> None:
        self._path = path
        self._key = hashlib.blake2b(f"{hash_of_files(*CODE, *INPUTS)} {versions}".encode(), digest_size=16).hexdigest()
        self.done: dict[str, Done] = {}
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        if lines and lines[0] == self._key:
            for line in lines[1:]:
                try:
                    done = Done(**json.loads(line))
                except ValueError:
                    # The last line of one that was killed as it wrote.
                    continue
                self.done[done.job] = done
        self.is_new = not self.done

    def begin(self) -> None:
        """Write the file again, with what is known."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        lines = [json.dumps(vars(done)) for done in self.done.values()]
        self._path.write_text("\n".join([self._key, *lines]) + "\n", encoding="utf-8")

    def add(self, done: Done) -> None:
        """Keep what came of a job that has not failed."""
        if not done.failed:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(vars(done)) + "\n")

    def remove(self) -> None:
        """Remove the file: everything is computed."""
        self._path.unlink(missing_ok=True)


def hash_of_files(*places: str) -> str:
    """Return a hash of files and of all files in folders, by their paths in the repository."""
    digest = hashlib.blake2b(digest_size=8)
    for place in places:
        for path in sorted((ROOT / place).rglob("*")) or [ROOT / place]:
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def prepare_cache(*, is_new: bool) -> None:
    """Use a cache of the freeze's own: kernels compiled of this very code, and nothing else of an earlier call.

    numba does not see when a constant or function of another file changes; and an environment from a cache would hide
    that it would come out differently today.
    """
    cache = STATE / f"cache-{hash_of_files(*CODE)}"
    for path in STATE.glob("cache-*"):
        if path != cache:
            shutil.rmtree(path)
    if is_new and cache.exists():
        for path in cache.iterdir():
            if path.name != "numba":
                shutil.rmtree(path) if path.is_dir() else path.unlink()
    os.environ["GSLCOSIM_CACHE"] = str(cache)
    os.environ.pop("NUMBA_CACHE_DIR", None)
    # Many processes start: without bytecode each would compile every module again.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    # Errors of the command line are wrapped to it.
    os.environ["COLUMNS"] = "80"


def compute_all(jobs: Sequence[Job], *, tell: Callable[[Done], None]) -> list[Done]:
    """Compute jobs with two workers; `tell` is called for each as it ends.

    Raises:
        KeyboardInterrupt: after the jobs under way have ended.
    """
    found: list[Done] = []
    todo = [job.name for job in reversed(jobs)]
    context = multiprocessing.get_context("spawn")
    with futures.ProcessPoolExecutor(N_WORKERS, mp_context=context, initializer=_ignore_interrupts) as pool:
        # No more than are computed at a time, so that nothing else is begun after Ctrl-C.
        running: set[futures.Future[Done]] = set()
        try:
            while todo or running:
                while todo and len(running) < N_WORKERS:
                    running.add(pool.submit(compute, todo.pop()))
                done, running = futures.wait(running, return_when=futures.FIRST_COMPLETED)
                for future in done:
                    found.append(future.result())
                    tell(found[-1])
        except KeyboardInterrupt:
            print("Interrupted: the jobs under way end first; the same command goes on.", file=sys.stderr)
            raise
    return found


# --- the commands ----------------------------------------------------------------------------------------------------


def chosen_jobs(patterns: Sequence[str]) -> list[Job]:
    """Return the jobs whose name is like one of the patterns or begins with it; all where there is none."""
    return [job for job in all_jobs() if not patterns or any(_is_like(job.name, pattern) for pattern in patterns)]


def comparable_jobs(jobs: list[Job], frozen: dict[str, str], here: dict[str, str]) -> list[Job]:
    """Return the jobs that come out the same with two sets of versions."""
    if not differing(frozen, here):
        return jobs
    # Python words some errors of the command line itself.
    return [job for job in jobs if job.is_portable and (frozen["python"] == here["python"] or job.name != "error")]


def _is_like(name: str, pattern: str) -> bool:
    return fnmatch.fnmatch(name, pattern) or name == pattern or name.startswith(f"{pattern.rstrip('/')}/")


def run(jobs: list[Job], versions: dict[str, str], *, may_continue: bool) -> tuple[list[Done], float]:
    """Compute jobs, showing how far it is; go on where an interrupted freeze was, where that may be."""
    partial = Partial(STATE / "partial.jsonl", versions) if may_continue else None
    known = partial.done if partial else {}
    prepare_cache(is_new=partial is None or partial.is_new)
    if partial:
        partial.begin()
    done = [known[job.name] for job in jobs if job.name in known]
    if done:
        print(f"Going on: {len(done)} of {len(jobs)} jobs were computed before.", file=sys.stderr)
    began_s = time.monotonic()
    columns = (TextColumn("{task.description:40}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("freeze", total=len(jobs), completed=len(done))
        n_done = len(done)

        def tell(each: Done) -> None:
            nonlocal n_done
            n_done += 1
            if partial:
                partial.add(each)
            bar.update(task, advance=1, description=each.job)
            if each.failed:
                bar.print(f"FAILED {each.job}: {each.failed}")
            if bar.disable and n_done % 10 == 0:
                print(f"{n_done} of {len(jobs)} jobs, {time.monotonic() - began_s:.0f} s", file=sys.stderr)

        done += compute_all([job for job in jobs if job.name not in known], tell=tell)
    if partial and not any(each.failed for each in done):
        partial.remove()
    return done, time.monotonic() - began_s


def write(arguments: argparse.Namespace) -> int:
    """Compute and write; return the exit code."""
    versions = installed_versions()
    jobs = chosen_jobs(arguments.only)
    frozen = Frozen(versions)
    if arguments.only and arguments.frozen.exists():
        frozen = Frozen.load(arguments.frozen)
        if reported := differing(frozen.versions, versions):
            print(f"{arguments.frozen.name} was made with other versions ({reported}): write it as a whole.")
            return 2
    done, wall_s = run(jobs, versions, may_continue=not arguments.only)
    failed = {each.job: each.failed for each in done if each.failed}
    for job in jobs:
        for old in [name for name in frozen.entries if job.holds(name)]:
            del frozen.entries[old]
        frozen.skipped.pop(job.name, None)
    for each in done:
        frozen.entries |= each.entries
        if each.skipped:
            frozen.skipped[each.job] = each.skipped
    _report({"failed": failed, "skipped": frozen.skipped}, done, wall_s, arguments)
    if failed:
        return 1
    frozen.save(arguments.frozen)
    print(f"Wrote {len(frozen.entries)} entries to {arguments.frozen}.", file=sys.stderr)
    return 0


def check(arguments: argparse.Namespace) -> int:
    """Compute and compare; return the exit code: 0 where nothing differs."""
    if not arguments.frozen.is_file():
        print(f"{arguments.frozen}: expected the file of `make freeze`, found none. Run that first.", file=sys.stderr)
        return 2
    versions, frozen = installed_versions(), Frozen.load(arguments.frozen)
    reported = differing(frozen.versions, versions)
    jobs = comparable_jobs(chosen_jobs(arguments.only), frozen.versions, versions)
    if reported:
        names = ", ".join(job.name for job in jobs) or "nothing of this"
        sentence = f"{arguments.frozen.name} was made with other versions ({reported}), so only {names} is compared."
        print(sentence, file=sys.stderr)
    done, wall_s = run(jobs, versions, may_continue=not arguments.only)
    now = {name: entry for each in done for name, entry in each.entries.items()}
    skipped = {each.job: each.skipped for each in done if each.skipped}
    failed = {each.job: each.failed for each in done if each.failed}
    missing = {*skipped, *failed}
    # What belongs to no job any more is gone too, where everything was computed.
    is_all = not arguments.only and not reported
    compared = {
        name: entry
        for name, entry in frozen.entries.items()
        if any(job.holds(name) and job.name not in missing for job in jobs)
        or (is_all and not any(job.holds(name) for job in jobs))
    }
    new = sorted(now.keys() - frozen.entries.keys())
    outcome = {"differs": differences(compared, now), "failed": failed, "skipped": skipped, "new": new}
    _report(outcome, done, wall_s, arguments)
    return 1 if outcome["differs"] or failed else 0


def _report(outcome: dict[str, Any], done: list[Done], wall_s: float, arguments: argparse.Namespace) -> None:
    n_entries = sum(len(each.entries) for each in done)
    cost = {"wall_s": round(wall_s), "cpu_s": round(sum(each.cpu_s for each in done)), "n_entries": n_entries}
    if arguments.json:
        print(json.dumps({**outcome, **cost}, indent=2))
        return
    for name, text in outcome.get("differs", {}).items():
        print(f"DIFFERS {name}: {text}")
    for name, text in outcome["failed"].items():
        print(f"FAILED  {name}: {text}")
    for name, reason in outcome["skipped"].items():
        print(f"skipped {name}: {reason}")
    if outcome.get("new"):
        print(f"new     {', '.join(outcome['new'][:20])}: not frozen yet, `make freeze` adds what is new")
    if arguments.slowest:
        for each in sorted(done, key=lambda each: -each.cpu_s)[: arguments.slowest]:
            print(f"{each.cpu_s:7.1f} s of a processor, {each.wall_s:6.1f} s: {each.job}")
    verdict = ""
    if "differs" in outcome:
        n = len(outcome["differs"]) + len(outcome["failed"])
        verdict = f"{n} differ or failed. " if n else "Nothing differs. "
    print(f"{verdict}{n_entries} entries in {cost['wall_s']} s, {cost['cpu_s']} s of processors.")


def main() -> int:
    """Carry out a command; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=["write", "check", "list"], help="list names the jobs")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="PATTERN", help="only jobs like this, for example run/tiny_room error"
    )
    parser.add_argument("--frozen", type=Path, default=FROZEN, metavar="FILE", help="another file than frozen.json")
    parser.add_argument("--slowest", type=int, default=0, metavar="N", help="name the N jobs that cost most")
    parser.add_argument("--json", action="store_true", help="print what came of it as JSON")
    arguments = parser.parse_args()
    arguments.frozen = arguments.frozen.resolve()
    os.chdir(ROOT)
    if arguments.action == "list":
        print("\n".join(job.name for job in chosen_jobs(arguments.only)))
        return 0
    if not chosen_jobs(arguments.only):
        parser.error(f"--only: expected the name of a job or a pattern, was {' '.join(arguments.only)}; see `list`")
    STATE.mkdir(exist_ok=True)
    with (STATE / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            parser.error("expected no other freeze of this checkout at the same time, found one that is running")
        try:
            return (write if arguments.action == "write" else check)(arguments)
        except KeyboardInterrupt:
            return 130


if __name__ == "__main__":
    sys.exit(main())
