"""Submissions of `gslcosim bench`: bundles, keys, signed results, the log of submissions, and audits."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.arguments import Command, parse_positive_number
from gslcosim.cli.terminal import add_json_option, table, write, write_json
from gslcosim_bench.commands.workers import add_trusted, add_worker_arguments, choose_loader, verify_here

if TYPE_CHECKING:
    from gslcosim_bench.execution.verification import RepeatableResults


def _add_keygen_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("file", type=Path, metavar="FILE", help="file of the new key; the public part is in FILE.pub")
    parser.add_argument("--name", default="", metavar="NAME", help="comment of the public key")


def _keygen(arguments: argparse.Namespace) -> int:
    from gslcosim_archive.signing.keys import write_key

    key = write_key(arguments.file, arguments.name)
    if arguments.json:
        write_json({"private": str(arguments.file), "public": f"{arguments.file}.pub", "fingerprint": key.fingerprint})
    else:
        write(f"Keep to yourself: {arguments.file}\nPublish: {arguments.file}.pub\nFingerprint: {key.fingerprint}")
    return 0


def _add_sign_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", type=Path, metavar="RESULTS", help="a results folder, for example results/mine")
    parser.add_argument(
        "--key", type=Path, required=True, metavar="FILE", help="private Ed25519 key, of bench keygen or ssh-keygen"
    )
    parser.add_argument("--name", default="", metavar="NAME", help="your name, shown beside the key")


def _sign(arguments: argparse.Namespace) -> int:
    from gslcosim_archive.commands.output import format_signature, signature_to_json
    from gslcosim_archive.signing.signed_results import sign_results

    signed = sign_results(arguments.results, arguments.key, author=arguments.name, signed_at=_now())
    if arguments.json:
        write_json(signature_to_json(signed))
    else:
        write(format_signature(signed))
    return 0


# The author's clock: nothing depends on it.
def _now() -> str:
    from datetime import UTC, datetime

    return datetime.now(UTC).isoformat(timespec="seconds")


def add_author(parser: argparse.ArgumentParser) -> None:
    """Add whose signature is expected."""
    parser.add_argument(
        "--author", metavar="KEY", help="expect the signature of this public key: a file, its text or its fingerprint"
    )


def add_head(parser: argparse.ArgumentParser) -> None:
    """Add which line a log is expected to have."""
    parser.add_argument("--head", metavar="HASH", help="expect a line with this hash, noted when it was the last")


def _add_log_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("log", type=Path, metavar="LOG", help="file of the log, made by --add or --note")
    adding = parser.add_mutually_exclusive_group()
    adding.add_argument("--add", type=Path, metavar="RESULTS", help="add signed results")
    adding.add_argument("--note", metavar="TEXT", help="add a text signed with --key, such as a commitment to a seed")
    parser.add_argument("--key", type=Path, metavar="FILE", help="private Ed25519 key that signs the note")
    parser.add_argument("--name", default="", metavar="NAME", help="your name, shown beside the key of the note")
    add_head(parser)


def _log(arguments: argparse.Namespace) -> int:
    from dataclasses import asdict

    from gslcosim_archive.signing.signed_results import check_signature
    from gslcosim_archive.signing.submission_log import FIRST, add_note, add_submission, read_log

    if (arguments.note is None) != (arguments.key is None):
        raise UsageError("--note: expected a text and the key that signs it, --note TEXT --key FILE, was one of them.")
    if arguments.head is not None:
        read_log(arguments.log, head=arguments.head)
    if arguments.note is not None:
        add_note(arguments.log, arguments.note, arguments.key, author=arguments.name, signed_at=_now())
    elif arguments.add is not None:
        signed = check_signature(arguments.add)
        if signed is None:
            raise UsageError(f"{arguments.add}: expected signed results, were unsigned ones. Sign them: bench sign.")
        add_submission(arguments.log, signed)
    lines = read_log(arguments.log)
    head = lines[-1].hash if lines else FIRST
    if arguments.json:
        write_json({"head": head, "lines": [asdict(line) for line in lines]})
    else:
        rows = [
            (str(line.number), line.signed_at, line.author, line.key[-12:], line.suite or line.text, line.hash[:12])
            for line in lines
        ]
        write(table(("LINE", "SIGNED AT", "AUTHOR", "KEY", "SUITE OR NOTE", "HASH"), rows))
        counted = (
            "1 line, signed." if len(lines) == 1 else f"{len(lines)} lines, each signed and chained to the one before."
        )
        write(f"{counted} Note the hash of the last: {head}")
    return 0


def _add_audit_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", type=Path, metavar="RESULTS", help="a signed results folder")
    parser.add_argument("--log", type=Path, required=True, metavar="LOG", help="log of submissions that has RESULTS")
    add_head(parser)
    parser.add_argument(
        "--beacon",
        required=True,
        metavar="TEXT",
        help="a public value from after the line in the log, such as the numbers of an announced lottery draw",
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument(
        "--sample",
        type=parse_positive_number,
        metavar="N",
        help="number of drawn places (a case and repetition); the rows of all entries there are repeated",
    )
    size.add_argument(
        "--at-most-false",
        type=_parse_share,
        default=0.05,
        metavar="SHARE",
        help="as many places as it takes to rule out a larger share of false ones at 95 %% (default: 0.05)",
    )
    parser.add_argument(
        "--entry", action="append", default=[], metavar="NAME", help="repeat the rows of this entry alone; repeatable"
    )
    parser.add_argument(
        "--all-keys",
        action="store_true",
        help="take the lines of all keys for those of one author, when keys are not known to be of different people",
    )
    parser.add_argument(
        "--suite", metavar="SUITE", help="expect the cases of this suite: a file, or the name of a bundled suite"
    )
    parser.add_argument("--draw-only", action="store_true", help="print the drawn trials and run nothing")
    add_author(parser)
    add_trusted(parser)
    add_worker_arguments(parser)


def _parse_share(text: str) -> float:
    try:
        share = float(text)
    except ValueError:
        share = -1.0
    if not 0.0 <= share < 1.0:
        raise argparse.ArgumentTypeError(f"expected a share from 0 to below 1, such as 0.05, was '{text}'")
    return share


def _audit(arguments: argparse.Namespace) -> int:
    from gslcosim_archive.audits import draw_audit
    from gslcosim_archive.commands.output import (
        AuditedPlaces,
        format_signature,
        format_verification,
        signature_to_json,
        verification_to_json,
    )
    from gslcosim_archive.signing.keys import check_text, parse_author
    from gslcosim_archive.signing.signed_results import check_signature
    from gslcosim_archive.signing.submission_log import (
        find_beacon_note,
        find_submission,
        read_log,
    )
    from gslcosim_bench.execution.verification import RepeatableResults
    from gslcosim_bench.store import ResultsFolder
    from gslcosim_bench.verification_marks import results_hash

    check_text(arguments.beacon, "--beacon")
    # As for `bench verify`.
    folder = ResultsFolder(arguments.results, is_checked=False)
    folder.check()
    author = None if arguments.author is None else parse_author(arguments.author)
    # Before the signature is checked, so that the mark is of what was signed.
    contents = results_hash(folder.path)
    signed = check_signature(folder.path, author=author)
    if signed is None:
        raise UsageError(f"{folder.path}: expected signed results, were unsigned ones. Their author signs them.")
    lines = read_log(arguments.log, head=arguments.head)
    line = find_submission(lines, signed, path=arguments.log)
    note = find_beacon_note(lines, line, arguments.beacon, path=arguments.log)
    again = RepeatableResults(folder, choose_loader(arguments))
    if arguments.suite is not None:
        _check_suite(arguments, again)
    places = again.list_places(arguments.entry)
    if not places:
        of_whom = f" of {', '.join(arguments.entry)}" if arguments.entry else ""
        raise UsageError(f"{folder.path}: expected flights{of_whom} with a result, found none.")
    draw = draw_audit(
        lines, line, places, arguments.beacon, n_places=arguments.sample, max_false_share=arguments.at_most_false,
        counts_all_keys=arguments.all_keys,
    )  # fmt: skip
    of_suite, own, drawn = draw.of_suite, draw.own, draw.places
    keys, own_keys = ({each.key for each in some} for some in (of_suite, own))
    elsewhere = [each for each in lines if each.kind == line.kind and each.key in own_keys and each not in own]
    chosen = {trial.id for place in drawn for trial in places[place]}
    trials = [trial for trial in again.trials.values() if trial.id in chosen]
    audited = AuditedPlaces(
        by_trial={trial.id: place for place, some in places.items() for trial in some}, drawn=drawn, level=draw.level
    )
    facts = {
        "signature": signature_to_json(signed),
        "line": line.number,
        "head": line.hash,
        "draw_line": of_suite[0].number,
        "draw_head": of_suite[0].hash,
        "lines_of_key": [each.number for each in own if each.key == line.key],
        "lines_of_author": [each.number for each in own],
        "lines_elsewhere": [each.number for each in elsewhere],
        "lines_counted": draw.n_lines,
        "level": draw.level,
        "keys_of_suite": len(keys),
        "keys_of_same_name": sorted(own_keys - {line.key}),
        "beacon": arguments.beacon,
        "beacon_line": None if note is None else note.number,
        "places": len(places),
        "drawn_places": len(drawn),
        "drawn": [trial.id for trial in trials],
    }
    listed = ", ".join(str(number) for number in facts["lines_of_key"])
    summary = (
        f"Drawn: {len(drawn)} of {len(places)} places with {len(trials)} rows, by line {of_suite[0].number} of the log "
        f"({of_suite[0].hash}), the first for this suite, and the beacon '{arguments.beacon}'.\n"
        f"Log: the results are line {line.number}; this key has {len(facts['lines_of_key'])} for this suite "
        f"({listed}), and {len(keys) - 1} other keys have some. Limits hold for {draw.n_lines} of these together.\n"
    )
    if len(own_keys) > 1:
        summary += (
            f"Keys: '{line.author}' is the name beside {len(own_keys)} keys for this suite; the log does not show "
            "whether they are of one author.\n"
        )
    if elsewhere:
        summary += (
            f"Other cases: {len(elsewhere)} more lines of this author are for other cases, "
            f"{sum(each.suite == line.suite for each in elsewhere)} of them under the name {line.suite}.\n"
        )
    summary += (
        "Beacon: no note of the log has it, so the log does not show that it is from after the results."
        if note is None
        else f"Beacon: line {note.number} of the log has it, after the results."
    )
    if arguments.draw_only:
        rows = "".join(f"\n  {trial.id} {trial.case}, {trial.entry}" for trial in trials)
        write_json(facts) if arguments.json else write(f"{summary}{rows}")
        return 0
    verification = verify_here(arguments, again, trials, contents)
    if arguments.json:
        write_json(verification_to_json(verification, audited) | facts)
    else:
        write(f"{format_signature(signed)}\n{summary}\n{format_verification(verification, audited)}")
    return ExitCode.DIVERGENCE if verification.differences else 0


# A suite of the same name with one case more has another hash, and so another first line.
def _check_suite(arguments: argparse.Namespace, again: "RepeatableResults") -> None:
    from gslcosim_bench.cases import build_plan

    plan = build_plan(choose_loader(arguments)(arguments.suite), wants=lambda _: False)
    if plan.suite_hash != again.plan.suite_hash:
        raise UsageError(
            f"{again.folder.path}: expected the cases of {arguments.suite}, with the hash {plan.suite_hash}, was suite "
            f"{again.plan.loaded.suite.name} with the hash {again.plan.suite_hash}. Its author has flown other cases."
        )


def _add_pack_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="folder with submission.yaml")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the bundle (default: the entry's name with .tar)")


def _pack(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.cases.submission_bundles import load_submission, pack_bundle

    out = arguments.out or Path(f"{load_submission(arguments.folder).entry.name}.tar")
    bundle = pack_bundle(arguments.folder, out)
    if arguments.json:
        write_json({"bundle": str(out), "sha256": bundle.digest, "files": list(bundle.files)})
    else:
        listed = "".join(f"\n  {name}" for name in bundle.files)
        write(f"Bundle: {out}, SHA-256 {bundle.digest}, {len(bundle.files)} files:{listed}")
    return 0


COMMANDS = (
    Command(
        name="pack",
        summary="pack a program, its card, lock and build recipe into one file",
        examples="  gslcosim bench pack my_method\n  gslcosim bench pack my_method --out my_method-2.tar",
        add_arguments=_add_pack_arguments,
        run=_pack,
    ),
    Command(
        name="keygen",
        summary="make a key that signs results",
        examples="  gslcosim bench keygen my_key",
        add_arguments=_add_keygen_arguments,
        run=_keygen,
    ),
    Command(
        name="sign",
        summary="sign every file and row of results with your key",
        examples="  gslcosim bench sign results/mine --key my_key\n"
        "  gslcosim bench sign results/mine --key ~/.ssh/id_ed25519 --name 'Ada Lovelace'",
        add_arguments=_add_sign_arguments,
        run=_sign,
    ),
    Command(
        name="log",
        summary="check the log of submissions, or add to it",
        examples="  gslcosim bench log submissions.jsonl\n"
        "  gslcosim bench log submissions.jsonl --add submissions/delft\n"
        "  gslcosim bench log submissions.jsonl --note 'seed of the test: sha256 1f0c' --key my_key",
        add_arguments=_add_log_arguments,
        run=_log,
    ),
    Command(
        name="audit",
        summary="repeat trials that a public draw chooses; bound the false rows",
        examples="  gslcosim bench audit submissions/delft --log submissions.jsonl --beacon '6 49 3 17 22 8'\n"
        "  gslcosim bench audit submissions/delft --log submissions.jsonl --beacon '6 49 3' --at-most-false 0.02\n"
        "  gslcosim bench audit submissions/delft --log log.jsonl --beacon '6 49 3' --suite open_2026 --entry mine",
        add_arguments=_add_audit_arguments,
        run=_audit,
    ),
)
