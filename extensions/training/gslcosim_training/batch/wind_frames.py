"""Wind frames of a batch: the kernel of one search over many."""

# pyright: basic, reportCallIssue=false
# ruff: noqa: ANN001, ANN202 - kernels have no types

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim_search.learned.wind_frame import (
    N_STATE,
    UPWIND,
    advance_wind_frame,
    begin_wind_frame,
    find_columns,
)
from gslcosim_training.batch.reference_free_kernels import reference_free_njit


@reference_free_njit()
def _begin(rows, states):
    for n in range(len(rows)):
        begin_wind_frame(states[rows[n]])


@reference_free_njit()
def _advance(rows, i_cases, states, observations, columns, first, halves_m, limits_s):
    for n in range(len(rows)):
        i = rows[n]
        k = i_cases[i]
        advance_wind_frame(states[i], observations[i], columns, first, halves_m[k, 0], halves_m[k, 1], limits_s[k])


class BatchWindFrames:
    """The wind frames of all searches of a batch; each is that of `WindFrame`, to the bit.

    Args:
        names: Of the numbers of an observation before those of the frame.
        n_envs: How many searches.
        cases: Records of `CASE`.

    Held by:
        extensions/training/tests/unit/batch/test_wind_frames.py
    """

    def __init__(self, names: Sequence[str], n_envs: int, cases: NDArray[np.void]) -> None:
        self._columns, self._first = np.array(find_columns(names), np.int64), len(names)
        self._halves_m = np.ascontiguousarray(cases["half_m"])
        self._limits_s = np.ascontiguousarray(cases["time_limit_s"])
        self._states = np.zeros((n_envs, N_STATE))
        self.begin(np.arange(n_envs))

    @property
    def upwind(self) -> NDArray[np.float64]:
        """The directions that winds come from, (n_envs, 2): unit vectors, world frame."""
        return self._states[:, UPWIND]

    @property
    def bytes_per_env(self) -> int:
        """Bytes that each search takes."""
        return self._states.itemsize * N_STATE

    def begin(self, rows: NDArray[np.int64]) -> None:
        """Forget all of searches that begin."""
        _begin(rows, self._states)

    def advance(self, rows: NDArray[np.int64], i_cases: NDArray[np.int64], observations: NDArray[np.float32]) -> None:
        """Take observations of searches in, and write the frames' numbers behind their own.

        Args:
            rows: Which searches.
            i_cases: The case of each search, (n_envs,).
            observations: (n_envs, n_numbers) of all; written.
        """
        _advance(
            rows, np.ascontiguousarray(i_cases), self._states, observations, self._columns, self._first, self._halves_m,
            self._limits_s,
        )  # fmt: skip
