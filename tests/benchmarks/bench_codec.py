"""Print what it costs to make, write and read messages, beside the same with all checks.

Run with `python tests/benchmarks/bench_codec.py [--n 5] [--json]`; both ways take turns, each figure is the least of
all. Writing knows no checks but that for finite numbers: beside it stands msgpack's own, of fields that are plain maps.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgpack
import msgspec

from gslcosim.contract import codec
from gslcosim.contract.messages import Message
from gslcosim.contract.record import build_unchecked_constructor

sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "_build"))
from contract_examples import EXAMPLES

MESSAGES = ("bodies_flying", "samples", "observation", "score", "command_waypoint")
CALLS = 2000


def ways_of(message: Message) -> dict[str, tuple[Callable[[], object], Callable[[], object]]]:
    """Return for each task how our services do it, and how it is done with all checks."""
    kind: Any = type(message)
    fields, payload, quick = msgspec.structs.asdict(message), codec.encode(message), build_unchecked_constructor(kind)
    plain: Any = message.model_dump()
    return {
        "make": (lambda: quick(**fields), lambda: kind(**fields)),
        "write": (lambda: codec.encode_finite(message), lambda: msgpack.packb(plain, use_bin_type=True)),
        "read": (lambda: codec.decode_trusted(kind, payload), lambda: codec.decode(kind, payload)),
    }


def least_us(calls: Mapping[str, Callable[[], object]], n_turns: int) -> dict[str, float]:
    """Return the least time of a call [us], of turns in which all of them take part."""
    least = dict.fromkeys(calls, float("inf"))
    for _ in range(n_turns):
        for name, call in calls.items():
            started = time.perf_counter()
            for _ in range(CALLS):
                call()
            least[name] = min(least[name], (time.perf_counter() - started) / CALLS * 1e6)
    return least


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=5, help="turns")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args()
    figures: dict[str, dict[str, dict[str, float]]] = {}
    for name in MESSAGES:
        for task, (ours, checked) in ways_of(EXAMPLES[name]).items():
            took = least_us({"ours_us": ours, "checked_us": checked}, options.n)
            figures.setdefault(name, {})[task] = took
    if options.json:
        sys.stdout.write(json.dumps(figures, indent=2) + "\n")
        return
    sys.stdout.write("message            task   ours    beside it   ratio\n")
    for name, tasks in figures.items():
        for task, took in tasks.items():
            ours, checked = took["ours_us"], took["checked_us"]
            sys.stdout.write(f"{name:18} {task:6} {ours:4.1f} us  {checked:6.1f} us   {checked / ours:5.1f}\n")


if __name__ == "__main__":
    main()
