"""Folder of measured data: its sets, whose formats are recognised by their files and not by names of folders."""

import hashlib
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from gslcosim_validation.readers.backward_facing_step import read_backward_facing_step
from gslcosim_validation.readers.columns import build_error
from gslcosim_validation.readers.laser_paths import read_laser_paths
from gslcosim_validation.readers.leak_box import read_leak_box
from gslcosim_validation.readers.mast_network import read_mast_network
from gslcosim_validation.readers.published import read_published
from gslcosim_validation.readers.roof_tracer import read_roof_tracer
from gslcosim_validation.readers.room_profiles import read_room_profiles
from gslcosim_validation.readers.room_sensors import read_room_sensors

T = TypeVar("T")
PUBLISHED = "published.json"
# SHA-256 of the table of releases, cases or experiments of each campaign about which figures were published.
_CAMPAIGNS = {
    "ad4c7c8fdc1f5ef738c451aaa1346d47a45ce9c213686400658b5237168a3a09": "metec",
    "ec240a101a05f76a3b3134835272c613c8dd1ee5b7402d0435c1099f64465d2e": "stanford",
    "5d010ca6391625e575f25dde6cf8dc8ff0ef4bd14b1f5b690801101891e914e1": "chilbolton",
    "3baa5d8bed87d902444e308d618b10490e5cf106a2b2b23c4b674aa7e2ba564c": "nist_helium",
    "0a3ea84d8155e288eece2250176da7bfda985a11b4b9fe288bd52409726ad685": "orebro",
}
_CAMPAIGN_TABLES = ("releases.csv", "cases.csv", "experiments.csv")


@dataclass(frozen=True)
class Format:
    """A format: its name, the files (patterns) that a folder of it has, and its reader."""

    name: str
    files: tuple[str, ...]
    read: Callable[[Path], Any]


FORMATS = (
    Format("room_profiles", ("u_profiles.csv", "geometry.json"), read_room_profiles),
    Format("backward_facing_step", ("profiles.csv", "skin_friction.csv"), read_backward_facing_step),
    Format("leak_box", ("cases.csv", "series/*.csv", "geometry.json"), read_leak_box),
    Format("room_sensors", ("experiments.csv", "sensors.csv", "exp*.csv*"), read_room_sensors),
    Format("laser_paths", ("layout.json", "minutes_source_*.csv*"), read_laser_paths),
    Format("mast_network", ("site.json", "minutes.csv*", "releases.csv"), read_mast_network),
    Format("roof_tracer", ("wind_10hz.csv*", "upwind_1hz.csv*", "downwind_1hz.csv*"), read_roof_tracer),
)


@dataclass(frozen=True)
class MeasuredSet:
    """One set: its name (that of its folder), its format, and where it lies; read on demand."""

    name: str
    format: str
    folder: Path

    @property
    def campaign(self) -> str:
        """The published campaign that it is, whatever its folder is called; empty for data of others."""
        tables = (self.folder / name for name in _CAMPAIGN_TABLES)
        hashes = [hashlib.sha256(table.read_bytes()).hexdigest() for table in tables if table.is_file()]
        return next((_CAMPAIGNS[each] for each in hashes if each in _CAMPAIGNS), "")


@dataclass(frozen=True)
class MeasuredData:
    """Contents of a folder: sets in the order of their names, and published figures if it has some."""

    folder: Path
    sets: tuple[MeasuredSet, ...]

    def of_format(self, format_name: str) -> tuple[MeasuredSet, ...]:
        """Return the sets of a format."""
        return tuple(each for each in self.sets if each.format == format_name)

    def read(self, measured_set: MeasuredSet, kind: type[T]) -> T:
        """Return what is in a set.

        Args:
            measured_set: One of `sets`.
            kind: The type that its reader returns, such as `MastNetwork`.
        """
        content = next(each for each in FORMATS if each.name == measured_set.format).read(measured_set.folder)
        assert isinstance(content, kind), f"{measured_set.format} is read as {type(content).__name__}"
        return content

    def check(self, format_names: Collection[str]) -> None:
        """Read all sets of some formats, so that a bad file is told before anything is computed."""
        for known in FORMATS:
            if known.name in format_names:
                for each in self.of_format(known.name):
                    known.read(each.folder)

    def published(self, entry_id: str) -> dict[str, Any]:
        """Return the values of a published figure, by its id in `published.json`."""
        return read_published(self.folder / PUBLISHED, entry_id)

    @property
    def has_published(self) -> bool:
        """True if there is a `published.json`."""
        return (self.folder / PUBLISHED).is_file()


def read_measured(folder: Path | str) -> MeasuredData:
    """Return what measured data a folder holds: a folder with sets in folders of their own, or one set."""
    root = Path(folder)
    if not root.is_dir():
        found = "a file" if root.exists() else "nothing"
        raise build_error(root, "", expected="a folder of measured data", found=found, remedy="Name one with --data.")
    own = _recognise_format(root)
    places = [root] if own else sorted(each for each in root.iterdir() if each.is_dir())
    sets = tuple(
        MeasuredSet(name=place.resolve().name, format=known.name, folder=place)
        for place in places
        if (known := _recognise_format(place)) is not None
    )
    if not sets and not (root / PUBLISHED).is_file():
        listed = "; ".join(f"{each.name} ({', '.join(each.files)})" for each in FORMATS)
        raise build_error(
            root,
            "",
            expected=f"a set, or folders with one each, of a format known by its files: {listed}",
            found="none of them",
            remedy="docs/measured-data.md describes each format.",
        )
    return MeasuredData(root, sets)


def _recognise_format(folder: Path) -> Format | None:
    return next((each for each in FORMATS if all(any(folder.glob(name)) for name in each.files)), None)
