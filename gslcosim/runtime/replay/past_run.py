"""Past run: files of a run directory, read back to repeat the run."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from gslcosim.base.checksums import check_files
from gslcosim.base.errors import ContractError, EnvironmentDataError, UsageError, describe_os_error
from gslcosim.base.files import read_regular_file
from gslcosim.base.untrusted_input import MalformedFileError, parse_json
from gslcosim.contract import codec
from gslcosim.contract.messages import Command
from gslcosim.contract.version import CONTRACT_HASH
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.store import load_environment
from gslcosim.runtime.digest import RunDigest
from gslcosim.runtime.replay.snapshot import Snapshot, find_nearest_snapshot
from gslcosim.runtime.run_dir import RunDir, RunResult
from gslcosim.runtime.services import build_dataflow, list_service_names
from gslcosim.runtime.status import RunStatus
from gslcosim.scenario import Scenario

# The key in a manifest for the log from which a run was made.
IMPORTED_FROM = "imported_from"
# Room for the commands of weeks, at a few hundred bytes each.
_MAX_INPUTS_BYTES = 2_000_000_000


class _CommandLine(TypedDict):
    agent: str


@dataclass(frozen=True, kw_only=True)
class PastRun:
    """Files of a run, as far as they are needed to repeat it.

    `commands` are those that took effect, by agent and tick; `digest` is absent where the run came to no verdict.
    Relative paths of its agents start at `directory`; `flown_by` is the version that ran it, unless `is_imported`: then
    it was made from a log from elsewhere, and no version ran it.
    """

    run_dir: RunDir
    scenario: Scenario
    commands: Mapping[str, Mapping[int, Command]]
    digest: RunDigest | None
    last_tick: int
    environment_hash: str
    directory: Path
    flown_by: str
    is_imported: bool = False

    @classmethod
    def load(cls, folder: Path, *, needs_result: bool = True) -> "PastRun":
        """Read the folder of a run; where the result is not needed, also one that was killed before it had one."""
        run_dir = RunDir(folder)
        manifest = run_dir.load_manifest()
        has_result = needs_result or (folder / "result.json").is_file()
        result: RunResult | dict[str, int] = run_dir.load_result() if has_result else {}
        if manifest.get("contract_hash") != CONTRACT_HASH:
            raise UsageError(
                f"{folder.name}: expected a run of contract {CONTRACT_HASH}, was "
                f"{manifest.get('contract_hash')}, flown by gslcosim {manifest.get('gslcosim')}. Use that "
                "version for it."
            )
        check_files(folder, "manifest.json")
        return cls(
            run_dir=run_dir,
            scenario=run_dir.load_scenario(),
            commands=read_recorded_commands(run_dir.inputs),
            digest=RunDigest.load(run_dir.digest) if run_dir.digest.is_file() else None,
            last_tick=int(result.get("ticks", 0)),
            environment_hash=str(manifest.get("environment_hash")),
            directory=Path(run_dir.load_setup().get("directory") or folder).absolute(),
            is_imported=IMPORTED_FROM in manifest,
            flown_by=f"gslcosim {manifest.get('gslcosim')} ({manifest.get('git') or 'no git'})",
        )

    def check_flown_here(self) -> None:
        """Refuse a run that was made from a log from elsewhere."""
        if self.is_imported:
            raise UsageError(
                f"{self.run_dir.run_id}: expected a run of gslcosim, was a flight from elsewhere that was imported: "
                "there is nothing that could be repeated. Fly its scenario with gslcosim up."
            )


def find_snapshot_before(past: PastRun, tick: int) -> tuple[Snapshot | None, str]:
    """Return the last snapshot of a run at or before a tick, or a sentence on why an existing one cannot be used."""
    names = [spec.name for spec in build_dataflow(past.scenario).participants if spec.writes]
    services = [name for name in list_service_names(past.scenario) if name in names]
    return find_nearest_snapshot(past.run_dir, past.scenario, services, until_tick=tick)


def read_recorded_commands(path: Path) -> dict[str, dict[int, Command]]:
    """Return the commands of `inputs.log` by agent and tick."""
    try:
        lines = read_regular_file(path, max_bytes=_MAX_INPUTS_BYTES).splitlines()
    except OSError as error:
        raise UsageError(
            f"{path.parent.name}: expected an inputs.log, was {describe_os_error(error)}.\nFile: {path}"
        ) from error
    commands: dict[str, dict[int, Command]] = {}
    for number, line in enumerate(lines, 1):
        try:
            agent = parse_json(line, _CommandLine, place="the line")["agent"]
            command = codec.decode_json(Command, line)
        except (ContractError, MalformedFileError) as error:
            raise UsageError(
                f"{path.parent.name}/{path.name}:{number}: expected an agent's command, was {line[:60]!r} ({error}).\n"
                f"File: {path}"
            ) from error
        commands.setdefault(agent, {})[command.tick] = command
    check_files(path.parent, path.name)
    return commands


def find_environment(past: PastRun, report: Callable[[RunStatus], None]) -> Path:
    """Return the folder of a run's room, built again if it is missing."""
    folder = Path(past.run_dir.load_setup()["environment"])
    try:
        environment = load_environment(folder)
    except EnvironmentDataError:
        # It was in the cache, and is built again.
        folder = prepare_environment(
            past.scenario,
            scenario_dir=past.run_dir.path,
            progress=lambda text, fraction: report(RunStatus(state="preparing", text=text, fraction=fraction)),
        )
        environment = load_environment(folder)
    if environment.content_hash != past.environment_hash:
        raise EnvironmentDataError(
            f"{folder}: expected the environment {past.environment_hash}, in which the run was flown, was "
            f"{environment.content_hash}. Bring back the files or the version of gslcosim that made it."
        )
    return folder.resolve()
