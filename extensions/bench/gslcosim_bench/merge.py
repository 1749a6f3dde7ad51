"""Merge of the shards of a suite into the results that one run of it would have left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gslcosim.base.checksums import write_checksums
from gslcosim.base.errors import UsageError
from gslcosim_bench.cases.models import MOST_SHARDS
from gslcosim_bench.cases.suite_files import load_suite, write_suite
from gslcosim_bench.execution.runner import median_reference_loop_s, sum_sessions
from gslcosim_bench.store import MAPS_SCHEMA, ResultsFolder, ShardFacts, is_machine_dependent

_compute: Any = pc
_MOST_NAMED = 8


@dataclass(frozen=True, kw_only=True)
class MergeSummary:
    """Merged shards: `n_trials` of the `n_chosen` that the shards share, and the shards that were not there."""

    folder: Path
    n_shards: int
    n_trials: int
    n_chosen: int
    missing: tuple[str, ...]


def merge_shards(folders: Sequence[Path], out: Path, *, is_partial: bool = False) -> MergeSummary:
    """Write the results of a suite whose shards were run apart, as one run would have left them.

    Rows, tracks, maps and whatever the manifest says of the suite are the same; wall times are those of all shards
    together. Recordings that the suite keeps are made when the suite is run again in the merged folder.

    Args:
        folders: One of each shard, in any order; the same shard twice does no harm.
        out: Where to: a new folder, or one of an earlier merge, whose contents are replaced.
        is_partial: Whether shards and trials may be missing.
    """
    shards = sorted(map(_ShardResults, dict.fromkeys(folders)), key=lambda shard: shard.facts["index"])
    for shard in shards[1:]:
        shard.check_fits(shards[0])
    missing = _missing_shards(shards)
    if not is_partial:
        _check_complete(shards, missing)
    trials, tracks = _merged_tables(shards)
    _check_out(out)
    folder = ResultsFolder(out)
    with folder.locked():
        write_suite(load_suite(shards[0].folder.suite, needs_seed=False), out)
        write_checksums(out, folder.suite.name)
        folder.write_tables(trials, tracks)
        folder.write_json(folder.maps, {"schema": MAPS_SCHEMA, "maps": _merged_maps(shards, trials)})
        folder.write_json(folder.manifest, _merged_manifest(shards))
        secrets = {trial: text for shard in shards for trial, text in shard.folder.read_agent_secrets().items()}
        folder.write_agent_secrets({trial: secrets[trial] for trial in trials["trial"].to_pylist() if trial in secrets})
    return MergeSummary(
        folder=out,
        n_shards=shards[0].facts["count"],
        n_trials=trials.num_rows,
        n_chosen=shards[0].facts["n_chosen"],
        missing=tuple(missing),
    )


class _ShardResults:
    def __init__(self, path: Path) -> None:
        self.folder = ResultsFolder(path)
        self.folder.check()
        if not self.folder.shard.is_file():
            raise UsageError(
                f"{path}: expected results of a shard (shard.json), found those of no shard. Run one with "
                "gslcosim bench run SUITE --shard I/N; gslcosim bench rank puts results of several authors together."
            )
        self.facts: ShardFacts = self.folder.read_json(self.folder.shard)  # pyright: ignore[reportAttributeAccessIssue]
        if not 1 <= self.facts["index"] <= self.facts["count"] <= MOST_SHARDS:
            raise UsageError(
                f"{self.folder.shard}: expected an index from 1 to count, and a count up to {MOST_SHARDS}, was "
                f"{self.name}. Take the file from a copy."
            )
        self.manifest: dict[str, Any] = self.folder.read_json(self.folder.manifest)

    @property
    def name(self) -> str:
        return f"{self.facts['index']}/{self.facts['count']}"

    @cached_property
    def tables(self) -> tuple[pa.Table, pa.Table]:
        """The rows of this shard's trials, and their tracks; rows of others that lie in the folder are left out."""
        listed = pa.array(list(self.facts["trials"]), pa.string())
        return tuple(table.filter(_compute.is_in(table["trial"], value_set=listed)) for table in self.folder.tables())  # pyright: ignore[reportReturnType]

    def check_fits(self, first: "_ShardResults") -> None:
        """Refuse a shard that is not of the same run of a suite as the first."""
        here, there, path = self.manifest, first.manifest, self.folder.path
        as_first = f"as {first.folder.path}"
        if any(here.get(key) != there.get(key) for key in ("suite", "suite_hash", "sandbox")):
            raise UsageError(
                f"{path}: expected a shard of suite {there.get('suite')} with the hash {there.get('suite_hash')}, "
                f"{as_first}, was one of suite {here.get('suite')} with the hash {here.get('suite_hash')}. "
                "Merge shards of one suite with one seed."
            )
        if here.get("software_hash") != there.get("software_hash"):
            raise UsageError(
                f"{path}: expected a shard that was run by {_software(there, here)}, {as_first}, was one by "
                f"{_software(here, there)}. Run it again with that version."
            )
        if changed := _changed_entries(here, there):
            raise UsageError(
                f"{path}: expected the entries of {first.folder.path}, was another program or other parameters of "
                f"{', '.join(changed)}. Run the shard again with the same suite."
            )
        if any(self.facts[key] != first.facts[key] for key in ("count", "only", "n_chosen")):
            raise UsageError(
                f"{path}: expected one of the {first.facts['count']} shards of {first.facts['n_chosen']} trials, "
                f"{as_first}, was shard {self.name} of {self.facts['n_chosen']} trials. Run all shards with the same "
                "N, --only and --filter."
            )


