"""Suite files to frozen models, with every problem of a file told at once."""

from dataclasses import dataclass
from pathlib import Path

from gslcosim.benchmark.suite.models import Suite
from gslcosim.errors import ScenarioError
from gslcosim.scenario.bundled import bundled_folder
from gslcosim.scenario.spec_files import read_spec_file
from gslcosim.scenario.suggestions import did_you_mean

SUITE_FILE = "suite.yaml"
_ENDINGS = (".yaml", ".yml")


@dataclass(frozen=True, kw_only=True)
class LoadedSuite:
    """A valid suite, where it came from, and the suites that it includes.

    `directory` is where its relative paths start; `shown_path` is how the user named the file.
    """

    suite: Suite
    path: Path
    directory: Path
    shown_path: str
    included: tuple["LoadedSuite", ...] = ()

    @property
    def demands_sandbox(self) -> bool:
        """Whether agents of some of its cases, or of all, are to be flown in a sandbox."""
        return self.suite.sandbox == "required" or any(inner.demands_sandbox for inner in self.included)


def bundled_suites() -> dict[str, Path]:
    """Return the bundled suite files by name."""
    return {path.parent.name: path for path in sorted(bundled_folder("suites").glob(f"*/{SUITE_FILE}"))}


def load_suite(source: str | Path, *, seed: int | None = None) -> LoadedSuite:
    """Read and check a suite, with all that it includes.

    Args:
        source: A file, or the name of a bundled suite.
        seed: Replaces the suite's seed, and that of the suites it includes.

    Raises:
        ScenarioError: there is no such suite, or it has problems: all of them in one error.
    """
    return _load(source, seed, within=())


def find_suite(source: str | Path) -> Path:
    """Return the file of a suite that is named by path, or by name when it is bundled.

    Raises:
        ScenarioError: there is none.
    """
    path = Path(source)
    if path.is_dir() and (path / SUITE_FILE).is_file():
        return path / SUITE_FILE
    if path.is_file():
        return path
    bundled = bundled_suites()
    if str(source) in bundled:
        return bundled[str(source)]
    if path.suffix in _ENDINGS or len(path.parts) > 1:
        raise ScenarioError(f"{source}: expected a suite file, found none.")
    raise ScenarioError(
        f"{source}: expected a file or a bundled suite ({', '.join(bundled)}), found neither. "
        f"{did_you_mean(str(source), list(bundled))}".rstrip()
    )


def _load(source: str | Path, seed: int | None, within: tuple[Path, ...]) -> LoadedSuite:
    path = find_suite(source).resolve()
    if path in within:
        way = " includes ".join(inner.parent.name for inner in (*within, path))
        raise ScenarioError(f"{source}: include: expected suites that do not include themselves, was {way}.")
    shown_path = str(source) if Path(source).is_file() else str(path)
    suite = read_spec_file(path, Suite, shown_path=shown_path, keys="scenarios and entries")
    if seed is not None:
        suite = suite.model_copy(update={"seed": seed})
    included = tuple(_load(_beside(path, name), seed, (*within, path)) for name in suite.include)
    return LoadedSuite(suite=suite, path=path, directory=path.parent, shown_path=shown_path, included=included)


def _beside(path: Path, name: str) -> str | Path:
    beside = path.parent / name
    return beside if beside.exists() else name
