"""Sealed seeds: an organiser commits to a suite's seed before methods are handed in, and reveals it afterwards.

commitment = SHA-256(recipe / seed / nonce). The recipe is a hash of the suite's cases and scenario files without their
seed, so neither can be changed once the commitment is published. The nonce keeps anybody from trying seeds.
"""

import hashlib
import json
import os
import secrets
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Required, TypedDict

from gslcosim.base.errors import UsageError, build_machine_error
from gslcosim.base.files import read_regular_file
from gslcosim.base.untrusted_input import read_json
from gslcosim.base.yaml_core import without_editor_header
from gslcosim_bench.cases.spec_files import find_scenario_beside
from gslcosim_bench.cases.suite_files import LoadedSuite, load_suite, write_suite
from gslcosim_bench.studies.target import collect_bundled_seeds, collect_seeds

SCHEMA = "gslcosim/seal/1"
_SEED_BITS, _NONCE_BYTES = 63, 16
_MAX_DRAWS = 100
# Entries, what they are compared with, and what is recorded of them belong to those who take part.
_NO_RECIPE = {
    "seed", "sealed", "include", "entries", "anchors", "nulls", "record", "limits", "sandbox", "title", "question",
}  # fmt: skip


class _CommitmentFile(TypedDict):
    schema: Required[str]
    suite: Required[str]
    recipe: Required[str]
    commitment: Required[str]


class _SecretFile(_CommitmentFile):
    seed: Required[int]
    nonce: Required[str]


@dataclass(frozen=True, kw_only=True)
class Seal:
    """A sealed seed: what is published (suite, recipe and commitment), and what the organiser keeps (seed, nonce)."""

    suite: str
    recipe: str
    seed: int
    nonce: str

    @property
    def commitment(self) -> str:
        """SHA-256 that fixes seed and recipe, as 64 hexadecimal digits."""
        text = "/".join((SCHEMA, self.recipe, str(self.seed), self.nonce))
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def public(self) -> dict[str, str]:
        """Content of the commitment's file."""
        return {"schema": SCHEMA, "suite": self.suite, "recipe": self.recipe, "commitment": self.commitment}


@dataclass(frozen=True, kw_only=True)
class SealFiles:
    """The two files of a seal: the commitment to publish, and the secret to keep."""

    commitment: Path
    secret: Path


def seal_suite(source: str | Path) -> Seal:
    """Draw a seed for a suite from the system's randomness.

    None of the seeds that follow from it, of rooms, runs and gas, is one of the suite as it is or of a bundled suite.
    `bench tune` trains on none of these either.
    """
    public = load_suite(source, is_flown=True)
    taken = collect_seeds(public) | collect_bundled_seeds()
    for _ in range(_MAX_DRAWS):
        seed = secrets.randbits(_SEED_BITS)
        if not collect_seeds(load_suite(source, seed=seed)) & taken:
            return Seal(
                suite=public.suite.name, recipe=hash_recipe(public), seed=seed, nonce=secrets.token_hex(_NONCE_BYTES)
            )
    raise UsageError(
        f"{source}: expected cases that follow from the suite's seed, some have seeds of their own (seeds, split). "
        "Seal a suite without such scenarios."
    )


def hash_recipe(loaded: LoadedSuite, *, has_editor_lines: bool = False) -> str:
    """Return a hash of what decides the cases of a suite beside its seed: suites with scenarios, and their files.

    Args:
        has_editor_lines: Whether lines for editors count, which copies of files lack: they do in seals of 0.1.
    """
    digest = hashlib.sha256()
    for part in _list_recipe(loaded, has_editor_lines=has_editor_lines):
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()


def _list_recipe(loaded: LoadedSuite, *, has_editor_lines: bool) -> Iterator[bytes]:
    for inner in loaded.included:
        yield from _list_recipe(inner, has_editor_lines=has_editor_lines)
    if not loaded.suite.scenarios:
        return
    # The folder of results names the scenarios' files anew; their content counts.
    values = loaded.suite.model_dump(mode="json", exclude=_NO_RECIPE)
    for spec in values["scenarios"]:
        spec.pop("source")
        # A key that is younger than seals counts where it is set.
        if spec["source_height_m"] is None:
            spec.pop("source_height_m")
    yield json.dumps(values, sort_keys=True).encode()
    for spec in loaded.suite.scenarios:
        if spec.split is None:
            content = read_regular_file(find_scenario_beside(spec.source, loaded.directory))
            yield content if has_editor_lines else without_editor_header(content)


