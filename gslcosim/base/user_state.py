"""Folder of state that a user has found out and cannot compute again: outside of all folders that others send."""

import os
from pathlib import Path


def user_state_folder() -> Path:
    """Return the folder of this user's state; it need not exist, and no sandbox sees it.

    `GSLCOSIM_STATE` overrides it; otherwise `$XDG_STATE_HOME/gslcosim` or `~/.local/state/gslcosim`.
    """
    if chosen := os.environ.get("GSLCOSIM_STATE"):
        return Path(chosen).expanduser().absolute()
    base = os.environ.get("XDG_STATE_HOME") or "~/.local/state"
    return Path(base).expanduser() / "gslcosim"
