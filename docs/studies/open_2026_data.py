"""Prints figures of the open comparison's study from the flights published beside it.

Run with `python docs/studies/open_2026_data.py`; nothing is flown. It prints, as Markdown: what the two reactive
methods declared in the whole suite, by distance, confidence and height of the source; what `source_map` declared there;
how often beliefs stay silent; tuned entries beside their defaults; the sweep at two speeds; and `surge_cast` with and
without the fit of a plume in seed D.
"""

import csv
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from open_2026 import GROUNDED, INDOORS, print_table
from scipy import special

from gslcosim_bench.report.number_formats import format_estimate, format_percent, format_three_digits
from gslcosim_bench.statistics.rates import wilson

FOLDER = Path(__file__).parent / "open_2026"
DATA = ("data", "data_c", "data_d")
SEEDS = {"seed_a": "A", "seed_b": "B", "seed_c": "C", "seed_d": "D"}
REACTIVE, TUNED = ("surge_cast", "casting"), ("infotaxis", "source_map")
WITH_FIT, WITHOUT_FIT = "surge_cast", "surge_cast_end"
OPEN_SEARCH_HEIGHT_M, INDOOR_SEARCH_HEIGHT_M = 1.1, 1.5

Row = Mapping[str, Any]
Unit = tuple[str, str, int, bool]


def read_flights() -> list[Row]:
    """Return the published flights of all seeds but for cases whose start no vehicle left."""
    rows = [row for name in DATA for row in pq.read_table(FOLDER / name / "trials.parquet").to_pylist()]
    grounded = {find_unit(row) for row in rows if GROUNDED in (row["warnings"] or "")}
    return [row for row in rows if find_unit(row) not in grounded]


def find_unit(row: Row) -> Unit:
    """Return the seed, case, repetition and kind of a flight: what all entries meet alike."""
    return SEEDS[row["results"]], row["case"], row["repetition"], row["is_control"]


