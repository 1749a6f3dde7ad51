"""Writer of a site: results are read, merged if need be, and shown in a folder that opens from disk."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.base.files import replace_file
from gslcosim_archive.path_errors import reporting_path_errors
from gslcosim_archive.site.cards import find_cards
from gslcosim_archive.site.pages import CASES, METHODS, PLANS, TRACKS, SiteData, build_site
from gslcosim_archive.submissions import load_published_results
from gslcosim_bench.report.analysis import analyse
from gslcosim_bench.store import ResultsFolder

SITE_SCHEMA = "gslcosim/site/1"
MARKER = "site.json"
INDEX = "index.html"
_ENDINGS: Mapping[str, str] = {METHODS: ".html", CASES: ".html", PLANS: ".png", TRACKS: ".js"}


@dataclass(frozen=True, kw_only=True)
class WrittenSite:
    """A site: its first page, and how much is in it."""

    page: Path
    n_methods: int
    n_cases: int
    n_trials: int
    n_bytes: int


def write_site(results: Sequence[Path], folder: Path) -> WrittenSite:
    """Write the site of results, and return where it is; an earlier site in the folder is replaced.

    Args:
        results: Folders of results of the same cases; several are merged as `bench rank` does.
        folder: Where to: a new or empty folder, or one with an earlier site. Files of others in it are left alone.
    """
    _check_folder(folder, results)
    published = load_published_results(results)
    material = published.material
    if not len(material.rows):
        raise UsageError(f"{results[0]}: expected trials that have been flown, found none. Run the suite first.")
    data = SiteData(
        analysis=analyse(material),
        cards=find_cards(results, {entry.agent_hash for entry in material.entries}),
        recordings=_find_recordings(results),
        keys=published.keys,
    )
    n_bytes = 0
    with reporting_path_errors("--out", "a folder that can be written", path=folder):
        _prepare(folder)
        for name, content in build_site(data):
            replace_file(folder.resolve(), name, content)
            n_bytes += len(content)
    return WrittenSite(
        page=folder / INDEX,
        n_methods=len(material.entries),
        n_cases=len(set(material.rows["case"].tolist())),
        n_trials=len(material.rows),
        n_bytes=n_bytes,
    )


def _find_recordings(results: Sequence[Path]) -> Mapping[str, Path]:
    places = (ResultsFolder(folder).recordings for folder in results)
    return {path.name: path for place in places if place.is_dir() for path in place.iterdir() if path.is_dir()}


def _check_folder(folder: Path, results: Sequence[Path]) -> None:
    inside = next((each for each in results if folder.resolve().is_relative_to(each.resolve())), None)
    if inside is not None:
        raise UsageError(f"--out: expected a folder outside of the results, was {folder} in {inside}. Choose another.")
    with reporting_path_errors("--out", "a folder that can be written", path=folder):
        links = [folder / name for name in _ENDINGS if (folder / name).is_symlink()]
        is_ours = folder.is_dir() and not links and _has_marker(folder / MARKER)
        if (folder.exists() and not folder.is_dir()) or (not is_ours and folder.is_dir() and any(folder.iterdir())):
            raise UsageError(
                f"--out: expected a new or empty folder, or one with an earlier site ({MARKER}), was {folder} with "
                "something else. Choose another."
            )


def _has_marker(path: Path) -> bool:
    try:
        content = json.loads(path.read_bytes()[:10_000]) if path.is_file() else None
    except (ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("schema") == SITE_SCHEMA


# The marker comes first: whatever interrupts the rest, the same command may go on.
def _prepare(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    replace_file(folder.resolve(), MARKER, (json.dumps({"schema": SITE_SCHEMA}) + "\n").encode())
    for name, ending in _ENDINGS.items():
        (folder / name).mkdir(exist_ok=True)
        for path in (folder / name).glob(f"*{ending}"):
            path.unlink()
