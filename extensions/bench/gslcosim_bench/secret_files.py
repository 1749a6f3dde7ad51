"""Recognition of files that no result and no bundle may hold: private keys and secrets of sealed suites."""

import re
from pathlib import Path

from gslcosim.base.files import read_regular_file

# A longer file is neither.
_MAX_BYTES = 64 << 10
_PRIVATE_KEY = re.compile(rb"-----BEGIN [A-Z ]*PRIVATE KEY-----")
_SEAL = re.compile(rb"gslcosim/seal/")


def holds_secret(path: Path) -> bool:
    """Return whether a file is a private key or the secret of a sealed suite."""
    try:
        data = read_regular_file(path, max_bytes=_MAX_BYTES)
    except OSError:
        return False
    return _PRIVATE_KEY.search(data) is not None or (_SEAL.search(data) is not None and b'"nonce"' in data)
