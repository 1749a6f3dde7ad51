"""Whatever somebody types or writes into a scenario, the answer is a documented exit code and no traceback.

Calls come from the examples of all commands, scenarios from those that are bundled; both are changed at random, from a
seed that a failure prints. A few seconds of it are part of every test run; `make soak` goes on for minutes. Commands
that only read are run, all others only read their words.
"""

import contextlib
import copy
import io
import json
import shlex
import time

import pytest

from gslcosim.base.bundled import bundled_scenarios
from gslcosim.base.errors import ExitCode
from gslcosim.base.rng import stream
from gslcosim.cli.arguments import iterate_commands
from gslcosim.cli.main import list_groups, run_command
from gslcosim.scenario.serialization import read_yaml

GROUPS = list_groups()

LENGTHS = [pytest.param(3.0, marks=pytest.mark.slow), pytest.param(240.0, marks=pytest.mark.soak)]
# They change nothing, start no program, and end by themselves.
READING = ("validate", "list", "runs", "compare", "ps")
WORDS = (
    "", " ", "-", "--", "-1", "0", "1e999", "nan", "-inf", "9" * 5000, "x" * 5000, "x/" * 3000, "\x1b]0;owned\x07",
    "\x1b[2J", "[red]", "ä", "場", "\udcff", "\u202e", "/dev/null", "/dev", "/proc/self/mem", "..", "~nobody_here/x",
    "a=b", "=", "a=", "[", "{", "a[0]=1", "seed=0x" + "f" * 4000, "*", "%s", "{0}", "$(id)", "--json", "--help",
    "--runs-dir", "--set", "--where", "--sort", "--limit", "tiny_room", "runs", "yes", "null", "1:2:3", "1x1", "0x0",
)  # fmt: skip
VALUES = (
    None, True, -1, 0, 0.5, 1e300, 10**30, "", "x", "random", "a\0b", "x" * 5000, "~nobody_here/x", "/dev/zero", "..",
    "\x1b[2J", "0x" + "f" * 4000, [], {}, [[]], [{}], [None], {"": None}, {"a": {}}, [1, 2, 3], ["x"] * 3,
)  # fmt: skip


def examples():
    """Return the calls in the examples of all commands, as words without the program's name."""
    lines = [line.strip() for _, command in iterate_commands(GROUPS) for line in command.examples.splitlines()]
    calls = [shlex.split(line.partition(" | ")[0].partition("  ")[0], comments=True) for line in lines]
    return [words[1:] for words in calls if words[:1] == ["gslcosim"]]


def changed_words(rng, words, calls):
    """Return a call with some words replaced, taken away, repeated, or exchanged."""
    words = list(words)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(words) + 1))
        kind = int(rng.integers(5))
        if kind == 0:
            words[at : at + 1] = [WORDS[int(rng.integers(len(WORDS)))]]
        elif kind == 1:
            words.insert(at, WORDS[int(rng.integers(len(WORDS)))])
        elif kind == 2:
            del words[at : at + 1]
        elif kind == 3:
            words[at:at] = words[at : at + 2]
        else:
            other = calls[int(rng.integers(len(calls)))]
            words[at : at + 1] = other[int(rng.integers(len(other))) :][:2]
    return words


def places_in(value, at=()):
    """Yield the keys and indices that lead to each value of a tree."""
    yield at
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inner:
        yield from places_in(item, (*at, key))


def changed_values(rng, value):
    """Return a tree with one of its values replaced, or taken away."""
    places = list(places_in(value))[1:]
    if not places:
        return value
    *path, last = places[int(rng.integers(len(places)))]
    value = copy.deepcopy(value)
    block = value
    for key in path:
        block = block[key]
    if rng.random() < 0.2:
        del block[last]
    else:
        block[last] = VALUES[int(rng.integers(len(VALUES)))]
    return value


def check_call(words, call, where):
    """Run a command, or only read its words, and hold what comes of it against what every command promises."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), contextlib.suppress(SystemExit):
        code = run_command(words, call)
        text = f"{where}: {words!r:.2000} returned {code}:\n{err.getvalue()[-2000:]}"
        assert code in set(ExitCode) - {ExitCode.INTERRUPTED}, text
        assert "Traceback" not in err.getvalue(), text
        assert "\x1b" not in out.getvalue() + err.getvalue(), text
        assert code not in (ExitCode.USAGE, ExitCode.FAULT) or err.getvalue().strip(), text


@pytest.mark.parametrize("length_s", LENGTHS)
def test_any_call_ends_with_a_documented_exit_code(tmp_path, monkeypatch, length_s):
    monkeypatch.chdir(tmp_path)
    calls, seed = examples(), 0
    assert len(calls) > 80
    end_s = time.monotonic() + length_s
    while time.monotonic() < end_s:
        seed += 1
        rng = stream(seed, "soak.calls")
        words = changed_words(rng, calls[int(rng.integers(len(calls)))], calls)
        is_run = words[:1] and words[0] in READING and "remove" not in words
        check_call(words, None if is_run else lambda _: 0, f"seed {seed}")


@pytest.mark.parametrize("length_s", LENGTHS)
def test_any_scenario_is_valid_or_reported(tmp_path, length_s):
    bundled, seed = bundled_scenarios(), 0
    names = sorted(bundled)
    path = tmp_path / "changed.yaml"
    end_s = time.monotonic() + length_s
    while time.monotonic() < end_s:
        seed += 1
        rng = stream(seed, "soak.scenarios")
        name = names[int(rng.integers(len(names)))]
        values = read_yaml(bundled[name].read_text(encoding="utf-8"), source=name).values
        for _ in range(int(rng.integers(1, 4))):
            values = changed_values(rng, values)
        path.write_text(json.dumps(values), encoding="utf-8")
        check_call(["validate", str(path)], None, f"seed {seed}, {name}")
