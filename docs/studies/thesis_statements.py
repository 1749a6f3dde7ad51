"""What becomes of the thesis's statements: paired differences with intervals, from results of `gsl_bench_2023`.

    gslcosim bench run gsl_bench_2023
    python docs/studies/thesis_statements.py results/gsl_bench_2023
    python docs/studies/thesis_statements.py results/gsl_bench_2023 --three-d results/gsl_bench_3d

Works on results of `gsl_bench_fair` too, whose entries have the same names. Source of the statements: Erwich 2023,
GSL-Bench, chapters 9 and 10.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from gslcosim_bench import Results, compare
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.rates import difference_of_rates

ODD = ["gsl_bench_1", "gsl_bench_3", "gsl_bench_5"]
EVEN = ["gsl_bench_2", "gsl_bench_4", "gsl_bench_6"]
EMPTY, COMPLEX = ["gsl_bench_1", "gsl_bench_2"], ["gsl_bench_5", "gsl_bench_6"]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, help="results of gsl_bench_2023 or gsl_bench_fair")
    parser.add_argument("--three-d", type=Path, help="results of gsl_bench_3d")
    arguments = parser.parse_args()
    results = Results.load(arguments.results).select(is_control=False)
    three_d = Results.load(arguments.three_d).select(is_control=False) if arguments.three_d else None
    sys.stdout.write(f"{rates(results)}\n{statements(results, three_d)}\n{distances(results)}")


def rates(results: Results) -> str:
    """Return success of each entry in each room."""
    rooms = sorted(set(results.array("scenario")))
    lines = ["| entry | " + " | ".join(rooms) + " | all |", "|---|" + "---|" * (len(rooms) + 1)]
    for entry in results.entries:
        cells = [results.select(scenario=room).success(entry) for room in rooms]
        lines.append(f"| {entry} | " + " | ".join(percent(cell) for cell in [*cells, results.success(entry)]) + " |")
    return "\n".join(lines) + "\n"


def statements(results: Results, three_d: Results | None) -> str:
    """Return the statements as differences of success in points."""
    lines = ["| statement of the thesis | n | difference, points | p | holds |", "|---|---|---|---|---|"]
    odd, even = results.select(scenario=ODD), results.select(scenario=EVEN)
    for text, rows, better, worse in (
        ("the random walker beats E. coli", results, "random_walker", "e_coli"),
        ("the dung beetle beats E. coli where the source is at (5, 1)", odd, "dung_beetle", "e_coli"),
        ("the dung beetle is worse than E. coli where the source is at (1, 10)", even, "e_coli", "dung_beetle"),
    ):
        told = compare(rows, better, worse)
        lines.append(row(text, f"{told.n} pairs", told.success, f"{told.success_p:.2g}"))
    for entry in results.entries:
        empty, racked = (results.select(entry=entry, scenario=some).array("success") for some in (EMPTY, COMPLEX))
        difference = difference_of_rates(int(empty.sum()), len(empty), int(racked.sum()), len(racked))
        lines.append(
            row(f"more obstacles, less success: {entry}, empty less complex rooms", str(len(empty)), difference)
        )
    if three_d is not None:
        flat, deep = results.select(entry="e_coli").array("success"), three_d.select(entry="e_coli_3d").array("success")
        difference = difference_of_rates(int(flat.sum()), len(flat), int(deep.sum()), len(deep))
        lines.append(row("3-D E. coli succeeds least: 2-D less 3-D", f"{len(flat)}, {len(deep)}", difference))
    return "\n".join(lines) + "\n"


def distances(results: Results) -> str:
    """Return success near to and far from the source, by the median distance of the starts in the plane."""
    lines = ["| entry | success from the nearer starts | from the farther ones |", "|---|---|---|"]
    for entry in results.entries:
        rows = results.select(entry=entry)
        away_m = np.hypot(
            rows.array("start_x_m") - rows.array("source_x_m"), rows.array("start_y_m") - rows.array("source_y_m")
        )
        near = away_m <= np.median(away_m)
        success = rows.array("success").astype(bool)
        cells = [f"{100 * success[some].mean():.0f} % of {some.sum()}" for some in (near, ~near)]
        lines.append(f"| {entry} | {cells[0]} | {cells[1]} |")
    return "\n".join(lines) + "\n"


def row(text: str, n: str, difference: Estimate, p: str = "") -> str:
    """Return a line of the table of statements."""
    holds = "undecided" if difference.holds_zero else "yes" if difference.value > 0 else "no"
    value, low, high = (100 * part for part in (difference.value, difference.low, difference.high))
    return f"| {text} | {n} | {value:+.1f} [{low:+.1f}, {high:+.1f}] | {p} | {holds} |"


def percent(figure: Estimate) -> str:
    """Return a rate with its interval in per cent."""
    return f"{100 * figure.value:.0f} [{100 * figure.low:.0f}, {100 * figure.high:.0f}]"


if __name__ == "__main__":
    main()