def write_seal(seal: Seal, folder: Path) -> SealFiles:
    """Write `SUITE.commitment.json`, to publish, and `SUITE.secret.json`, which its owner alone reads."""
    files = SealFiles(commitment=folder / f"{seal.suite}.commitment.json", secret=folder / f"{seal.suite}.secret.json")
    if found := next((path for path in (files.secret, files.commitment) if os.path.lexists(path)), None):
        raise UsageError(
            f"{found}: expected a folder without a seal of {seal.suite}, was a file that is there. "
            "A second seal would let you choose between them: move the first away, or choose another folder."
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with os.fdopen(os.open(files.secret, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(_to_text({**seal.public, "seed": seal.seed, "nonce": seal.nonce}))
        files.commitment.write_text(_to_text(seal.public), encoding="utf-8")
    except OSError as error:
        raise build_machine_error(error, "seal", "a file that can be written", path=folder) from error
    return files


def _to_text(values: Mapping[str, str | int]) -> str:
    return json.dumps(values, indent=2) + "\n"


def read_seal(path: Path) -> Seal:
    """Read a secret and check that its commitment is its own."""
    values = read_json(path, _SecretFile, remedy="Give the file SUITE.secret.json that bench seal wrote.")
    _check_schema(values["schema"], path)
    seal = Seal(suite=values["suite"], recipe=values["recipe"], seed=values["seed"], nonce=values["nonce"])
    if seal.commitment != values["commitment"]:
        raise UsageError(
            f"{path}: expected a seed of commitment {values['commitment']}, was one of {seal.commitment}. "
            "The file was changed: take it from a copy."
        )
    return seal


def load_sealed_suite(source: str | Path, secret: Path, *, is_flown: bool = False) -> LoadedSuite:
    """Return a suite with the sealed seed, which nothing that is written of it shows.

    Args:
        source: The suite that was sealed, or one that includes it.
        is_flown: Whether its scenarios and the programs of its entries have to be there.
    """
    seal = read_seal(secret)
    loaded = load_suite(source, seed=seal.seed, commitment=seal.commitment, is_flown=is_flown)
    _check_recipe(seal, loaded, f"{source}")
    return loaded


def _check_recipe(seal: Seal, loaded: LoadedSuite, place: str) -> None:
    recipe = hash_recipe(loaded)
    if seal.recipe not in (recipe, hash_recipe(loaded, has_editor_lines=True)):
        raise UsageError(
            f"{place}: expected the cases of {seal.suite} as they were sealed, recipe {seal.recipe[:16]}, was "
            f"{recipe[:16]}. Take the files of that time, or seal again."
        )


def reveal_suite(source: str | Path, secret: Path, commitment: Path, folder: Path) -> LoadedSuite:
    """Check that a secret is what was committed to, and write the suite with its seed.

    Args:
        folder: Where the suite is written, with what of its files is not bundled; it has to be new.
    """
    seal = read_seal(secret)
    public = read_json(commitment, _CommitmentFile, remedy="Give the file SUITE.commitment.json that was published.")
    _check_schema(public["schema"], commitment)
    if public["commitment"] != seal.commitment:
        raise UsageError(
            f"{secret}: expected the seed of commitment {public['commitment']}, was that of {seal.commitment}. "
            "The seed is not the one that was committed to."
        )
    loaded = load_suite(source, seed=seal.seed, is_flown=True)
    _check_recipe(seal, loaded, f"{source}")
    if folder.exists():
        raise UsageError(f"{folder}: expected a new folder, was one that is there. Choose another.")
    try:
        write_suite(loaded, folder)
    except OSError as error:
        raise build_machine_error(error, "suite", "a folder that can be written", path=folder) from error
    return loaded


def _check_schema(schema: str, path: Path) -> None:
    if schema != SCHEMA:
        raise UsageError(f"{path}: expected schema {SCHEMA}, was {schema}. Give a file that bench seal wrote.")
