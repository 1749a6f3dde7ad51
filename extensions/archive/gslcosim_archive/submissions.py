"""Leaderboard of several authors' results: same cases required, unverified rows marked."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.parquet as pq

from gslcosim.base.errors import UsageError
from gslcosim.base.files import ScratchFolder
from gslcosim_archive.signing.keys import SignatureError
from gslcosim_archive.signing.signed_results import SignedResults, check_signature
from gslcosim_archive.signing.submission_log import find_submission, read_log
from gslcosim_bench.execution.verification import find_unsandboxed_rows
from gslcosim_bench.report.report_data import ReportData, load_report_data
from gslcosim_bench.report.writer import write_report
from gslcosim_bench.results import PAIR, Results
from gslcosim_bench.store import MAPS_SCHEMA, TRIALS, ResultsFolder
from gslcosim_bench.verification_marks import VerificationMark, find_mark, results_hash, save_mark

LEADERBOARD = "leaderboard.json"


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """A merged leaderboard: as `leaderboard.json` has it, and how each entry stands with verification.

    `submissions` gives the folder of each entry, `verified` how many of how many sampled runs came out the same, or
    None where this user has run none again. `keys` are the fingerprints of the keys that have signed their folders, or
    None where nobody has.
    """

    leaderboard: dict[str, Any]
    submissions: dict[str, str]
    verified: dict[str, tuple[int, int] | None]
    keys: dict[str, str | None]


def rank(
    folders: Sequence[Path],
    out: Path | None = None,
    *,
    demands_sandbox: bool = False,
    demands_signature: bool = False,
    log: Path | None = None,
    head: str | None = None,
) -> Ranking:
    """Return one table of several results folders.

    An entry that several folders have is one where its program, parameters and runs are the same, such as the
    anchors; otherwise each is named after its folder.

    Args:
        out: Where merged results with their report are written; nowhere if absent.
        demands_sandbox: Whether all runs must be of agents in a sandbox; so they must where the suite of one of the
            folders demands it.
        demands_signature: Whether all folders must be signed.
        log: Log of submissions in which all folders must be; absent: none.
        head: Hash of a line that the log must have.
    """
    submissions = _load_submissions(
        folders, demands_sandbox=demands_sandbox, demands_signature=demands_signature, log=log, head=head
    )
    names = _entry_names(submissions)
    if out is not None:
        folder = ResultsFolder(out)
        if folder.trials.is_file() and "merged_from" not in folder.read_json(folder.manifest):
            raise UsageError(f"The folder of --out has results that are not merged ones: {out}. Choose a new folder.")
        return _written(submissions, names, out, is_kept=True)
    with ScratchFolder("rank") as scratch:
        return _written(submissions, names, scratch.path, is_kept=False)


@dataclass(frozen=True, kw_only=True)
class PublishedResults:
    """Results of one folder or of several as one, with the gas of their tracks.

    `keys` are the fingerprints of the keys that have signed the folder of each entry, or None.
    """

    material: ReportData
    keys: dict[str, str | None]


def load_published_results(folders: Sequence[Path]) -> PublishedResults:
    """Return the results of one folder, or of several merged as `rank` does."""
    submissions = _load_submissions(folders)
    if len(submissions) == 1:
        material = load_report_data(folders[0], with_gas=True)
        return PublishedResults(material=material, keys={each.name: submissions[0].key for each in material.entries})
    with ScratchFolder("rank") as scratch:
        homes, mark = _merged(submissions, _entry_names(submissions), scratch.path)
        material = load_report_data(scratch.path, mark, with_gas=True)
    return PublishedResults(material=material, keys={name: home.key for name, home in homes.items()})


def _load_submissions(
    folders: Sequence[Path],
    *,
    demands_sandbox: bool = False,
    demands_signature: bool = False,
    log: Path | None = None,
    head: str | None = None,
) -> "list[_Submission]":
    names_alone = [folder.resolve().name for folder in folders]
    submissions = [
        _Submission(
            label=name if names_alone.count(name) == 1 else str(folder),
            results=Results.load(folder),
        )
        for folder, name in zip(folders, names_alone, strict=True)
    ]
    _check_signatures(submissions, is_asked=demands_signature or log is not None)
    if log is not None:
        lines = read_log(log, head=head)
        for submission in submissions:
            find_submission(lines, cast("SignedResults", submission.signed), path=log)
    first = submissions[0]
    for other in submissions[1:]:
        here, there = (each.manifest.get("suite_hash") for each in (other, first))
        if here != there:
            raise UsageError(
                f"{other.results.folder}: expected the cases of {first.results.folder}, of suite "
                f"{first.manifest.get('suite')} with the hash {there}, was suite {other.manifest.get('suite')} with "
                f"the hash {here}. Results of other cases, or of another version of them, cannot be ranked together: "
                "enter the same suite with include, and fly it again."
            )
    _check_same_trials(submissions)
    _check_sandboxes(submissions, is_asked=demands_sandbox)
    return submissions


@dataclass(kw_only=True)
class _Submission:
    label: str
    results: Results

    @property
    def manifest(self) -> dict[str, Any]:
        return self.results.manifest

    def agent_of(self, entry: str) -> str:
        """Return the identity of an entry, its program and parameters, as text."""
        listed = next((each for each in self.manifest.get("entries", []) if each["name"] == entry), {})
        return json.dumps([listed.get("agent_hash"), listed.get("parameters")], sort_keys=True)

    @cached_property
    def signed(self) -> SignedResults | None:
        """The statement that its author has signed."""
        return check_signature(self.results.folder)

    @property
    def key(self) -> str | None:
        """The fingerprint of the key that has signed the folder."""
        return self.signed.key.fingerprint if self.signed is not None else None

    # Never what the folder says of itself.
    @cached_property
    def mark(self) -> VerificationMark | None:
        return find_mark(self.results.folder)

    @property
    def verified(self) -> tuple[int, int] | None:
        mark = self.mark
        # Who leaves rows out may have left out the bad ones.
        return (mark.same, mark.sample) if mark is not None and mark.sample and not mark.n_missing else None

    @property
    def is_verified(self) -> bool:
        return self.verified is not None and self.verified[0] == self.verified[1]


def _check_signatures(submissions: Sequence[_Submission], *, is_asked: bool) -> None:
    unsigned = [str(each.results.folder) for each in submissions if each.key is None]
    if unsigned and is_asked:
        raise SignatureError(
            f"rank: expected signed results, as --signed and --log ask, were unsigned ones in {', '.join(unsigned)}. "
            "Their authors sign them with bench sign."
        )


# Their digests are equal where agents have not cheated, so that only the rows tell.
def _check_sandboxes(submissions: Sequence[_Submission], *, is_asked: bool) -> None:
    demanding = next((each for each in submissions if each.manifest.get("sandbox") == "required"), None)
    if demanding is None and not is_asked:
        return
    why = "--sandboxed asks" if demanding is None or is_asked else f"the suite of {demanding.results.folder} demands"
    for submission in submissions:
        rows = submission.results.trials.select(["entry", "digest", "sandbox"]).to_pylist()
        if outside := find_unsandboxed_rows(rows):
            sandboxes = outside[0]["sandbox"] or "nothing told"
            raise UsageError(
                f"{submission.results.folder}: expected agents in a sandbox, as {why}, was {sandboxes} in "
                f"{len(outside)} of {len(rows)} flights, of {', '.join(sorted({row['entry'] for row in outside}))}. "
                "Add sandbox: required to its suite, and fly it again."
            )


# Runs of one program in one case have one digest; where two folders disagree, their software did.
def _check_same_trials(submissions: Sequence[_Submission]) -> None:
    digests: dict[tuple[Any, ...], tuple[str, str]] = {}
    for submission in submissions:
        rows = submission.results.trials
        secrets = ResultsFolder(submission.results.folder).read_agent_secrets()
        for row in rows.select([*PAIR, "entry", "digest", "trial"]).to_pylist():
            # Seeds of agents that follow from other secrets are others.
            seeds = secrets.get(row["trial"])
            key = (*(row[name] for name in PAIR), row["entry"], submission.agent_of(row["entry"]), seeds)
            before = digests.setdefault(key, (row["digest"], submission.label))
            if row["digest"] and before[0] and before[0] != row["digest"]:
                raise UsageError(
                    f"{submission.results.folder}: expected the flight of {row['entry']} in {row['case']}, repetition "
                    f"{row['repetition']}, to have the digest {before[0]} as in {before[1]}, was {row['digest']}. "
                    "They were flown by different software: fly one of them again."
                )


def _entry_names(submissions: Sequence[_Submission]) -> dict[tuple[str, str], str]:
    programs: dict[str, set[str]] = {}
    for submission in submissions:
        for entry in submission.results.entries:
            programs.setdefault(entry, set()).add(submission.agent_of(entry))
    names: dict[tuple[str, str], str] = {}
    for submission in submissions:
        for entry in submission.results.entries:
            is_shared = len(programs[entry]) == 1
            names[submission.label, entry] = entry if is_shared else f"{entry} ({submission.label})"
    return names


def _written(
    submissions: Sequence[_Submission], names: dict[tuple[str, str], str], out: Path, *, is_kept: bool
) -> Ranking:
    homes, mark = _merged(submissions, names, out)
    if is_kept:
        save_mark(results_hash(out), mark)
    write_report(out, mark=mark)
    leaderboard = ResultsFolder(out).read_json(out / LEADERBOARD)
    return Ranking(
        leaderboard=leaderboard,
        submissions={name: home.label for name, home in homes.items()},
        verified={name: home.verified for name, home in homes.items()},
        keys={name: home.key for name, home in homes.items()},
    )


# Without a report; with the home of each entry, and what this user has found out about them.
def _merged(
    submissions: Sequence[_Submission], names: dict[tuple[str, str], str], out: Path
) -> tuple[dict[str, _Submission], VerificationMark]:
    folder = ResultsFolder(out)
    out.mkdir(parents=True, exist_ok=True)
    rows, homes = _merged_rows(submissions, names)
    pq.write_table(pa.Table.from_pylist(rows, schema=TRIALS), folder.trials, compression="zstd")
    tracks = [submission.results.tracks() for submission in submissions]
    kept = {row["trial"] for row in rows}
    merged = pa.concat_tables(tracks)
    kept_tracks, seen = [], set[tuple[str, str]]()
    for trial, agent in zip(merged["trial"].to_pylist(), merged["agent"].to_pylist(), strict=True):
        kept_tracks.append(trial in kept and (trial, agent) not in seen)
        seen.add((trial, agent))
    pq.write_table(merged.filter(pa.array(kept_tracks, pa.bool_())), folder.tracks, compression="zstd")
    folder.write_json(folder.manifest, _manifest(submissions, names, homes))
    folder.write_json(folder.maps, _maps(submissions))
    return homes, VerificationMark(entries={name: home.is_verified for name, home in homes.items()})


def _merged_rows(
    submissions: Sequence[_Submission], names: dict[tuple[str, str], str]
) -> tuple[list[dict[str, Any]], dict[str, _Submission]]:
    rows: dict[tuple[Any, ...], dict[str, Any]] = {}
    homes: dict[str, _Submission] = {}
    for submission in submissions:
        for row in submission.results.trials.to_pylist():
            name = names[submission.label, row["entry"]]
            # Shared entries count as verified where one of their folders is.
            if name not in homes or (homes[name].verified is None and submission.verified is not None):
                homes[name] = submission
            rows.setdefault((*(row[key] for key in PAIR), name), row | {"entry": name})
    return list(rows.values()), homes


def _manifest(
    submissions: Sequence[_Submission], names: dict[tuple[str, str], str], homes: dict[str, _Submission]
) -> dict[str, Any]:
    entries: dict[str, dict[str, Any]] = {}
    for submission in submissions:
        for listed in submission.manifest.get("entries", []):
            name = names.get((submission.label, listed["name"]))
            if name is not None:
                home = homes[name]
                entries.setdefault(name, {**listed, "name": name, "submission": home.label, "key": home.key})
    first = submissions[0].manifest
    kept = (
        "schema", "suite", "title", "question", "smallest_difference_points", "seed", "suite_hash", "versions",
        "anchors", "scenarios", "dropped",
    )  # fmt: skip
    demands = any(submission.manifest.get("sandbox") == "required" for submission in submissions)
    return {
        **{key: first[key] for key in kept if key in first},
        "sandbox": "required" if demands else "optional",
        "merged_from": [submission.label for submission in submissions],
        "entries": list(entries.values()),
    }


def _maps(submissions: Sequence[_Submission]) -> dict[str, Any]:
    found: dict[tuple[Any, ...], Any] = {}
    for submission in submissions:
        folder = ResultsFolder(submission.results.folder)
        for each in folder.read_json(folder.maps).get("maps", []):
            found.setdefault((each["scenario"], each["varied"]), each)
    return {"schema": MAPS_SCHEMA, "maps": list(found.values())}
