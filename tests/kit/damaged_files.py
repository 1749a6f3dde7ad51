"""Damage that files take at random, and a count of what came of reading them."""

import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from gslcosim.base.errors import EnvironmentDataError


class FileFuzzer(ABC):
    """Damages files, reads them, and counts how many were refused with an error that names them and how many read.

    `blocks` are numbers that readers of binary files stumble over, `words` what readers of text do.
    """

    blocks: Sequence[bytes] = ()
    words: Sequence[bytes] = ()
    ignored_warnings: Sequence[type[Warning]] = ()

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.rng = folder, np.random.default_rng(seed)
        self.n_refused = self.n_read = 0

    @abstractmethod
    def round(self) -> None:
        """Damage each file once."""

    def damage(self, content: bytes) -> bytes:
        """Return bytes with a few of them changed, replaced, cut out, doubled or cut off."""
        result, rng = bytearray(content), self.rng
        for _ in range(int(rng.integers(1, 5))):
            at = int(rng.integers(len(result))) if result else 0
            match int(rng.integers(7 if self.words else 5)):
                case 0:
                    result[at : at + 1] = bytes([int(rng.integers(256))])
                case 1:
                    block = self.blocks[int(rng.integers(len(self.blocks)))]
                    result[at : at + len(block)] = block
                case 2:
                    del result[at : at + int(rng.integers(1, 40))]
                case 3:
                    result[at:at] = result[at : at + int(rng.integers(1, 40))]
                case 4:
                    del result[at:]
                case _:
                    end = at + len(result[at:].split(maxsplit=1)[0]) if result[at:].strip() else at
                    result[at:end] = self.words[int(rng.integers(len(self.words)))]
        return bytes(result)

    def try_file(self, path: Path, read: Callable[[], object]) -> None:
        """Damage a file, read it, and make it whole again."""
        sound = path.read_bytes()
        path.write_bytes(self.damage(sound))
        try:
            self.attempt(read, path)
        finally:
            path.write_bytes(sound)

    def attempt(self, read: Callable[[], object], path: Path) -> None:
        """Read a damaged file."""
        try:
            with warnings.catch_warnings(action="error"):
                for category in self.ignored_warnings:
                    warnings.simplefilter("ignore", category)
                read()
            self.n_read += 1
        except EnvironmentDataError as error:
            self.n_refused += 1
            if "File: " not in str(error) and "Folder: " not in str(error):
                pytest.fail(f"the error does not name the file: {error}")
        except Exception as error:
            error.add_note(f"{path}: {path.read_bytes()[:3000]!r}")
            raise

    @classmethod
    def run_for(cls, folder: Path, duration_s: float) -> "FileFuzzer":
        """Damage files for a time, with a new seed, which a failure names."""
        seed = time.time_ns() % 2**32
        fuzzer, end = cls(folder, seed), time.monotonic() + duration_s
        while time.monotonic() < end:
            try:
                fuzzer.round()
            except Exception as error:
                error.add_note(f"seed {seed}, after {fuzzer.n_read + fuzzer.n_refused} files in {folder}")
                raise
        return fuzzer
