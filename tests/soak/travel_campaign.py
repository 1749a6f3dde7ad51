"""Random runs replayed, gone on with at snapshots, and forked, and a table of what came of it: `make soak-travel`.

Every case draws a scenario of those that use each core with all its models, a seed, how often the state is kept, and
where it goes on. What is compared are digests, to the bit:

- replay: the run, from its `inputs.log` without agents, with another detail of recording;
- snapshots: the run, from a snapshot at a random time;
- forks: with nothing changed the run; with another seed, method or time limit the same fork flown from the start; with
  an event after it, the same fork replayed.
"""

import argparse
import contextlib
import io
import json
import random
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "end_to_end"))
sys.path.insert(0, str(Path(__file__).parents[1] / "shared"))

from real_runs import ROOT, UNRECORDED, fly_here
from snapshot_cases import CASES

from gslcosim.cli.main import main as command

KINDS = ("replay", "snapshots", "forks")
SCENARIOS = ROOT / "scenarios"
ALL_CASES = {
    **CASES,
    "event_wind": (SCENARIOS / "event_wind.yaml", ()),
    "event_door": (SCENARIOS / "event_door.yaml", ("--set", "referee.stop.time_limit_s=20")),
}
CHANGES = ("nothing", "seed", "method", "time limit", "event")


@dataclass(frozen=True)
class Trial:
    """What came of one case: what was drawn, where it went on, and whether it is as it has to be."""

    kind: str
    case: str
    change: str
    tick: int
    is_equal: bool
    took_s: float
    text: str


def called(*words: str) -> tuple[int, dict, str]:
    """Carry out a command in this process; return its exit code, what came of it, and what was said."""
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        exit_code = command([*words, "--json"])
    text = output.getvalue()
    return exit_code, json.loads(text) if text.startswith("{") else {}, errors.getvalue()


def trial(kind: str, number: int, seed: int, folder: Path) -> Trial:
    """Fly a random case, travel in it, and compare."""
    rng = random.Random(f"{kind} {seed} {number}")
    case = rng.choice(list(ALL_CASES))
    scenario, changes = ALL_CASES[case]
    every_s = rng.randint(3, 30) / 10
    began_s = time.monotonic()
    keeping = () if kind == "replay" else ("--set", f"snapshots.every_s={every_s}")
    past = fly_here(scenario, folder / "past", *changes, "--seed", str(rng.randrange(1000)), *keeping)
    if past.run_dir is None or past.result.get("digest") is None:
        return Trial(kind, case, "", -1, False, time.monotonic() - began_s, past.errors)
    tick = rng.randrange(1, past.result["ticks"])
    travel = {"replay": replay, "snapshots": go_on, "forks": fork}[kind]
    change, is_equal, text = travel(past, tick, rng, folder)
    return Trial(kind, case, change, tick, is_equal, time.monotonic() - began_s, text)


def replay(past, tick: int, rng: random.Random, folder: Path) -> tuple[str, bool, str]:
    """Repeat a run as a whole."""
    del tick
    gas_every_s = rng.choice(["0.1", "0.5", "2"])
    words = ("--gas-every", gas_every_s, "--no-recording", "--runs-dir", str(folder / "again"))
    exit_code, again, errors = called("replay", str(past.run_dir), *words)
    return (
        f"gas every {gas_every_s} s",
        exit_code == 0 and again.get("comparison", {}).get("divergence") is None,
        errors,
    )


def go_on(past, tick: int, rng: random.Random, folder: Path) -> tuple[str, bool, str]:
    """Go on at the last snapshot before a tick."""
    del rng
    words = ("--from", f"{tick / 10:g}", "--no-recording", "--runs-dir", str(folder / "again"))
    exit_code, again, errors = called("replay", str(past.run_dir), *words)
    used = again.get("comparison", {}).get("snapshot_tick")
    return (
        f"at {used}" if used is not None else "from the start",
        exit_code == 0 and again.get("digest") == past.result["digest"] and not errors,
        errors,
    )


