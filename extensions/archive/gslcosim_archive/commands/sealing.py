"""Sealed seeds of `gslcosim bench`: commit to a seed, fly it, and reveal it."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import Command, CommandOptions, Run
from gslcosim.cli.terminal import add_json_option, write, write_json

if TYPE_CHECKING:
    from gslcosim_bench.cases import LoadedSuite


def _add_seal_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("suite", metavar="SUITE", help="a suite file, or the name of a bundled suite")
    parser.add_argument(
        "--out", type=Path, default=Path(), metavar="FOLDER", help="folder of both files (default: this one)"
    )


def _seal(arguments: argparse.Namespace) -> int:
    from gslcosim_archive.sealing import seal_suite, write_seal

    seal = seal_suite(arguments.suite)
    files = write_seal(seal, arguments.out)
    if arguments.json:
        write_json({**seal.public, "published": str(files.commitment), "secret": str(files.secret)})
    else:
        write(f"Keep to yourself: {files.secret}\nPublish: {files.commitment}\nCommitment: {seal.commitment}")
    return 0


def _add_reveal_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("suite", metavar="SUITE", help="the suite that was sealed")
    parser.add_argument("secret", type=Path, metavar="SECRET", help="SUITE.secret.json of bench seal")
    parser.add_argument("commitment", type=Path, metavar="COMMITMENT", help="SUITE.commitment.json, as published")
    parser.add_argument(
        "--out", type=Path, metavar="FOLDER", help="new folder of the suite with its seed (default: SUITE_revealed)"
    )


def _reveal(arguments: argparse.Namespace) -> int:
    from gslcosim_archive.sealing import reveal_suite
    from gslcosim_bench.cases import load_suite

    folder = arguments.out or Path(f"{load_suite(arguments.suite).suite.name}_revealed")
    loaded = reveal_suite(arguments.suite, arguments.secret, arguments.commitment, folder)
    if arguments.json:
        write_json({"suite": loaded.suite.name, "seed": loaded.suite.seed, "folder": str(folder)})
    else:
        write(f"The seed is the one that was committed to: {loaded.suite.seed}\nSuite: {folder / 'suite.yaml'}")
    return 0


def _add_sealed_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--sealed", type=Path, metavar="SECRET", help="take the seed from the secret that bench seal wrote"
    )


def _run_sealed(arguments: argparse.Namespace, run: Run) -> int:
    def load(source: str | Path, *, seed: int | None = None, is_flown: bool = False) -> "LoadedSuite":
        from gslcosim_archive.sealing import load_sealed_suite

        if seed is not None:
            raise UsageError("--seed: expected one seed, were two: the sealed one of --sealed too. Leave one out.")
        return load_sealed_suite(source, arguments.sealed, is_flown=is_flown)

    if arguments.sealed is not None:
        arguments.load_suite = load
    return run(arguments)


SEALED = CommandOptions(add_arguments=_add_sealed_option, run=_run_sealed)
COMMANDS = (
    Command(
        name="seal",
        summary="draw a secret seed of a suite and commit to it",
        examples="  gslcosim bench seal open_2026\n  gslcosim bench seal my_suite.yaml --out contest",
        add_arguments=_add_seal_arguments,
        run=_seal,
    ),
    Command(
        name="reveal",
        summary="check a sealed seed and write the suite with it",
        examples="  gslcosim bench reveal open_2026 open_2026.secret.json open_2026.commitment.json",
        add_arguments=_add_reveal_arguments,
        run=_reveal,
    ),
)
