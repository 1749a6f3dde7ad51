"""Kinds of files that this package registers: families and train files, with their checks."""

import json

from gslcosim.base.bundled import FAMILY_FILE, bundled_families, bundled_train_files
from gslcosim.scenario.checks.registry import Check, FileKind, ValidFile, find_problems
from gslcosim_bench.cases.spec_files import raise_located

FAMILY = FileKind(
    name="family",
    words="family",
    ending=FAMILY_FILE,
    list_bundled=bundled_families,
    validator="gslcosim_training.file_kinds:validate_family",
    checks=(Check(name="first cases", of="family", finder="gslcosim_training.train_checks:find_case_problems"),),
)
TRAIN = FileKind(
    name="train",
    words="training",
    ending=".train.yaml",
    list_bundled=bundled_train_files,
    validator="gslcosim_training.file_kinds:validate_train_file",
    checks=(
        Check(name="trainer", of="train", finder="gslcosim_training.train_checks:find_trainer_problems"),
        Check(name="flights", of="train", finder="gslcosim_training.train_checks:find_flight_problems"),
    ),
)


def validate_family(path: str, seed: int | None) -> ValidFile:
    """Return the outcome of the check of a family for `gslcosim validate`."""
    from gslcosim_training.family import SPLITS, load_family

    del seed
    family = load_family(path)
    raise_located(find_problems("family", family, family.directory), family.path, shown_path=path)
    seeds = ", ".join(f"{family.spec.seeds.of(split).count} of {split}" for split in SPLITS)
    return ValidFile(
        sentence=f"Family {family.name}, seeds: {seeds}.",
        content={"family": json.loads(family.spec.model_dump_json(by_alias=True, exclude_none=True))},
    )


def validate_train_file(path: str, seed: int | None) -> ValidFile:
    """Return the outcome of the check of a train file for `gslcosim validate`.

    Args:
        seed: None: `gslcosim train` takes it from the file.
    """
    from gslcosim_training.train_file import load_train_file

    del seed
    file = load_train_file(path, is_flown=True)
    return ValidFile(
        sentence=f"Training {file.spec.name} with {file.spec.trainer.kind} in the family {file.family.name}.",
        content={"train": json.loads(file.spec.model_dump_json(by_alias=True, exclude_none=True))},
    )