def fork(past, tick: int, rng: random.Random, folder: Path) -> tuple[str, bool, str]:
    """Fork a run at a tick, with a change or none."""
    change = rng.choice(CHANGES)
    at_s = f"{tick / 10:g}"
    limit_s = max(tick / 10 + rng.randint(1, 5), last_event_s(past))
    options = {
        "nothing": (),
        "seed": ("--set", "agents[0].seed=4711"),
        "method": ("--agent", f"{first_agent(past)}=spiral"),
        "time limit": ("--set", f"referee.stop.time_limit_s={limit_s:g}"),
        "event": ("--event", f"{{what: sensor_sticks, at_s: {tick / 10 + 0.5:g}, agent: {first_agent(past)}, "
                             f"sensor: {first_sensor(past)}}}"),
    }[change]  # fmt: skip
    if change == "event" and tick / 10 + 0.5 > time_limit_s(past):
        change, options = "nothing", ()
    words = ("fork", str(past.run_dir), "--at", at_s, "--in-process", *UNRECORDED, *options)
    exit_code, one, errors = called(*words, "--runs-dir", str(folder / "one"))
    if exit_code not in (0, 1):
        return change, False, errors
    if change == "nothing":
        return change, one["digest"] == past.result["digest"], errors
    if change == "event":
        again_code, _, text = called(
            "replay", str(run_in(folder / "one")), "--no-recording", "--runs-dir", str(folder / "two")
        )
        return change, again_code == 0, text
    _, other, text = called(*words, "--from-start", "--runs-dir", str(folder / "two"))
    return change, one["digest"] == other.get("digest") is not None, errors + text


def run_in(folder: Path) -> Path:
    """Return the one run in a folder."""
    (run_dir,) = folder.glob("*/")
    return run_dir


def _scenario(past):
    from gslcosim.runtime.run_dir import RunDir

    return RunDir(past.run_dir).load_scenario()


def first_agent(past) -> str:
    """Return the name of the first agent of a run."""
    return _scenario(past).agents[0].name


def first_sensor(past) -> str:
    """Return the name of the first sensor of the first agent of a run."""
    return _scenario(past).agents[0].sensors[0].name


def last_event_s(past) -> float:
    """Return the time of the last event of a run that has one [s]: a scenario has no event after its end."""
    return max((event.at_s or 0.0 for event in _scenario(past).events), default=0.0)


def time_limit_s(past) -> float:
    """Return the time limit of a run [s]."""
    return _scenario(past).referee.stop.time_limit_s


def campaign(kind: str, n_trials: int, seed: int, *, tell=lambda trial: None) -> list[Trial]:
    """Return so many trials of a kind."""
    trials = []
    for number in range(n_trials):
        with tempfile.TemporaryDirectory() as scratch:
            trials.append(trial(kind, number, seed, Path(scratch)))
        tell(trials[-1])
    return trials


def table(trials: list[Trial]) -> str:
    """Return what came of trials, a line for each kind and what was changed."""
    lines = [f"{'kind':10} {'changed':12} {'cases':>6} {'scenarios':>10} {'equal':>6}   ticks"]
    groups = Counter((each.kind, each.change if each.kind == "forks" else "") for each in trials)
    for (kind, change), n in sorted(groups.items()):
        its = [each for each in trials if each.kind == kind and change in ("", each.change)]
        ticks = sorted(each.tick for each in its)
        n_scenarios, n_equal = len({each.case for each in its}), sum(each.is_equal for each in its)
        lines.append(f"{kind:10} {change:12} {n:6} {n_scenarios:10} {n_equal:6}   {ticks[0]} to {ticks[-1]}")
    lines.append(f"{sum(each.is_equal for each in trials)} of {len(trials)} are equal to the bit")
    return "\n".join(lines)


def main() -> None:
    """Print trials and their table; exit code 1 where one is not equal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=200, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    chosen = parser.parse_args()

    def tell(each: Trial) -> None:
        state = "equal" if each.is_equal else f"DIFFERENT {each.text}"
        sys.stderr.write(f"{each.kind} {each.case} at {each.tick}, {each.change}, {each.took_s:.1f} s: {state}\n")

    trials = [each for kind in chosen.kinds for each in campaign(kind, chosen.trials, chosen.seed, tell=tell)]
    sys.stdout.write(table(trials) + "\n")
    sys.exit(not all(each.is_equal for each in trials))


if __name__ == "__main__":
    main()
