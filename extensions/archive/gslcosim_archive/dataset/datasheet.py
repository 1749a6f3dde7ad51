"""Datasheet of a dataset: what it has, how it came to be, and what does not follow from it.

Its sections are those of Gebru et al., "Datasheets for Datasets", Communications of the ACM 64 (2021) 12, 86–92.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from gslcosim_archive.dataset.croissant import Publication, PublishedFile, build_citation
from gslcosim_archive.dataset.tables import LEFT_OUT, Origin, PublishedTable, remove_folders
from gslcosim_bench.report.templates import build_environment
from gslcosim_bench.store import WALL, ManifestEntry, ResultsManifest
from gslcosim_data.text_tables import escape_markdown, format_code, format_markdown_table

_compute: Any = pc

EXAMPLE = """import pandas as pd

trials = pd.read_parquet("trials.parquet")
with_gas = trials[~trials.is_control]
success = with_gas.groupby("entry").success.mean().sort_values()
success.plot.barh(xlabel="share of flights with success").figure.savefig("success.png", bbox_inches="tight")
"""
"""Five lines of a reader's first figure; docs/benchmark/dataset.md has them too."""

COLLECTION = (
    "Each row is one simulated flight in gslcosim: a search method (entry) decides for a robot in a room with wind and "
    "gas until it succeeds or the time limit ends. All entries of a case and repetition meet the same room, wind, gas "
    "and sensor noise."
)
PREPROCESSING = (
    "Rows are those that gslcosim bench run wrote. The lists of tracks.parquet became rows; the column "
    f"{', '.join(LEFT_OUT)} is left out, and absolute paths in texts are shortened to their last part. Nothing else "
    "was changed, and no row was removed."
)
PRIVACY = "Robots and rooms are simulated: there are no data about people."
USES = (
    "Compare search methods on equal cases, pair by pair.",
    "Look at how flights went: paths, gas on the way, errors of declared places.",
    "Test statistics of benchmarks on rows whose cases are known.",
)
LIMITS = (
    "Flights are not independent: those in one room (environment_hash) are alike, and those in one plume (gas_seed) "
    "more so. Intervals that count each flight as an observation are too narrow; draw whole rooms. gslcosim bench "
    "report does so.",
    "A difference of two means is no ranking: compare entries on the same case and repetition.",
    "Success in control flights (is_control) is luck, a declaration there a false alarm. Leave them out of rates.",
    "Entries of the family anchor, and those that are granted the source (column knows), are bounds: an oracle that "
    "knows the source, or walkers that smell nothing.",
    "Rates hold for simulated air and these suites. They are no forecast for a real robot.",
    f"Columns that begin with {WALL} depend on the machine and its load. They compare no two methods flown elsewhere.",
    "These cases are seen from now on: a method that was tuned on them cannot be ranked on them.",
)
MAINTENANCE = (
    "The folder is complete as it is. A correction is a new folder with other hashes in croissant.json; the same "
    "results give the same bytes with the same versions of gslcosim and pyarrow."
)
_MISSING = "Absent values stand for what did not occur or was not asked for; descriptions of columns say which."
STATEMENTS: Mapping[str, str | Sequence[str]] = {
    "dataCollection": COLLECTION,
    "dataCollectionMissingData": _MISSING,
    "dataPreprocessingProtocol": [PREPROCESSING],
    "dataUseCases": USES,
    "dataLimitations": LIMITS,
    "personalSensitiveInformation": [PRIVACY],
    "dataReleaseMaintenancePlan": MAINTENANCE,
}
"""Texts on collection, uses and limits, by the properties of Croissant for responsible AI."""


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Numbers of flights, samples, entries, cases, rooms and plumes of a dataset.

    `planned` counts the flights of its suites with all their entries, `samples` is None without tracks.
    """

    planned: int
    flights: int
    controls: int
    samples: int | None
    entries: int
    cases: int
    rooms: int
    plumes: int


def count_dataset(origins: Sequence[Origin], tables: Sequence[PublishedTable]) -> Counts:
    """Return the counts of a dataset."""
    rows = tables[0].table
    rooms, gas = rows["environment_hash"].to_pylist(), rows["gas_seed"].to_pylist()
    return Counts(
        planned=sum(origin.n_planned for origin in origins),
        flights=rows.num_rows,
        controls=_compute.sum(rows["is_control"]).as_py() or 0,
        samples=tables[1].table.num_rows if len(tables) > 1 else None,
        entries=len(rows["entry"].unique()),
        cases=len(
            set(zip(rows["results"].to_pylist(), rows["case"].to_pylist(), strict=True))
        ),  # a sealed seed draws anew
        rooms=len(set(rooms)),
        plumes=len(set(zip(rooms, gas, strict=True))),
    )


def describe_dataset(origins: Sequence[Origin], counts: Counts) -> str:
    """Return a sentence on what the dataset is."""
    tracks = "" if counts.samples is None else f", with {counts.samples} samples of their tracks"
    return (
        f"{counts.flights} simulated flights of {counts.entries} search methods for gas sources in {counts.cases} "
        f"cases of the suite {origins[0].suite.suite.name} of gslcosim{tracks}."
    )


def build_datasheet(
    publication: Publication,
    origins: Sequence[Origin],
    tables: Sequence[PublishedTable],
    suite_files: Sequence[PublishedFile],
) -> str:
    """Return the datasheet as Markdown.

    Args:
        tables: Flights, and their samples if they are published.
    """
    counts, rows, suite = count_dataset(origins, tables), tables[0].table, origins[0].suite.suite
    known: dict[str, ManifestEntry] = {}
    for origin in origins:
        for entry in origin.manifest.get("entries", []):
            known.setdefault(entry["name"], entry)
    manifests = [(origin.name, origin.manifest) for origin in origins]
    environment = build_environment([Path(__file__).parent], is_html=False)
    # Names of others are text and no markup.
    environment.filters["text"] = lambda text: escape_markdown(remove_folders(text))
    return environment.get_template("datasheet.md.jinja").render(
        publication=publication,
        example=EXAMPLE,
        tables=tables,
        files=_list_files(tables, suite_files),
        suite=suite,
        numbers=_list_counts(counts),
        entries=[_describe_entry(known.get(name, {"name": name}), n) for name, n in _count(rows, "entry")],
        count=lambda name: sorted(_count(rows, name)),
        is_incomplete=counts.flights < counts.planned,
        dropped=[
            (name, each["case"], each["reason"])
            for name, manifest in manifests
            for each in manifest.get("dropped") or ()
        ],
        seeds=[
            (each.name, "sealed" if each.seed is None else each.seed, each.commitment or "", each.key or "not signed")
            for each in origins
        ],
        is_sealed=any(origin.commitment for origin in origins),
        versions=[_describe_versions(*each) for each in manifests],
        machines=[_describe_machine(*each) for each in manifests],
        columns=_describe_columns,
        citation=build_citation(publication),
        table=_table,
        wall=WALL,
        collection=COLLECTION,
        preprocessing=PREPROCESSING,
        uses=USES,
        limits=LIMITS,
        maintenance=MAINTENANCE,
        missing=_MISSING,
        privacy=PRIVACY,
    )


def _list_files(tables: Sequence[PublishedTable], suite_files: Sequence[PublishedFile]) -> list[tuple[str, str]]:
    suite = f"the suite of each folder of results, {len(suite_files)} files: gslcosim bench plan reads it"
    return [
        *((format_code(table.file), f"{table.table.num_rows} rows; a row is {table.row}") for table in tables),
        (format_code("suite/"), suite),
        (format_code("croissant.json"), "files with hashes and columns, for programs (Croissant 1.0)"),
    ]


def _list_counts(counts: Counts) -> list[tuple[str, int]]:
    return [
        ("flights", counts.flights), ("of these controls without gas", counts.controls),
        *([("flights of the suites with all entries", counts.planned)] if counts.flights < counts.planned else []),
        *([] if counts.samples is None else [("samples of tracks", counts.samples)]),
        ("entries", counts.entries), ("cases", counts.cases),
        ("rooms with their wind", counts.rooms), ("plumes", counts.plumes),
    ]  # fmt: skip


def _count(rows: Any, name: str) -> list[tuple[str, int]]:
    return list(Counter(rows[name].to_pylist()).items())


def _describe_entry(entry: ManifestEntry, n_flights: int) -> tuple[object, ...]:
    parameters = entry.get("parameters")
    return (
        format_code(remove_folders(entry["name"])),
        entry.get("family") or "",
        entry.get("language") or "",
        entry.get("knows") or "",
        json.dumps(parameters, sort_keys=True) if parameters else "",
        entry.get("agent_hash") or "",
        n_flights,
    )


def _describe_versions(name: str, manifest: ResultsManifest) -> tuple[str, ...]:
    listed = ", ".join(f"{package} {version}" for package, version in (manifest.get("versions") or {}).items())
    return name, listed, manifest.get("software_hash") or "", manifest.get("suite_hash") or ""


def _describe_machine(name: str, manifest: ResultsManifest) -> tuple[object, ...]:
    machine, wall = manifest.get("machine") or {}, manifest.get("wall") or {}
    return name, wall.get("started_at") or "", *(machine.get(key) or "" for key in ("cpu", "cores", "platform"))


def _describe_columns(table: PublishedTable) -> list[tuple[object, ...]]:
    return [
        (format_code(column.name), str(table.table.schema.field(column.name).type), column.meaning,
         table.table[column.name].null_count)
        for column in table.columns
    ]  # fmt: skip


def _table(headings: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    shown = ([remove_folders(cell) if type(cell) is str else cell for cell in row] for row in rows)
    return "\n".join(format_markdown_table(headings, shown))
