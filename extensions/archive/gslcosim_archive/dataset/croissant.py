"""Description of a dataset in Croissant 1.0, the JSON-LD of MLCommons: its files, tables and columns.

Specification: https://docs.mlcommons.org/croissant/docs/croissant-spec-1.0.html, and
https://docs.mlcommons.org/croissant/docs/croissant-rai-spec.html for the properties `rai:`.
"""

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from gslcosim_archive.dataset.tables import PublishedTable
from gslcosim_bench.store import Column

VERSION = "http://mlcommons.org/croissant/1.0"
RAI_VERSION = "http://mlcommons.org/croissant/RAI/1.0"
# The standard context of the specification, word for word: programs compare it.
_CONTEXT: Mapping[str, Any] = {
    "@language": "en", "@vocab": "https://schema.org/", "citeAs": "cr:citeAs", "column": "cr:column",
    "conformsTo": "dct:conformsTo", "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/", "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"}, "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty", "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract", "field": "cr:field", "fileProperty": "cr:fileProperty", "fileObject": "cr:fileObject",
    "fileSet": "cr:fileSet", "format": "cr:format", "includes": "cr:includes", "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath", "key": "cr:key", "md5": "cr:md5", "parentField": "cr:parentField", "path": "cr:path",
    "recordSet": "cr:recordSet", "references": "cr:references", "regex": "cr:regex", "repeated": "cr:repeated",
    "replace": "cr:replace", "samplingRate": "cr:samplingRate", "sc": "https://schema.org/",
    "separator": "cr:separator", "source": "cr:source", "subField": "cr:subField", "transform": "cr:transform",
}  # fmt: skip
_DATA_TYPES: Mapping[pa.DataType, str] = {
    pa.string(): "sc:Text", pa.int64(): "sc:Integer", pa.bool_(): "sc:Boolean",
    pa.float64(): "sc:Float", pa.float32(): "sc:Float",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class PublishedFile:
    """A file of a dataset: its path inside the folder, kind, size and hash."""

    path: str
    media_type: str
    n_bytes: int
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Publication:
    """Name, authors and terms of a dataset. `license` is a URL."""

    name: str
    description: str
    license: str
    authors: tuple[str, ...]
    url: str | None
    date: datetime.date


def build_croissant(
    publication: Publication,
    files: Sequence[PublishedFile],
    tables: Sequence[PublishedTable],
    statements: Mapping[str, str | Sequence[str]],
) -> dict[str, Any]:
    """Return the description of a dataset.

    Args:
        files: All of its files but the description itself.
        statements: Properties of the vocabulary for responsible AI, without prefix, and their texts.
    """
    authors = [{"@type": "sc:Person", "name": name} for name in publication.authors]
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": [VERSION, RAI_VERSION],
        "name": publication.name,
        "description": publication.description,
        "license": publication.license,
        **({"url": publication.url} if publication.url else {}),
        "version": "1.0.0",
        "datePublished": publication.date.isoformat(),
        "creator": authors or [{"@type": "sc:Organization", "name": "anonymous"}],
        "citeAs": build_citation(publication),
        "keywords": ["gas source localization", "robotics", "olfaction", "simulation", "benchmark"],
        **{f"rai:{key}": text for key, text in statements.items()},
        "distribution": [_describe_file(each) for each in files],
        "recordSet": [_describe_table(each) for each in tables],
    }


def build_citation(publication: Publication) -> str:
    """Return a citation in BibTeX."""
    values = {
        "title": publication.name,
        "author": " and ".join(publication.authors) or "anonymous",
        "year": str(publication.date.year),
        **({"url": publication.url} if publication.url else {}),
    }
    return f"@misc{{{publication.name}, " + ", ".join(f"{key} = {{{text}}}" for key, text in values.items()) + "}"


def _describe_file(file: PublishedFile) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": file.path,
        "name": file.path,
        "contentUrl": file.path,
        "contentSize": f"{file.n_bytes} B",
        "encodingFormat": file.media_type,
        "sha256": file.sha256,
    }


def _describe_table(table: PublishedTable) -> dict[str, Any]:
    keys = {"trials": "trial"}
    return {
        "@type": "cr:RecordSet",
        "@id": table.name,
        "name": table.name,
        "description": f"A row is {table.row}.",
        **({"key": {"@id": f"{table.name}/{keys[table.name]}"}} if table.name in keys else {}),
        "field": [_describe_column(column, table) for column in table.columns],
    }


def _describe_column(column: Column, table: PublishedTable) -> dict[str, Any]:
    refers = table.name != "trials" and column.name == "trial"
    return {
        "@type": "cr:Field",
        "@id": f"{table.name}/{column.name}",
        "name": column.name,
        "description": column.meaning,
        "dataType": _DATA_TYPES[column.type],
        **({"references": {"field": {"@id": "trials/trial"}}} if refers else {}),
        "source": {"fileObject": {"@id": table.file}, "extract": {"column": column.name}},
    }
