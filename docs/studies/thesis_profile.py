"""The thesis's comparison flown again: as it was flown, and fairly, with the differences that its statements are about.

The profile `paper` repeats the flights of GSL-Bench (Erwich 2023) as its code has them: search at 4 m, success by the
horizontal distance, legs of 3 s whatever their length, gas and wind at twice their speed, no dead band, and a random
walker that holds for 0.1 s where the others hold for 2 s (in rooms 3 to 6; in 1 and 2 it held for 2 s as well). The
profile `fair` searches at the source's height, judges in space, gives all the same hold and speed, and plays the gas
at its own speed. Rooms, sources and the nine starts are the thesis's; racks are drawn by our own seeds.

    python docs/studies/thesis_profile.py --repetitions 4          # fly what is missing, then print the tables
    python docs/studies/thesis_profile.py --profiles paper --environments 1 --repetitions 1
    python docs/studies/thesis_profile.py --table                  # only print what has been flown

With `--published DIR` (environments of GSL-Bench with their gas data) rooms 1, 3 and 5 of the profile `paper` have the
published gas frames instead of ours.
"""

import argparse
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from paired_flights import Row, fly_fields, fly_missing, interval_text, read_rows

from gslcosim.scenario.bundled import bundled_scenarios

STARTS_M = [(x, y) for y in (3.0, 7.5, 12.0) for x in (3.0, 7.5, 12.0)]
# Each entry: the bundled agent, its parameters as the thesis's code has them, and its hold in the paper's profile.
PAPER_HOLD_S = 2.0
WALKER_HOLD_S = 0.1
ENTRIES: dict[str, tuple[str, dict[str, Any]]] = {
    "e_coli": ("e_coli", {"eps": 0.0, "wall_margin_m": 0.5, "declares": False}),
    "dung_beetle": ("dung_beetle", {"heading_memory": True}),
    "random_walker": ("random_walker", {}),
    "random_walker_quick": ("random_walker", {"hold_s": WALKER_HOLD_S}),
    "e_coli_3d": ("e_coli_3d", {"eps": 0.0, "declares": False}),
}
LEG_S = 3.0


@dataclass(frozen=True, order=True)
class Trial:
    """One flight: which profile, room, start, repetition and entry; `published` where the gas is GSL-Bench's."""

    profile: str
    environment: int
    start: int
    repetition: int
    entry: str
    published: str = ""


