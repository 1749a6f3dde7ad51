"""Results of others in `gslcosim bench`: repeat a sample of them, rank them, show them as a site."""

import argparse
import secrets
from pathlib import Path

from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.arguments import Command, parse_positive_number, parse_whole_number
from gslcosim.cli.terminal import add_json_option, write, write_json
from gslcosim_archive.commands.submission import add_author, add_head
from gslcosim_bench.commands.workers import add_trusted, add_worker_arguments, choose_loader, verify_here


def _add_verify_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", type=Path, metavar="RESULTS", help="a results folder, for example results/smoke")
    parser.add_argument(
        "--sample", type=parse_positive_number, default=20, metavar="N", help="number of trials (default: 20)"
    )
    parser.add_argument(
        "--seed",
        type=parse_whole_number,
        metavar="N",
        help="seed of the sample (default: a new one)",
    )
    parser.add_argument("--signature-only", action="store_true", help="check the author's signature, and run nothing")
    add_author(parser)
    add_trusted(parser)
    add_worker_arguments(parser)


def _verify(arguments: argparse.Namespace) -> int:
    from gslcosim_archive.commands.output import (
        format_signature,
        format_verification,
        signature_to_json,
        verification_to_json,
    )
    from gslcosim_archive.signing.keys import parse_author
    from gslcosim_archive.signing.signed_results import check_signature
    from gslcosim_bench.execution.verification import RepeatableResults
    from gslcosim_bench.store import ResultsFolder
    from gslcosim_bench.verification_marks import results_hash

    # A repeated trial is more exact than a changed checksum.
    folder = ResultsFolder(arguments.results, is_checked=False)
    folder.check()
    author = None if arguments.author is None else parse_author(arguments.author)
    # Before the signature is checked, so that the mark is of what was signed.
    contents = "" if arguments.signature_only else results_hash(folder.path)
    signed = check_signature(folder.path, author=author)
    if arguments.signature_only:
        if signed is None:
            raise UsageError(f"{folder.path}: expected signed results, were unsigned ones. Sign them: bench sign.")
        if arguments.json:
            write_json({"signature": signature_to_json(signed)})
        else:
            write(format_signature(signed))
        return 0
    again = RepeatableResults(folder, choose_loader(arguments))
    seed = secrets.randbelow(1 << 31) if arguments.seed is None else arguments.seed
    verification = verify_here(arguments, again, again.draw(arguments.sample, seed=str(seed)), contents)
    if arguments.json:
        write_json(verification_to_json(verification) | {"seed": seed, "signature": signature_to_json(signed)})
    else:
        write(
            f"{format_signature(signed)}\n{format_verification(verification)}\nThe sample was drawn with --seed {seed}."
        )
    return ExitCode.DIVERGENCE if verification.differences else 0


def _add_rank_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULTS", help="results folders of one suite")
    parser.add_argument("--sandboxed", action="store_true", help="refuse runs whose agents had no sandbox")
    parser.add_argument("--signed", action="store_true", help="refuse results that nobody has signed")
    parser.add_argument("--log", type=Path, metavar="LOG", help="refuse results that are not in this log")
    add_head(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="write merged results, with a report, to this folder")


def _rank(arguments: argparse.Namespace) -> int:
    from gslcosim_archive.commands.output import format_ranking
    from gslcosim_archive.submissions import rank

    if arguments.head is not None and arguments.log is None:
        raise UsageError("--head: expected the log that has this line, --log LOG, found none. Add it.")
    ranking = rank(
        arguments.results,
        arguments.out,
        demands_sandbox=arguments.sandboxed,
        demands_signature=arguments.signed,
        log=arguments.log,
        head=arguments.head,
    )
    if arguments.json:
        write_json(
            {**ranking.leaderboard, "submissions": ranking.submissions, "verified": ranking.verified}
            | {"keys": ranking.keys}
        )
    else:
        write(format_ranking(ranking))
    return 0


def _add_site_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("results", nargs="+", type=Path, metavar="RESULTS", help="results folders of one suite")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder of the site")


def _site(arguments: argparse.Namespace) -> int:
    from dataclasses import asdict

    from gslcosim_archive.site.writer import write_site

    written = write_site(arguments.results, arguments.out)
    if arguments.json:
        write_json(asdict(written) | {"page": str(written.page)})
    else:
        write(
            f"{written.n_methods} methods, {written.n_cases} cases, {written.n_trials} trials, "
            f"{written.n_bytes / 1e6:.1f} MB.\nSite: {written.page}"
        )
    return 0


COMMANDS = (
    Command(
        name="verify",
        summary="repeat a sample of the trials and compare all figures",
        examples="  gslcosim bench verify results/smoke --sample 5\n"
        "  gslcosim bench verify submissions/delft --seed 7\n"
        "  gslcosim bench verify submissions/delft --signature-only --author delft.pub",
        add_arguments=_add_verify_arguments,
        run=_verify,
    ),
    Command(
        name="rank",
        summary="merge the results of several authors into one table",
        examples="  gslcosim bench rank results/mine submissions/delft\n"
        "  gslcosim bench rank submissions/* --out results/merged",
        add_arguments=_add_rank_arguments,
        run=_rank,
    ),
    Command(
        name="site",
        summary="write a static site of results: the table, each method, each case, and a player of flights",
        examples="  gslcosim bench site results/smoke --out site\n"
        "  gslcosim bench site results/mine submissions/* --out site",
        add_arguments=_add_site_arguments,
        run=_site,
    ),
)
