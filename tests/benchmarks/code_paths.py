"""Returns on the paths of the code: how often a reader who follows a path comes back to a file that was left.

`python tests/benchmarks/code_paths.py` runs `tiny_room` in one process and prints, for each path, its returns and the
files that it visits; `--list` prints each return too. The paths:

- `up`: from `run_scenario(loaded)` to the first step of a service, the room being in the cache;
- `up, new room`: the same with a seed that no room in the cache has, so that the room is built;
- `command`: from the bytes of an agent's command to the thrust, that is all calls of `AgentSession.handle` and of
  `WorldCore.step` in a run;
- `reading`: from a puff to a ppm, that is all calls of `FieldsCore.step` and of `SensingCore.step` in a run.

How it counts: where a function calls one of another file, the reader leaves the caller's file and returns to it, which
is one return for each pair of caller and callee, however often they meet. Own code counts alone, by files of the
checkout that are not under `.venv`. Three things are no visits: the words that all files share (`base`, `contract` and
`scenario` of the package `gslcosim`), what an import runs, and, on the way to the first step, whatever services and
agents do within (a call into one of their files is a return, those that follow inside are its own path). Calls that
each service answers, such as `core.reset`, are as many returns as services; the last figure, of places, counts them
once. Commit c7a8937f has 122 returns in 41 files for `up`, 96 places. Compiled kernels do not show in profiles: a call
of one is no visit.
"""

# ruff: noqa: T201 - this is a script

import argparse
import secrets
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from gslcosim.runtime.run import run_scenario
from gslcosim.scenario.loader import load_scenario

ROOT = Path(__file__).resolve().parents[2]
SCENARIO = ROOT / "scenarios" / "tiny_room.yaml"
WORDS = ("gslcosim/base/", "gslcosim/contract/", "gslcosim/scenario/")
CLOSED = ("services/", "agents/", "extensions/")


@dataclass
class Trace:
    """Returns of a path, filled while it is the profiler of a run.

    Attributes:
        begins: Qualified names of the functions under which calls count.
        ends: The function at whose first call the path ends; absent: with the run.
        closed: Folders whose inside does not count.
    """

    begins: tuple[str, ...]
    ends: str | None = None
    closed: tuple[str, ...] = ()
    returns: dict[tuple[CodeType, CodeType], None] = field(default_factory=dict)
    files: set[str] = field(default_factory=set)
    _stack: list[tuple[CodeType, bool]] = field(default_factory=list)
    _names: dict[CodeType, str | None] = field(default_factory=dict)

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if (name := self._file(code)) is None:
            return
        if event == "return" and self._stack and self._stack[-1][0] is code:
            self._stack.pop()
        elif event == "call":
            caller, is_counted = self._stack[-1] if self._stack else (None, False)
            if is_counted:
                self.files.add(name)
                if caller is not None and caller.co_filename != code.co_filename:
                    self.returns[caller, code] = None
            is_counted = is_counted or code.co_qualname in self.begins
            is_closed = name.startswith(self.closed) or code.co_name == "<module>"
            self._stack.append((code, is_counted and not is_closed))
            if code.co_qualname == self.ends:
                sys.setprofile(None)

    def count_places(self) -> int:
        """Return the number of returns, those that several services or agents answer from one place counted once."""
        places = {
            (caller, name.partition("/")[0], callee.co_name) if name.startswith(CLOSED) else (caller, callee)
            for caller, callee in self.returns
            if (name := self._file(callee)) is not None
        }
        return len(places)

    # Relative to the checkout; None for code that is not own, and for words.
    def _file(self, code: CodeType) -> str | None:
        if code not in self._names:
            path = Path(code.co_filename)
            name = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else "."
            self._names[code] = None if name.startswith((".", *WORDS)) else name
        return self._names[code]


def trace_run(trace: Trace, **changes: Any) -> None:
    """Run the scenario, its layout with changes, under the profiler."""
    loaded = load_scenario(SCENARIO)
    if changes:
        environment = loaded.scenario.environment
        assert environment.layout is not None
        layout = environment.layout.model_copy(update=changes)
        scenario = loaded.scenario.model_copy(update={"environment": environment.model_copy(update={"layout": layout})})
        loaded = type(loaded)(scenario=scenario, path=loaded.path, directory=loaded.directory, text=loaded.text)
    with tempfile.TemporaryDirectory() as folder:
        sys.setprofile(trace)
        try:
            run_scenario(loaded, runs_dir=Path(folder), processes="one")
        finally:
            sys.setprofile(None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true", help="print each return")
    arguments = parser.parse_args()
    # The room and the kernels are in the cache afterwards.
    trace_run(Trace(begins=()))
    start = Trace(begins=("run_scenario",), ends="Stepper.step", closed=CLOSED)
    paths: dict[str, tuple[Trace, dict[str, Any]]] = {
        "up": (start, {}),
        "up, new room": (Trace(start.begins, start.ends, start.closed), {"seed": secrets.randbelow(1 << 31)}),
        "command": (Trace(begins=("AgentSession.handle", "WorldCore.step")), {}),
        "reading": (Trace(begins=("FieldsCore.step", "SensingCore.step")), {}),
    }
    for name, (trace, changes) in paths.items():
        trace_run(trace, **changes)
        n_places = trace.count_places()
        print(f"{name}: {len(trace.returns)} returns in {len(trace.files)} files, from {n_places} places")
        for caller, callee in trace.returns if arguments.list else ():
            places = (f"{Path(code.co_filename).relative_to(ROOT)} {code.co_qualname}" for code in (caller, callee))
            print("  ", " -> ".join(places))


if __name__ == "__main__":
    main()
