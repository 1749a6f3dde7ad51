"""Output of the commands that sign, check and rank results."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gslcosim.cli.terminal import table

if TYPE_CHECKING:
    from gslcosim_archive.signing.signed_results import SignedResults
    from gslcosim_archive.submissions import Ranking
    from gslcosim_bench.execution.verification import Verification

# Enough of a fingerprint to tell keys of a table apart; --json has all of it.
_KEY_WIDTH = len("SHA256:") + 12


@dataclass(frozen=True, kw_only=True)
class AuditedPlaces:
    """Places from which an audit drew: the place of each row with a result, those drawn, and the level of limits."""

    by_trial: Mapping[str, str]
    drawn: Sequence[str]
    level: float

    def max_false(self, verification: "Verification") -> int:
        """Return the largest number of false rows that the audit leaves possible."""
        from gslcosim_archive.audits import max_false_rows_in_places

        drawn = set(self.drawn)
        found = {self.by_trial[each.trial] for each in verification.differences}
        undrawn = Counter(place for place in self.by_trial.values() if place not in drawn)
        return max_false_rows_in_places(
            list(undrawn.values()), len(drawn), len(found), len(verification.differences), self.level
        )


# The rows that limits are of, how many of them can be false, and how many of each entry.
def _find_limits(
    verification: "Verification", audited: AuditedPlaces | None
) -> tuple[int, int, dict[str, tuple[int, int, int, int]]]:
    from gslcosim_archive.audits import max_false_rows
    from gslcosim_bench.statistics.estimates import LEVEL

    level = LEVEL if audited is None else audited.level
    by_entry = {
        entry: (n, drawn, wrong, max_false_rows(n, drawn, wrong, level))
        for entry, (n, drawn, wrong) in verification.by_entry.items()
        if audited is None or drawn
    }
    if audited is not None:
        return len(audited.by_trial), audited.max_false(verification), by_entry
    n, wrong = verification.n_rows, len(verification.differences)
    return n, max_false_rows(n, verification.n_sampled, wrong), by_entry


def verification_to_json(verification: "Verification", audited: AuditedPlaces | None = None) -> dict[str, Any]:
    """Return the result of a verification as JSON has it.

    Args:
        audited: Places of an audit; absent: single rows were drawn.
    """
    n_rows, max_false, by_entry = _find_limits(verification, audited)
    return {
        "rows": n_rows,
        "max_false": max_false,
        "entries": {
            entry: {"rows": n, "sample": n_drawn, "different": n_wrong, "max_false": most}
            for entry, (n, n_drawn, n_wrong, most) in by_entry.items()
        },
        "sample": verification.n_sampled,
        "same": verification.n_sampled - len(verification.differences),
        "missing": verification.n_missing,
        "sandboxes": dict(verification.sandboxes),
        "differences": [
            {"trial": d.trial, "case": d.case, "entry": d.entry, "columns": d.columns} for d in verification.differences
        ],
    }


def format_verification(verification: "Verification", audited: AuditedPlaces | None = None) -> str:
    """Return the result of a verification as text; `audited` as for `verification_to_json`."""
    from gslcosim.runtime.processes.sandbox.selection import is_sandboxed

    n, different = verification.n_sampled, verification.differences
    started = ", ".join(f"{count} {kind}" for kind, count in sorted(verification.sandboxes.items()))
    note = f"Sandbox of agents: {started or 'nothing was flown'}."
    if any(not is_sandboxed(kind) for kind in verification.sandboxes):
        note += " Agents without one could read the truth; without --trusted all of them are in one."
    if verification.n_missing:
        note += (
            f"\n{verification.n_missing} trials of the suite have no row, so that nobody can tell what came of them: "
            "bench rank does not take these results for verified."
        )
    note = f"{format_false_rows(verification, audited)}\n{note}"
    if not different:
        return f"{n} of {n} flights came out the same: digests and all figures.\n{note}"
    lines = [f"{len(different)} of {n} flights came out differently:"]
    for each in different:
        name, (before, now) = next(iter(each.columns.items()))
        more = f" and {len(each.columns) - 1} other columns" if len(each.columns) > 1 else ""
        lines.append(f"  {each.trial} {each.case}, {each.entry}: {name} was {before}, is {now}{more}")
    return "\n".join([*lines, note])


def format_false_rows(verification: "Verification", audited: AuditedPlaces | None = None) -> str:
    """Return how many rows can still be false, in a sentence and for each entry."""
    n, most, by_entry = _find_limits(verification, audited)
    n_wrong = len(verification.differences)
    least = f"at least {n_wrong} and, " if n_wrong else ""
    text = f"Of {n} rows with a flight {least}at 95 % confidence, at most {most} are false: {100 * most / n:.1f} %."
    entries = ", ".join(
        f"{entry} {limit} of {n_of} ({drawn} drawn)" for entry, (n_of, drawn, _, limit) in by_entry.items()
    )
    return f"{text}\nOf one entry at most: {entries}."


def signature_to_json(signed: "SignedResults | None") -> dict[str, Any] | None:
    """Return a signature as JSON has it; None without one."""
    if signed is None:
        return None
    return {
        "key": signed.key.text,
        "fingerprint": signed.key.fingerprint,
        "author": signed.author,
        "signed_at": signed.signed_at,
        "statement_hash": signed.statement_hash,
        "suite_hash": signed.suite_hash,
        "rows": signed.n_rows,
    }


def format_signature(signed: "SignedResults | None") -> str:
    """Return who has signed results, in a sentence."""
    if signed is None:
        return "Nobody has signed these results."
    author = f" ({signed.author})" if signed.author else ""
    return (
        f"Signed by {signed.key.fingerprint}{author}, {signed.signed_at}: {signed.n_rows} rows and all files as "
        f"signed, statement {signed.statement_hash}."
    )


def format_ranking(ranking: "Ranking") -> str:
    """Return a merged leaderboard: the places each entry may have, who has been verified, and what follows from it."""
    from gslcosim_bench.report.conclusions import CONCLUDED, NOT_CONCLUDED
    from gslcosim_bench.report.number_formats import format_ranks

    view = ranking.leaderboard["views"][0]
    rows = [
        (
            format_ranks(row["rank"], row["last_rank"]),
            row["entry"],
            _format_figure(row["score"], 1.0, 3),
            f"{_format_figure(row['success'], 100.0, 0)} %",
            _format_figure(row["time_s"], 1.0, 0),
            str(row["n"]),
            ranking.submissions[row["entry"]],
            _verified(ranking.verified[row["entry"]]),
            (ranking.keys[row["entry"]] or "nobody")[:_KEY_WIDTH],
        )
        for row in view["rows"]
    ]
    head = ("RANK", "ENTRY", "SCORE", "SUCCESS", "TIME [s]", "N", "SUBMISSION", "VERIFIED", "SIGNED BY")
    said = ranking.leaderboard["conclusions"]
    parts = ((CONCLUDED, said["holds"]), (NOT_CONCLUDED, said["limits"]))
    lines = [line for title, some in parts if some for line in (f"\n{title}:", *(f"- {text}" for text in some))]
    order = "Highest score first. Intervals are 95 %; RANK is the best and the worst place."
    return f"{table(head, rows)}\n{order}\n" + "\n".join(lines)


def _format_figure(figure: dict[str, float] | None, times: float, digits: int) -> str:
    if figure is None:
        return "-"
    value, low, high = (
        "?" if part is None else f"{times * part:.{digits}f}" for part in (figure[k] for k in ("value", "low", "high"))
    )
    return f"{value} [{low}, {high}]"


def _verified(counts: tuple[int, int] | None) -> str:
    return "no" if counts is None else f"{counts[0]} of {counts[1]}"
