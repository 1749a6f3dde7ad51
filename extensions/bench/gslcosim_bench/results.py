"""Results in Python: tables of pyarrow, arrays by column, and paired comparison of two entries."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.pairs import sign_flip
from gslcosim_bench.statistics.ranking import estimate_means
from gslcosim_bench.statistics.rates import pool_design_effect, rate_over_units
from gslcosim_bench.statistics.sampling_units import Level, SamplingUnits, find_sampling_units
from gslcosim_bench.statistics.times import restricted_mean
from gslcosim_bench.store import TRACKS, TRIALS, ResultsFolder

_compute: Any = pc
# Rows that agree in these are runs of the same case, repetition and gas: they make a pair.
PAIR = ("case", "repetition", "is_control")


UNIT_COLUMNS = ("environment_hash", "gas_seed", "case")
"""Columns that say which room, plume and case a run was of."""


@dataclass(frozen=True)
class Results:
    """The rows of a results folder, all or some of them.

    `trials` has the columns of `gslcosim_bench.store.TRIAL_COLUMNS`. Figures leave controls out; select
    them with `select(is_control=True)`.
    """

    folder: Path
    trials: pa.Table

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Read a results folder.

        Raises:
            UsageError: it is none, or a table of it is damaged.
        """
        results = ResultsFolder(Path(folder))
        results.check()
        return cls(results.path, results.trial_table())

    def __len__(self) -> int:
        """Return the number of rows."""
        return self.trials.num_rows

    @property
    def entries(self) -> tuple[str, ...]:
        """The names of the entries, in the order of the rows."""
        return tuple(dict.fromkeys(self.trials["entry"].to_pylist()))

    @property
    def cases(self) -> tuple[str, ...]:
        """The names of the cases, in the order of the rows."""
        return tuple(dict.fromkeys(self.trials["case"].to_pylist()))

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Manifest: how the results were made."""
        folder = ResultsFolder(self.folder)
        return folder.read_json(folder.manifest)

    def select(self, **columns: Any) -> Self:
        """Return the rows in which each of the columns has the value, or one of the values, that is given.

        For example `select(entry=["e_coli", "surge_cast"], family="complex", is_control=False)`.

        Raises:
            UsageError: there is no such column.
        """
        table = self.trials
        for name, value in columns.items():
            self._check(name)
            values = value if isinstance(value, list | tuple | set) else [value]
            allowed = pa.array(list(values), type=TRIALS.field(name).type)
            table = table.filter(_compute.is_in(table[name], value_set=allowed))
        return type(self)(self.folder, table)

    def array(self, column: str) -> NDArray[Any]:
        """Return a column as an array; absent numbers are nan.

        Raises:
            UsageError: there is no such column.
        """
        self._check(column)
        values = self.trials[column]
        if pa.types.is_integer(values.type) and values.null_count:
            values = values.cast(pa.float64())
        return values.to_numpy(zero_copy_only=False)

    def tracks(self) -> pa.Table:
        """Return the tracks of these rows, as `gslcosim_bench.store.TRACK_COLUMNS` has them."""
        table = ResultsFolder(self.folder).track_table()
        if table is None:
            return TRACKS.empty_table()
        return table.filter(_compute.is_in(table["trial"], value_set=self.trials["trial"].combine_chunks()))

    def success(self, entry: str) -> Estimate:
        """Return the success rate of an entry, with Wilson's interval for as many runs as its rooms are worth.

        Each case counts the same. How alike the runs of a room are is taken from all entries here where an entry
        always or never succeeds.
        """
        effect = pool_design_effect(
            (rows.array("success").astype(bool), rows.sampling_units()) for rows in map(self._of, self.entries)
        )
        rows = self._of(entry)
        return rate_over_units(rows.array("success").astype(bool), rows.sampling_units(), effect=effect)

    def mean_time_s(self, entry: str) -> Estimate:
        """Return the mean over cases of min(time to source, limit) of an entry [s]; failures count with the limit."""
        rows = self._of(entry)
        units = rows.sampling_units()
        return restricted_mean(
            rows.array("time_s"),
            rows.array("success").astype(bool),
            rows.array("time_limit_s").astype(float),
            clusters=units.clusters,
            cells=units.case,
        )

    def sampling_units(self) -> SamplingUnits:
        """Return what intervals draw: whole rooms where there are six or more, else whole plumes, else single runs."""
        return find_sampling_units(*(self.array(name) for name in UNIT_COLUMNS))

    def paired(self, column: str, a: str, b: str) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return a column of two entries on the runs that both have made, pair by pair.

        Raises:
            UsageError: they have none in common, or there is no such column.
        """
        self._check(column)
        both = [self._by_pair(entry, column) for entry in (a, b)]
        keys = [key for key in both[0] if key in both[1]]
        if not keys:
            raise UsageError(
                f"{self.folder}: expected flights of {a} and {b} in the same cases, found none. "
                f"Entries: {', '.join(self.entries)}."
            )
        first, second = (np.array([values[key] for key in keys]) for values in both)
        return first, second

    def _by_pair(self, entry: str, column: str) -> dict[tuple[Any, ...], Any]:
        rows = self.select(entry=entry)
        keys = zip(*(rows.trials[name].to_pylist() for name in PAIR), strict=True)
        return dict(zip(keys, rows.array(column), strict=True))

    def _of(self, entry: str) -> Self:
        rows = self.select(entry=entry)
        if not len(rows):
            raise UsageError(f"{self.folder}: expected one of the entries {', '.join(self.entries)}, was {entry!r}.")
        return (
            rows
            if rows.trials["is_control"].combine_chunks().true_count == len(rows)
            else rows.select(is_control=False)
        )

    def _check(self, column: str) -> None:
        if column not in TRIALS.names:
            raise UsageError(f"{column}: expected a column of the trials ({', '.join(TRIALS.names)}), found none.")


