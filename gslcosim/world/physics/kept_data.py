"""What a snapshot holds of MuJoCo's data: the state from which the next steps follow."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

from typing import Any

import mujoco
import numpy as np

from gslcosim.states.state_values import keep_foreign

# All that integration depends on: time, positions, velocities, forces that are applied, and where the solver starts.
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
# What our own control reads of the step before, beside it.
_READ = ("qacc", "qfrc_constraint", "sensordata")


def keep_mujoco_data() -> None:
    """Let snapshots hold MuJoCo's data."""
    keep_foreign(mujoco.MjData, read=_read, bring_back=_bring_back)


def _read(data: Any) -> dict[str, Any]:
    state = np.zeros(mujoco.mj_stateSize(data.model, _STATE))
    mujoco.mj_getState(data.model, data, state, _STATE)
    return {"state": state, **{name: getattr(data, name).copy() for name in _READ}}


def _bring_back(data: Any, kept: dict[str, Any]) -> None:
    mujoco.mj_setState(data.model, data, kept["state"], _STATE)
    for name in _READ:
        getattr(data, name)[:] = kept[name]