def _software(manifest: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    versions, others = (each.get("versions") or {} for each in (manifest, other))
    named = [name for name, version in versions.items() if others.get(name) != version] or ["gslcosim"]
    digest = str(manifest.get("software_hash"))[:16]
    return f"{', '.join(f'{name} {versions.get(name)}' for name in named)} (software {digest})"


def _changed_entries(here: Mapping[str, Any], there: Mapping[str, Any]) -> list[str]:
    a, b = ({entry["name"]: entry for entry in manifest.get("entries", [])} for manifest in (here, there))
    return [name for name in dict.fromkeys([*b, *a]) if a.get(name) != b.get(name)]


def _missing_shards(shards: Sequence[_ShardResults]) -> list[str]:
    count, found = shards[0].facts["count"], {shard.facts["index"] for shard in shards}
    return [f"{index}/{count}" for index in range(1, count + 1) if index not in found]


def _check_complete(shards: Sequence[_ShardResults], missing: Sequence[str]) -> None:
    if missing:
        raise UsageError(
            f"merge: expected all {shards[0].facts['count']} shards of suite {shards[0].manifest.get('suite')}, "
            f"{_listed(missing)} {'is' if len(missing) == 1 else 'are'} missing. Run them with gslcosim bench "
            f"run SUITE --shard {missing[0]}, or give --partial to merge what there is."
        )
    for shard in shards:
        n_left = len(shard.facts["trials"]) - shard.tables[0].num_rows
        if n_left:
            raise UsageError(
                f"{shard.folder.path}: expected all {len(shard.facts['trials'])} trials of shard {shard.name}, "
                f"{n_left} have no row. The same bench run goes on with it, or give --partial to merge what there is."
            )


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return f"{', '.join(names[:_MOST_NAMED])}{more}"


def _merged_tables(shards: Sequence[_ShardResults]) -> tuple[pa.Table, pa.Table]:
    places: dict[str, int] = {}
    homes: dict[str, int] = {}
    for i, shard in enumerate(shards):
        for trial in shard.tables[0]["trial"].to_pylist():
            if trial in homes:
                _check_same_row(trial, shards[homes[trial]], shard)
                continue
            homes[trial] = i
            places[trial] = shard.facts["trials"][trial]
    return (
        _in_order([shard.tables[0] for shard in shards], places, homes),
        _in_order([shard.tables[1] for shard in shards], places, homes),
    )


# Rows of one trial stay together in the order of their table.
def _in_order(tables: Sequence[pa.Table], places: Mapping[str, int], homes: Mapping[str, int]) -> pa.Table:
    kept = [
        table.filter(pa.array([homes.get(trial) == i for trial in table["trial"].to_pylist()], pa.bool_()))
        for i, table in enumerate(tables)
    ]
    table = pa.concat_tables(kept).combine_chunks()
    order = np.argsort([places[trial] for trial in table["trial"].to_pylist()], kind="stable")
    return table.take(pa.array(order, pa.int64())).combine_chunks()


def _check_same_row(trial: str, first: _ShardResults, other: _ShardResults) -> None:
    row, before = (
        shard.tables[0].filter(_compute.equal(shard.tables[0]["trial"], trial)).to_pylist()[0]
        for shard in (other, first)
    )
    for name, value in row.items():
        if not is_machine_dependent(name) and value != before[name]:
            raise UsageError(
                f"{other.folder.path}: expected trial {trial} ({row['entry']} in {row['case']}, repetition "
                f"{row['repetition']}) to have {name} {before[name]}, as in {first.folder.path}, was {value}. "
                "Run one of the two shards again, in a new folder."
            )


# In the order in which a run of all writes them: by scenario and, of one scenario, by case.
def _merged_maps(shards: Sequence[_ShardResults], trials: pa.Table) -> list[Any]:
    scenarios, cases = (trials[name].to_pylist() for name in ("scenario", "varied"))
    of_scenario = {name: i for i, name in enumerate(dict.fromkeys(scenarios))}
    of_case = {key: i for i, key in enumerate(dict.fromkeys(zip(scenarios, cases, strict=True)))}
    maps: dict[tuple[str, str], Any] = {}
    for shard in shards:
        for each in shard.folder.read_json(shard.folder.maps).get("maps", []):
            maps.setdefault((each["scenario"], each["varied"]), each)
    last = len(of_case)
    return [maps[key] for key in sorted(maps, key=lambda key: (of_scenario.get(key[0], last), of_case.get(key, last)))]


def _merged_manifest(shards: Sequence[_ShardResults]) -> dict[str, Any]:
    sessions = [session for shard in shards for session in shard.manifest.get("sessions", [])]
    machines = [shard.manifest.get("machine") or {} for shard in shards]
    cores = {machine.get("cores") for machine in machines}
    return {
        **shards[0].manifest,
        "machine": {
            "cpu": _each_once(machine.get("cpu") for machine in machines),
            "cores": cores.pop() if len(cores) == 1 else None,
            "platform": _each_once(machine.get("platform") for machine in machines),
            "reference_loop_s": median_reference_loop_s(sessions),
        },
        "wall": sum_sessions(sessions),
        "sessions": sessions,
        "recordings": {},
        "shards": {"count": shards[0].facts["count"], "merged": sorted({shard.facts["index"] for shard in shards})},
    }


def _each_once(texts: Any) -> str:
    return "; ".join(dict.fromkeys(text for text in texts if text))


def _check_out(out: Path) -> None:
    folder = ResultsFolder(out)
    if any(path.name != ".lock" for path in out.glob("*")) and "shards" not in folder.read_json(folder.manifest):
        raise UsageError(f"The folder of --out has other contents than merged shards: {out}. Choose a new folder.")