def read_state(folder: str | Path) -> dict[str, Any]:
    """Return how far the run of a suite in a folder is: while it goes on, or what it left.

    `run` is what the run that works there says of itself, None where there is none; `entries` are the runs with gas of
    each entry and how many found the source.

    Raises:
        UsageError: no suite has been run there, or a table is damaged.
    """
    results = ResultsFolder(Path(folder))
    if not results.manifest.is_file():
        raise UsageError(
            f"{folder}: expected a folder of results (manifest.json), found none. Run one: gslcosim bench run SUITE."
        )
    n_planned = results.read_json(results.manifest).get("n_planned")
    if results.shard.is_file():
        n_planned = len(results.read_json(results.shard)["trials"])
    rows = results.rows()
    entries: dict[str, dict[str, int]] = {}
    for row in rows:
        if not row["is_control"]:
            counts = entries.setdefault(row["entry"], {"n": 0, "found": 0})
            counts["n"] += 1
            counts["found"] += bool(row["success"])
    is_running = results.is_in_use
    is_complete = n_planned is not None and len(rows) >= n_planned
    return {
        "folder": str(folder),
        "state": "running" if is_running else "complete" if is_complete else "not complete",
        "n_rows": len(rows),
        "n_planned": n_planned,
        "n_without_result": sum(row["status"] != "flown" for row in rows),
        "entries": entries,
        "run": (results.read_json(results.status) or None) if is_running else None,
    }


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two entries on their pairs: `a` minus `b`.

    `success` is the difference in success, `time_s` that in the restricted mean time [s], `success_p` and `time_p`
    those of the sign-flip test; `better` is how likely `a` is the quicker one on a pair, ties half. Cases count the
    same, however many runs they have. Intervals and tests draw what `drawn` says: whole rooms, whole plumes or single
    runs.
    """

    a: str
    b: str
    n: int
    success: Estimate
    success_p: float
    time_s: Estimate
    time_p: float
    better: Estimate
    drawn: Level = "flights"


def compare(results: Results, a: str, b: str) -> Comparison:
    """Return the comparison of an entry with another on the runs that both have made, controls apart.

    It is that of these two alone: of many pairs, the report's comparison holds for all of them together.

    Raises:
        UsageError: they have no runs in common.
    """
    rows = results.select(is_control=False)
    success_a, success_b = (values.astype(float) for values in rows.paired("success", a, b))
    time_a, time_b = (values.astype(float) for values in rows.paired("time_s", a, b))
    units = find_sampling_units(*(rows.paired(name, a, b)[0] for name in UNIT_COLUMNS))
    is_quicker = 0.5 + 0.5 * np.sign(time_b - time_a)
    success = estimate_means((success_a - success_b)[:, None], units, units.case, bounds=(-1.0, 1.0))[0]
    better = estimate_means(is_quicker[:, None], units, units.case, bounds=(0.0, 1.0))[0]
    # Cases of few runs weigh as much as others in the sums of the test too.
    of_case = np.bincount(units.case)
    weight = of_case.max() / of_case[units.case]
    return Comparison(
        a=a,
        b=b,
        n=len(success_a),
        success=success,
        success_p=sign_flip(weight * success_a, weight * success_b, clusters=units.clusters),
        time_s=estimate_means((time_a - time_b)[:, None], units, units.case)[0],
        time_p=sign_flip(weight * time_a, weight * time_b, clusters=units.clusters),
        better=better,
        drawn=units.level,
    )
