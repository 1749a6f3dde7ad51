"""Checkpoints: all that a training needs to continue, in one file that is never half written."""

import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.files import replace_file
from gslcosim.base.untrusted_json import MalformedFileError, parse_json

CHECKPOINT = "checkpoint.npz"
SCHEMA = "gslcosim/checkpoint/1"
_ABOUT, _TRAINER, _BEST = "about", "trainer.", "best."
_NOT_READABLE = (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """A training between two rounds.

    Attributes:
        identity: Of the train file and its family.
        trainer: The state of the trainer.
        best: The arrays of the best policy so far; empty where it has none.
        about: What else is to be kept, as plain values: curves, times, settings of the best policy.
    """

    identity: str
    trainer: Mapping[str, NDArray[Any]]
    best: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    about: Mapping[str, Any] = field(default_factory=dict[str, Any])


class _About(TypedDict):
    schema: str
    identity: str
    about: dict[str, object]


def save_checkpoint(folder: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint into a folder, in place of the one before.

    Raises:
        UsageError: it cannot be written; the one before is still there.
    """
    about = {"schema": SCHEMA, "identity": checkpoint.identity, "about": dict(checkpoint.about)}
    arrays = {f"{_TRAINER}{name}": array for name, array in checkpoint.trainer.items()}
    arrays |= {f"{_BEST}{name}": array for name, array in checkpoint.best.items()}
    file = io.BytesIO()
    np.savez_compressed(file, allow_pickle=False, **{_ABOUT: np.array(json.dumps(about)), **arrays})
    try:
        replace_file(folder, CHECKPOINT, file.getvalue())
    except OSError as error:
        raise UsageError(f"{folder / CHECKPOINT}: expected a file that can be written, got: {error}.") from error


def load_checkpoint(folder: Path, *, identity: str) -> Checkpoint:
    """Return the checkpoint of a folder.

    Args:
        folder: Of the training.
        identity: Of the train file that goes on.

    Raises:
        UsageError: there is none, it is corrupt, or it is that of another train file.
    """
    path = folder / CHECKPOINT
    if not path.is_file():
        raise UsageError(f"{path}: expected a checkpoint to go on from, found none. Leave out --resume.")
    try:
        with np.lib.npyio.NpzFile(io.BytesIO(path.read_bytes()), own_fid=True, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header = parse_json(str(arrays.pop(_ABOUT)[()]), _About, place=_ABOUT)
        schema, found, about = header["schema"], header["identity"], header["about"]
    except (*_NOT_READABLE, IndexError, MalformedFileError) as error:
        raise UsageError(
            f"{path}: expected a checkpoint of gslcosim train, was a file that is corrupt ({error}). Take it away and "
            "train anew without --resume."
        ) from error
    if schema != SCHEMA:
        raise UsageError(f"{path}: expected a checkpoint of schema {SCHEMA}, was {schema!r}. Train anew.")
    if found != identity:
        raise UsageError(
            f"{path}: expected a checkpoint of this train file and family, was one of another or of what they were "
            "before. Give another folder with --out."
        )
    return Checkpoint(
        identity=identity,
        trainer={name.removeprefix(_TRAINER): array for name, array in arrays.items() if name.startswith(_TRAINER)},
        best={name.removeprefix(_BEST): array for name, array in arrays.items() if name.startswith(_BEST)},
        about=about,
    )