def main() -> None:
    """Fly what is missing and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--profiles", nargs="+", default=["paper", "fair"], choices=["paper", "fair"])
    parser.add_argument("--environments", nargs="+", type=int, default=[1, 2, 3, 4, 5, 6])
    parser.add_argument("--entries", nargs="+", default=list(ENTRIES), choices=list(ENTRIES))
    parser.add_argument("--repetitions", type=int, default=4)
    parser.add_argument("--published", default="", help="folder with GSL-Bench's environments, for rooms 1, 3 and 5")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--results", type=Path, default=Path("runs/thesis_profile.jsonl"))
    parser.add_argument("--table", action="store_true", help="fly nothing, print what there is")
    arguments = parser.parse_args()
    trials = [
        Trial(profile, environment, start, repetition, entry, arguments.published)
        for profile in arguments.profiles
        for environment in arguments.environments
        for start in range(len(STARTS_M))
        for repetition in range(arguments.repetitions)
        for entry in arguments.entries
    ]
    rows = read_rows(arguments.results, Trial)
    if not arguments.table:
        rows = fly_missing(trials, fly_one, n_jobs=arguments.jobs, path=arguments.results)
    flown = {trial: rows[trial] for trial in trials if trial in rows}
    sys.stdout.write(rates(flown, arguments.entries) + "\n" + statements(flown))


def fly_one(trial: Trial) -> Row:
    """Fly one trial; all entries of a room, start and repetition meet the same gas and the same noise."""
    seed = 1 + 1000 * trial.environment + 100 * trial.start + trial.repetition
    return fly_fields(scenario_of(trial), seed=seed)


def scenario_of(trial: Trial) -> dict[str, Any]:
    """Return the scenario of a trial as plain values."""
    fields = yaml.safe_load(bundled_scenarios()[f"gsl_bench_{trial.environment}"].read_text())
    python, parameters = ENTRIES[trial.entry]
    is_paper = trial.profile == "paper"
    fields["gas"]["tape"] = True
    (source,) = fields["gas"]["sources"]
    height_m = 4.0 if is_paper else source["position_m"][2]
    x_m, y_m = STARTS_M[trial.start]
    (agent,) = fields["agents"]
    agent["start"] = {"python": python}
    agent["parameters"] = {**parameters, **({"leg_s": LEG_S} if is_paper else {})}
    agent["vehicle"] = {
        "model": "holonomic", "start_m": [x_m, y_m, 0.2], "search_height_m": height_m, "hold_s": PAPER_HOLD_S,
        "avoidance": "2d",
    }  # fmt: skip
    agent["sensors"] = [{"model": "tgs2600", "name": "nose"}, {"model": "anemometer", "name": "wind"}]
    is_in_plane = is_paper and trial.entry != "e_coli_3d"
    fields["referee"] = {
        "success": {"within_m": 1.0, "of": "source", "horizontal": is_in_plane},
        "stop": {"time_limit_s": 300, "on_collision": False},
    }
    fields["recording"] = {"enabled": False}
    if is_paper:
        play_at_double_speed(fields, trial)
    return fields


def play_at_double_speed(fields: dict[str, Any], trial: Trial) -> None:
    """Make gas and wind run twice as fast: published frames at half their period, or all rates of ours doubled."""
    gas, wind = fields["gas"], fields["wind"]
    room = Path(trial.published) / f"{trial.environment:03d}" if trial.published else None
    if room is not None and room.is_dir():
        frames = next(path for path in sorted((room / "gas_data").iterdir()) if path.is_dir())
        gas.update({"model": "playback", "playback": {"folder": str(frames), "period_s": 0.5, "loop": True}})
        gas.pop("tape")
        gas["warm_up_s"] = 150  # frame 300, where the thesis begins
        fields["environment"] = {"gsl_bench": str(room)}
        return
    wind["inlet_velocity_m_s"] = [2 * value for value in wind["inlet_velocity_m_s"]]
    wind["end_time_s"] /= 2
    gas["sources"][0]["filaments_per_s"] *= 2
    gas.update({"growth_m2_s": 0.002, "eddy_diffusivity_m2_s": 0.004, "warm_up_s": gas["warm_up_s"]})


def rates(rows: dict[Trial, Row], entries: Iterable[str]) -> str:
    """Return success by room and entry, with intervals over starts and repetitions."""
    entries = list(entries)
    lines = ["| profile | room | n | " + " | ".join(entries) + " |", "|---|---|---|" + "---|" * len(entries)]
    for profile, environment in sorted({(trial.profile, trial.environment) for trial in rows}):
        cells, n = [], 0
        for entry in entries:
            values = [
                100.0 * row["success"]
                for trial, row in rows.items()
                if (trial.profile, trial.environment, trial.entry) == (profile, environment, entry)
            ]
            n = max(n, len(values))
            cells.append(interval_text(values, signed=False) if values else "")
        lines.append(f"| {profile} | {environment} | {n} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


# What the thesis says, as differences of success between two entries over all rooms, or over some of them.
Choice = Callable[[Trial], bool]
STATEMENTS: list[tuple[str, str, str, Choice]] = [
    ("the random walker as flown beats E. coli", "walker", "e_coli", lambda trial: True),
    ("a random walker with the same hold beats E. coli", "random_walker", "e_coli", lambda trial: True),
    ("the dung beetle beats E. coli where the source is at (5, 1)", "dung_beetle", "e_coli",
     lambda trial: trial.environment % 2 == 1),
    ("the dung beetle beats E. coli where the source is at (1, 10)", "dung_beetle", "e_coli",
     lambda trial: trial.environment % 2 == 0),
    ("3-D E. coli is worse than 2-D E. coli", "e_coli", "e_coli_3d", lambda trial: True),
]  # fmt: skip


def statements(rows: dict[Trial, Row]) -> str:
    """Return what becomes of the thesis's statements: paired differences in success with intervals."""
    lines = ["| profile | statement | pairs | difference, points | holds |", "|---|---|---|---|---|"]
    for profile in sorted({trial.profile for trial in rows}):
        for text, better, worse, choice in STATEMENTS:
            differences = paired(rows, profile, better, worse, choice)
            if differences:
                told = interval_text(differences)
                low, high = (float(part.strip("+]")) for part in told.split("[")[1].split(", "))
                verdict = "yes" if low > 0 else "no" if high < 0 else "undecided"
                lines.append(f"| {profile} | {text} | {len(differences)} | {told} | {verdict} |")
    return "\n".join(lines) + "\n"


def paired(rows: dict[Trial, Row], profile: str, better: str, worse: str, choice: Choice) -> list[float]:
    """Return the differences in success [points] on the same room, start and repetition."""
    found = []
    for trial, row in rows.items():
        if trial.profile != profile or trial.entry != worse or not choice(trial):
            continue
        # As flown: quick from room 3 on.
        name = ("random_walker" if trial.environment <= 2 else "random_walker_quick") if better == "walker" else better
        other = rows.get(Trial(profile, trial.environment, trial.start, trial.repetition, name, trial.published))
        if other is not None:
            found.append(100.0 * (float(other["success"]) - float(row["success"])))
    return list(np.array(found, float))


if __name__ == "__main__":
    main()
