"""Datasheet of a dataset: what it has, how it came to be, and what does not follow from it.

Its sections are those of Gebru et al., "Datasheets for Datasets", Communications of the ACM 64 (2021) 12, 86–92.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow.compute as pc

from gslcosim_archive.dataset.croissant import Publication, PublishedFile, build_citation
from gslcosim_archive.dataset.tables import LEFT_OUT, Origin, PublishedTable, remove_folders
from gslcosim_bench.store import WALL, ManifestEntry
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
        cases=len(set(_cases(rows))),
        rooms=len(set(rooms)),
        plumes=len(set(zip(rooms, gas, strict=True))),
    )


# A sealed seed draws the case of a name anew.
def _cases(rows: Any) -> list[tuple[str, str]]:
    return list(zip(rows["results"].to_pylist(), rows["case"].to_pylist(), strict=True))


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
    counts = count_dataset(origins, tables)
    parts = [
        f"# {_text(publication.name)}",
        _text(publication.description),
        f"```python\n{EXAMPLE}```",
        *_describe_files(tables, suite_files),
        *_describe_motivation(origins),
        *_describe_composition(origins, tables, counts),
        *_describe_collection(origins),
        "## Preprocessing",
        PREPROCESSING,
        "## Uses",
        "It is made to:",
        _bullets(USES),
        "What may not be concluded:",
        _bullets(LIMITS),
        "## Distribution",
        f"License: <{publication.license}>. It covers the tables and this sheet; programs in `suite/` keep the "
        "license that their authors gave them.",
        f"Published {publication.date.isoformat()} by {_text(', '.join(publication.authors) or 'anonymous')}"
        f"{f', <{publication.url}>' if publication.url else ''}. Cite it as:",
        f"```bibtex\n{build_citation(publication)}\n```",
        "## Maintenance",
        MAINTENANCE,
        "## Columns",
        *(part for table in tables for part in _describe_columns(table)),
    ]
    return "\n\n".join(parts) + "\n"


def _describe_files(tables: Sequence[PublishedTable], suite_files: Sequence[PublishedFile]) -> tuple[str, ...]:
    rows = [(format_code(table.file), f"{table.table.num_rows} rows; a row is {table.row}") for table in tables]
    rows += [
        (
            format_code("suite/"),
            f"the suite of each folder of results, {len(suite_files)} files: gslcosim bench plan reads it",
        ),
        (format_code("croissant.json"), "files with hashes and columns, for programs (Croissant 1.0)"),
    ]
    joined = "Both tables have the column `trial`; it joins them."
    left_out = "Tracks are not published: flights of the suite with the same seed and software have them again."
    return "## Files", _table(("file", "content"), rows), joined if len(tables) > 1 else left_out


def _describe_motivation(origins: Sequence[Origin]) -> tuple[str, ...]:
    suite = origins[0].suite.suite
    asked = f" The suite asks: {_text(suite.question)}" if suite.question else ""
    title = f" ({_text(suite.title)})" if suite.title else ""
    return (
        "## Motivation",
        f"The rows of the suite {format_code(suite.name)}{title} were flown to compare methods of gas source "
        f"localization.{asked} They are published so that anybody can check or redo the comparison.",
    )


def _describe_composition(
    origins: Sequence[Origin], tables: Sequence[PublishedTable], counts: Counts
) -> tuple[str, ...]:
    rows = tables[0].table
    is_incomplete = counts.flights < counts.planned
    found = [
        ("flights", counts.flights), ("of these controls without gas", counts.controls),
        *([("flights of the suites with all entries", counts.planned)] if is_incomplete else []),
        *([] if counts.samples is None else [("samples of tracks", counts.samples)]),
        ("entries", counts.entries), ("cases", counts.cases),
        ("rooms with their wind", counts.rooms), ("plumes", counts.plumes),
    ]  # fmt: skip
    entries: dict[str, ManifestEntry] = {}
    for origin in origins:
        for entry in origin.manifest.get("entries", []):
            entries.setdefault(entry["name"], entry)
    flown = Counter(rows["entry"].to_pylist())
    dropped = [
        (origin.name, each["case"], each["reason"])
        for origin in origins
        for each in origin.manifest.get("dropped") or ()
    ]
    parts = [
        "## Composition",
        _table(("what", "number"), found),
        "Entries:",
        _table(
            ("entry", "family", "language", "knows", "parameters that differ from its defaults", "program", "flights"),
            [_describe_entry(entries.get(name, {"name": name}), n) for name, n in flown.items()],
        ),
        "Flights by family of cases, outcome, status and validity:",
        *(
            _table((name, "flights"), sorted(Counter(rows[name].to_pylist()).items()))
            for name in ("family", "outcome", "status", "validity")
        ),
        f"Rows whose status is not `flown` count as failures at the time limit. {_MISSING} {PRIVACY}",
    ]
    if is_incomplete:
        parts.append(
            "A part of the suites was flown. Entries have different numbers of flights, so compare them in cases that "
            "all of them flew."
        )
    if dropped:
        parts += ["Cases of the suite that could not be flown:", _table(("results", "case", "reason"), dropped)]
    return tuple(parts)


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


def _describe_collection(origins: Sequence[Origin]) -> tuple[str, ...]:
    versions, machines = [], []
    for origin in origins:
        manifest = origin.manifest
        listed = ", ".join(f"{name} {version}" for name, version in (manifest.get("versions") or {}).items())
        versions.append((origin.name, listed, manifest.get("software_hash") or "", manifest.get("suite_hash") or ""))
        machine, wall = manifest.get("machine") or {}, manifest.get("wall") or {}
        machines.append((
            origin.name, wall.get("started_at") or "", machine.get("cpu") or "", machine.get("cores") or "",
            machine.get("platform") or "",
        ))  # fmt: skip
    seeds = [
        (each.name, "sealed" if each.seed is None else each.seed, each.commitment or "", each.key or "not signed")
        for each in origins
    ]
    parts = [
        "## Collection process",
        COLLECTION,
        _table(("results", "seed of the suite", "commitment", "key of the signature"), seeds),
    ]
    if any(origin.commitment for origin in origins):
        parts.append(
            "A sealed seed was drawn before the flights, and its commitment is a SHA-256 of the recipe of the cases, "
            "the seed and a nonce; `gslcosim bench reveal` checks it."
        )
    return (
        *parts,
        _table(("results", "versions", "software", "cases"), versions),
        "Software and cases are hashes: rows of one software are the same to the bit on every machine, but for the "
        f"columns `{WALL}…` and `sandbox`.",
        _table(("results", "begun", "processor", "cores", "system"), machines),
    )


def _describe_columns(table: PublishedTable) -> tuple[str, ...]:
    rows = [
        (format_code(column.name), str(table.table.schema.field(column.name).type), column.meaning,
         table.table[column.name].null_count)
        for column in table.columns
    ]  # fmt: skip
    return f"### `{table.file}`", _table(("column", "type", "description", "absent in"), rows)


def _bullets(texts: Iterable[str]) -> str:
    return "\n".join(f"- {text}" for text in texts)


def _table(headings: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    shown = ([remove_folders(cell) if type(cell) is str else cell for cell in row] for row in rows)
    return "\n".join(format_markdown_table(headings, shown))


# Names of others are text and no markup.
def _text(text: str) -> str:
    return escape_markdown(remove_folders(text))