def read_variants() -> dict[str, dict[Unit, Row]]:
    """Return the flights of entries with other parameters, by entry and by seed, case and repetition."""
    found: dict[str, dict[Unit, Row]] = {}
    with (FOLDER / "variants.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            unit = row["suite_seed"], row["case"], int(row["repetition"]), False
            found.setdefault(row["entry"], {})[unit] = row
    return found


def mcnemar(a: np.ndarray, b: np.ndarray) -> tuple[int, int, float]:
    """Return in how many pairs a alone and b alone succeeded, and McNemar's exact two-sided p."""
    only_a, only_b = int(np.sum(a & ~b)), int(np.sum(b & ~a))
    return only_a, only_b, min(1.0, 2.0 * float(special.bdtr(min(only_a, only_b), only_a + only_b, 0.5)))


def print_reactive(rows: Sequence[Row]) -> None:
    """Print declarations of the two reactive methods in the whole suite."""
    declared = [row for row in rows if row["declared"]]
    wrong = [row for row in declared if not row["success"]]
    n_close = sum(row["declared_error_in_plane_m"] < 2.0 for row in wrong)
    silent = [row for row in rows if not row["declared"]]
    no_gas = [row for row in rows if row["first_contact_s"] is None]
    n_silent_without = sum(row["first_contact_s"] is None for row in silent)
    within = ", ".join(
        f"{format_percent(sum(row['declared_error_in_plane_m'] < radius_m for row in declared) / len(rows))} % within "
        f"{radius_m:g} m"
        for radius_m in (0.5, 1.0, 2.0)
    )
    write(
        f"{len(rows)} runs of {' and '.join(REACTIVE)}: {len(declared)} declarations, {within}; {len(wrong)} wrong, "
        f"{n_close} of these by less than 2 m. {percent(rows, is_near)} % come within 1 m at any time. "
        f"{len(no_gas)} runs met no gas; of {len(silent)} silent runs {n_silent_without}."
    )
    bins = [(0.0, 0.1), (0.1, 0.5), (0.5, 0.9), (0.9, math.inf)]
    write_groups("confidence", declared, "declared_confidence", bins)
    for place in ("open ground", "room", "mixed"):
        here = [row for row in rows if find_place(row) == place]
        heights = [{**row, "height_m": find_height_m(row)} for row in here]
        write_groups(f"{place}, height over or below the nose [m]", heights, "height_m", [(0.0, 1.0), (1.0, math.inf)])
        write(f"{place}: {percent(here, is_near)} % come within 1 m at any time.")


def find_place(row: Row) -> str:
    """Return `room`, `mixed` or `open ground`."""
    return row["family"] if row["family"] in INDOORS else "open ground"


def find_height_m(row: Row) -> float:
    """Return how far the source is above or below the height of search [m]."""
    return abs(row["source_z_m"] - (INDOOR_SEARCH_HEIGHT_M if row["family"] in INDOORS else OPEN_SEARCH_HEIGHT_M))


def is_near(row: Row) -> bool:
    """Return whether the vehicle came within 1 m of the source at any time."""
    return row["time_within_1_m_s"] not in (None, "")


def print_source_map(rows: Sequence[Row]) -> None:
    """Print how early, how sure and how right the declarations of `source_map` in the whole suite are."""
    declared = [row for row in rows if row["declared"]]
    confidence = float(np.mean([row["declared_confidence"] for row in declared]))
    write(
        f"{len(rows)} runs of source_map: {len(declared)} declarations, half of them within {median_s(declared)} s, "
        f"mean confidence {confidence:.2f}, {percent(declared, is_found)} % right."
    )


def print_silence(rows: Sequence[Row]) -> None:
    """Print how many runs of two methods with a belief end without a declaration, and what it would have been."""
    silent = [row for row in rows if not row["declared"]]
    n_right = sum((row["belief_error_m"] or math.inf) < 1.0 for row in silent)
    write(
        f"{len(silent)} of {len(rows)} runs of infotaxis and particle_filter in seeds A and B are silent; the belief's "
        f"estimate at the end is within 1 m in {n_right}."
    )


def print_tuned(defaults: Sequence[Row], variants: Mapping[str, Mapping[Unit, Row]]) -> None:
    """Print success of tuned entries beside their defaults and beside surge-cast, in cases that all flew."""
    flown = {name: {find_unit(r): r for r in defaults if r["entry"] == name} for name in (*TUNED, "surge_cast")}
    lines: list[Sequence[object]] = []
    tests: list[str] = []
    for name in TUNED:
        tuned = variants[f"{name}_tuned"]
        for label, seeds in (("all", "ABC"), ("C", "C")):
            units = [unit for unit in tuned if unit in flown[name] and unit[0] in seeds]
            entries = (f"{name}, tuned", tuned), (f"{name}, default", flown[name]), ("surge_cast", flown["surge_cast"])
            lines += [_describe(entry, label, [found[unit] for unit in units]) for entry, found in entries]
            own = np.array([is_found(tuned[unit]) for unit in units])
            for entry, found in entries[1:]:
                alone, other, p = mcnemar(own, np.array([is_found(found[unit]) for unit in units]))
                tests.append(f"{name}, tuned, and {entry}, seeds {label}: alone {alone} and {other}, p {p:.2g}")
    heads = ("entry", "seeds", "found", "success [%]", "declared", "median time of a declaration [s]", "in rooms")
    print_table(heads, lines)
    write("; ".join(tests) + ".")


def _describe(entry: str, seeds: str, rows: Sequence[Row]) -> Sequence[object]:
    declared = [row for row in rows if is_true(row["declared"])]
    rooms = [row for row in rows if row["scenario"].startswith("room")]
    n_found = sum(map(is_found, rows))
    return (
        entry, seeds, f"{n_found} of {len(rows)}", format_estimate(wilson(n_found, len(rows)), format_percent),
        len(declared), median_s(declared), f"{sum(map(is_found, rooms))} of {len(rooms)}",
    )  # fmt: skip


def print_sweeps(defaults: Sequence[Row], variant: Mapping[Unit, Row]) -> None:
    """Print how often the sweep comes near the source at the suite's speed and at its default."""
    rested = [row for row in defaults if row["entry"] == "sweep" and find_unit(row) in variant]
    passed = [variant[find_unit(row)] for row in rested]
    texts = [
        f"{sum(map(is_near, rows))} of {len(rows)} within 1 m, after a median of "
        f"{np.median([float(row['time_within_1_m_s']) for row in rows if is_near(row)]):.0f} s"
        for rows in (passed, rested)
    ]
    write(f"The sweep at 0.5 m/s {texts[0]}; at rest in each bend {texts[1]}.")


def print_fit(rows: Sequence[Row]) -> None:
    """Print what one method declares with the fit of a plume and without it, in the same cases, and how sure it is."""
    flown = {name: {find_unit(row): row for row in rows if row["entry"] == name} for name in (WITH_FIT, WITHOUT_FIT)}
    units = [unit for unit in flown[WITH_FIT] if unit in flown[WITHOUT_FIT]]
    lines: list[Sequence[object]] = []
    for place in ("all", "open ground", "room", "mixed"):
        here = [unit for unit in units if place in ("all", find_place(flown[WITH_FIT][unit]))]
        fit, end = ([flown[name][unit] for unit in here] for name in (WITH_FIT, WITHOUT_FIT))
        alone, other, p = mcnemar(np.array(list(map(is_found, fit))), np.array(list(map(is_found, end))))
        times_s = (median_s([row for row in each if row["declared"]]) for each in (fit, end))
        rates = percent(fit, is_found), percent(end, is_found)
        lines.append((place, len(here), *rates, alone, other, f"{p:.2g}", *times_s))
    heads = ("place", "cases", "with the fit [%]", "without [%]", "by the fit alone", "without it alone", "p",
             "median declaration with [s]", "without [s]")  # fmt: skip
    print_table(heads, lines)
    declared = [row for unit in units if (row := flown[WITH_FIT][unit])["declared"]]
    bins = [(0.0, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, math.inf)]
    write_groups("confidence with the fit", declared, "declared_confidence", bins)
    far = [row for row in declared if row["declared_error_in_plane_m"] >= 2.0]
    n_indoors = sum(row["family"] in INDOORS for row in far)
    no_gas = sum(flown[WITH_FIT][unit]["first_contact_s"] is None for unit in units)
    write(
        f"{len(declared)} of {len(units)} runs declare, {len(far)} 2 m and more away, {n_indoors} of these among "
        f"walls; {no_gas} runs met no gas."
    )


def is_found(row: Row) -> bool:
    """Return whether the declaration of a flight was right."""
    return is_true(row["success"])


def is_true(value: object) -> bool:
    """Return a truth value, as a table or as a CSV has it."""
    return value in (True, "True")


def percent(rows: Sequence[Row], holds: Callable[[Row], object]) -> str:
    """Return the share of rows for which something holds, in percent."""
    return format_percent(sum(bool(holds(row)) for row in rows) / len(rows))


def median_s(rows: Sequence[Row]) -> str:
    """Return the median time of the first declaration [s]."""
    return format_three_digits(float(np.median([float(row["first_declared_s"]) for row in rows])))


def write_groups(name: str, rows: Sequence[Row], column: str, bins: Iterable[tuple[float, float]]) -> None:
    """Write how many rows are in each range of a column, and the share of success there."""
    lines = []
    for low, high in bins:
        here = [row for row in rows if low <= row[column] < high]
        if here:
            lines.append(
                (
                    f"{low:g} to {high:g}",
                    len(here),
                    sum(row["success"] for row in here),
                    percent(here, lambda row: row["success"]),
                )
            )
    print_table((name, "runs", "found", "success [%]"), lines)


def write(text: str) -> None:
    """Write a paragraph."""
    sys.stdout.write(f"{text}\n\n")


def main() -> None:
    """Print the figures."""
    rows = read_flights()
    with_gas = [row for row in rows if not row["is_control"]]
    whole = [row for row in with_gas if row["results"] == "seed_c"]
    quick = [row for row in with_gas if row["results"] in ("seed_a", "seed_b")]
    variants = read_variants()
    print_reactive([row for row in whole if row["entry"] in REACTIVE])
    print_source_map([row for row in whole if row["entry"] == "source_map"])
    print_silence([row for row in quick if row["entry"] in ("infotaxis", "particle_filter")])
    print_tuned(with_gas, variants)
    print_sweeps(with_gas, variants["sweep_at_speed"])
    print_fit([row for row in with_gas if row["results"] == "seed_d"])
    n_faults = sum(bool(row["fault"]) for row in rows)
    n_collisions = sum(bool(row["n_collisions"]) for row in rows)
    write(f"{len(rows)} flights: {n_faults} with a fault, {n_collisions} with a collision.")


if __name__ == "__main__":
    main()
