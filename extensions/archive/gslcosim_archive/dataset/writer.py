"""Writer of a dataset: results become a folder that can be published as it is."""

import hashlib
import json
import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, datetime
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from gslcosim.base.errors import UsageError
from gslcosim.base.files import ScratchFolder, list_files
from gslcosim.base.untrusted_input import escape_json_text
from gslcosim_archive.dataset import DEFAULT_LICENSE
from gslcosim_archive.dataset.croissant import Publication, PublishedFile, build_croissant
from gslcosim_archive.dataset.datasheet import STATEMENTS, build_datasheet, count_dataset, describe_dataset
from gslcosim_archive.dataset.tables import Origin, build_published_tables, read_origins
from gslcosim_archive.path_errors import reporting_path_errors
from gslcosim_bench.cases.suite_files import LoadedSuite, load_suite, write_suite

DATASHEET, DESCRIPTION, SUITE = "README.md", "croissant.json", "suite"
_reporting_path_errors = partial(reporting_path_errors, "--out", "a folder that can be written")
_MEDIA_TYPES = {
    ".parquet": "application/x-parquet", ".md": "text/markdown", ".yaml": "application/yaml",
    ".yml": "application/yaml", ".py": "text/x-python", ".json": "application/json", ".txt": "text/plain",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class WrittenDataset:
    """A dataset: its folder, and how much is in it."""

    folder: Path
    n_flights: int
    n_samples: int
    n_files: int
    n_bytes: int


def write_dataset(
    results: Sequence[Path],
    folder: Path,
    *,
    license: str = DEFAULT_LICENSE,  # noqa: A002 - the word of SPDX and of the option
    authors: Sequence[str] = (),
    url: str | None = None,
    published: date | None = None,
    may_be_incomplete: bool = False,
    has_tracks: bool = True,
) -> WrittenDataset:
    """Write finished results as a dataset; the same results give the same bytes.

    Args:
        results: Folders of `bench run`, of the same cases but for their seeds.
        folder: Where to: a new or empty folder.
        license: SPDX identifier, or URL of a license.
        authors: Names of who publishes it; nobody: anonymous.
        published: When; by default the day on which the last of the results was begun.
        may_be_incomplete: Accept results in which flights of the suite are missing; the datasheet says so.
        has_tracks: Whether tracks, the larger table, are published too.
    """
    terms = _find_license(license)
    _check_folder(folder, results)
    origins = read_origins(results, may_be_incomplete=may_be_incomplete)
    tables = build_published_tables(origins, has_tracks=has_tracks)
    counts = count_dataset(origins, tables)
    publication = Publication(
        name=origins[0].suite.suite.name,
        description=describe_dataset(origins, counts),
        license=terms,
        authors=tuple(authors),
        url=url,
        date=published or _find_date(origins),
    )
    # A folder beside the goal: nobody sees a part of a dataset.
    with _reporting_path_errors(path=folder), ScratchFolder("dataset") as scratch:
        place = scratch.path / "dataset"
        place.mkdir()
        for table in tables:
            _write_table(table.table, place / table.file)
        for origin in origins:
            write_suite(origin.suite, place / SUITE / origin.name)
            _check_paths(load_suite(place / SUITE / origin.name, needs_seed=False), origin)
        suite_files = _list_files(place / SUITE, place)
        sheet = build_datasheet(publication, origins, tables, suite_files)
        (place / DATASHEET).write_text(sheet, encoding="utf-8")
        files = _list_files(place, place)
        description = build_croissant(publication, files, tables, STATEMENTS)
        # Pages embed it in a script element, so nothing in it may look like markup.
        text = escape_json_text(json.dumps(description, indent=2, ensure_ascii=False), is_embedded=True) + "\n"
        (place / DESCRIPTION).write_text(text, encoding="utf-8")
        n_bytes = sum(each.n_bytes for each in files) + len(text.encode())
        shutil.copytree(place, folder, dirs_exist_ok=True)
    return WrittenDataset(
        folder=folder,
        n_flights=counts.flights,
        n_samples=counts.samples or 0,
        n_files=len(files) + 1,
        n_bytes=n_bytes,
    )


# The bytes of numbers that change slowly are alike place by place: so sorted, tracks take half the room.
def _write_table(table: pa.Table, path: Path) -> None:
    numbers = [field.name for field in table.schema if pa.types.is_floating(field.type)]
    others = [name for name in table.schema.names if name not in numbers]
    write: Any = pq.write_table
    write(table, path, compression="zstd", use_byte_stream_split=numbers, use_dictionary=others)


def _find_license(name: str) -> str:
    if re.fullmatch(r"https?://[^\s<>]+", name):
        return name
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9.+-]*", name):
        raise UsageError(
            f"--license: expected an SPDX identifier such as {DEFAULT_LICENSE}, or the URL of a license, was {name!r}. "
            "https://spdx.org/licenses lists them."
        )
    return f"https://spdx.org/licenses/{name}.html"


def _check_folder(folder: Path, results: Sequence[Path]) -> None:
    inside = next((each for each in results if folder.resolve().is_relative_to(each.resolve())), None)
    if inside is not None:
        raise UsageError(f"--out: expected a folder outside of the results, was {folder} in {inside}. Choose another.")
    with _reporting_path_errors(path=folder):
        if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
            raise UsageError(
                f"--out: expected a new or empty folder, was {folder} with something in it. Choose another."
            )


# Where files of a scenario lie on a machine means nothing to others.
def _check_paths(suite: LoadedSuite, origin: Origin) -> None:
    for spec in suite.suite.scenarios:
        if Path(spec.source).is_absolute():
            raise UsageError(
                f"{origin.folder.suite}: scenarios: expected files that the results hold, was {spec.source}, which "
                "names files of its own. Fly the suite with rooms and gas that gslcosim makes."
            )
    for inner in suite.included:
        _check_paths(inner, origin)


def _find_date(origins: Sequence[Origin]) -> date:
    began = [
        session.get("started_at") or ""
        for origin in origins
        for session in (origin.manifest.get("wall") or {}, *origin.manifest.get("sessions", []))
    ]
    try:
        return datetime.fromisoformat(max(began)).date()
    except ValueError as error:
        raise UsageError(
            f"--date: expected a day of publication, as the results do not say when they were flown ({error}). Add it."
        ) from error


def _list_files(folder: Path, root: Path) -> list[PublishedFile]:
    return [
        PublishedFile(
            path=path.relative_to(root).as_posix(),
            media_type=_MEDIA_TYPES.get(path.suffix, "application/octet-stream"),
            n_bytes=path.stat().st_size,
            sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        )
        for path in list_files(folder)
    ]
