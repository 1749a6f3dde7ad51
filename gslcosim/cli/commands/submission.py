"""Submissions of `gslcosim bench`: keys and signed results."""

import argparse
from pathlib import Path

from gslcosim.cli.arguments import Command
from gslcosim.cli.terminal import add_json_option, write, write_json


def _add_keygen_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument("file", type=Path, metavar="FILE", help="file of the new key; the public part is in FILE.pub")
    parser.add_argument("--name", default="", metavar="NAME", help="comment of the public key")


def _keygen(arguments: argparse.Namespace) -> int:
    from gslcosim.bench.signing.keys import write_key

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
    from datetime import UTC, datetime

    from gslcosim.bench.signing.signed_results import sign_results
    from gslcosim.cli.run_output import format_signature, signature_to_json

    now = datetime.now(UTC).isoformat(timespec="seconds")
    signed = sign_results(arguments.results, arguments.key, author=arguments.name, signed_at=now)
    if arguments.json:
        write_json(signature_to_json(signed))
    else:
        write(format_signature(signed))
    return 0


COMMANDS = (
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
)
