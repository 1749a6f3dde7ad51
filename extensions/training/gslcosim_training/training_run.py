"""Training from a train file to a policy: rounds, checkpoints, validations and learning curves."""

import io
import json
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.files import replace_file
from gslcosim.base.untrusted_input import MalformedFileError, parse_json, read_npz
from gslcosim.runtime.status import RunResult
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim_bench.cases.models import EntrySpec
from gslcosim_data.figures.style import get_line_style, new_figure, save, styled
from gslcosim_search.learned.policy import ArrayPolicy
from gslcosim_search.learned.policy_agent import POLICY_FILE
from gslcosim_search.learned.policy_files import KINDS, save_parameters, save_policy
from gslcosim_search.learned.wind_frame import asks_wind_frame
from gslcosim_training.batch.case_builder import find_batch_refusal
from gslcosim_training.family import Split
from gslcosim_training.train_file import PpoFileSettings, TrainFile
from gslcosim_training.trainers.evolution import (
    CaseRun,
    EvolvedCtrnn,
    EvolvedMethod,
    EvolvedParameters,
    compute_cost,
    compute_rows,
)
from gslcosim_training.trainers.search_pool import SearchPool
from gslcosim_training.trainers.tabular_q import TabularQ
from gslcosim_training.trainers.trainer import CtrnnSettings, MethodSettings, TableSettings, Trainer, run_searches

CHECKPOINT = "checkpoint.npz"
SCHEMA = "gslcosim/checkpoint/1"
_ABOUT, _TRAINER, _BEST = "about", "trainer.", "best."
FIGURE = "curves"
_COSTS = {"best_cost": "best of a round", "mean_cost": "mean of a round", "validation_cost": "validation"}
_REWARDS = {"mean_reward": "mean of a leg", "reward": "mean of a search"}
_SUCCESS = {"success": "training", "validation_success": "validation"}
_ASPECT = 0.4
LEARNED = "learned"
CURVES = "curves.json"
_PACKAGES = ("gslcosim", "numpy", "numba", "cma", "jax", "jaxlib", "optax")
# Receives what is being done, and how much of how much is over.
Told = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """A training between two rounds.

    Attributes:
        identity: Of the train file and its family.
        trainer: The state of the trainer.
        best: The arrays of the best policy so far; empty where it has none.
        about: What else is to be kept, as plain values: curves, times, settings of the best policy.
    """

    identity: str
    trainer: Mapping[str, NDArray[Any]]
    best: Mapping[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    about: Mapping[str, Any] = field(default_factory=dict[str, Any])


class _About(TypedDict):
    schema: str
    identity: str
    about: dict[str, object]


def save_checkpoint(folder: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint into a folder, in place of the one before."""
    about = {"schema": SCHEMA, "identity": checkpoint.identity, "about": dict(checkpoint.about)}
    arrays = {f"{_TRAINER}{name}": array for name, array in checkpoint.trainer.items()}
    arrays |= {f"{_BEST}{name}": array for name, array in checkpoint.best.items()}
    file = io.BytesIO()
    np.savez_compressed(file, allow_pickle=False, **{_ABOUT: np.array(json.dumps(about)), **arrays})
    try:
        replace_file(folder, CHECKPOINT, file.getvalue())
    except OSError as error:
        raise UsageError(f"{folder / CHECKPOINT}: expected a file that can be written, got: {error}.") from error


def load_checkpoint(folder: Path, *, identity: str) -> Checkpoint:
    """Return the checkpoint of a folder."""
    path = folder / CHECKPOINT
    if not path.is_file():
        raise UsageError(f"{path}: expected a checkpoint to go on from, found none. Leave out --resume.")
    try:
        arrays = read_npz(path)
        header = parse_json(str(arrays.pop(_ABOUT)[()]), _About, place=_ABOUT)
        schema, found, about = header["schema"], header["identity"], header["about"]
    except (OSError, ValueError, KeyError, IndexError, MalformedFileError) as error:
        raise UsageError(
            f"{path}: expected a checkpoint of gslcosim train, was a file that is corrupt ({error}). Take it away and "
            "train anew without --resume."
        ) from error
    if schema != SCHEMA:
        raise UsageError(f"{path}: expected a checkpoint of schema {SCHEMA}, was {schema!r}. Train anew.")
    if found != identity:
        raise UsageError(
            f"{path}: expected a checkpoint of this train file and family, was one of another or of what they were "
            "before. Give another folder with --out."
        )
    return Checkpoint(
        identity=identity,
        trainer={name.removeprefix(_TRAINER): array for name, array in arrays.items() if name.startswith(_TRAINER)},
        best={name.removeprefix(_BEST): array for name, array in arrays.items() if name.startswith(_BEST)},
        about=about,
    )


def draw_curves(curves: Sequence[Mapping[str, float]], folder: Path) -> list[Path]:
    """Draw cost or reward, and success, over rounds into `curves.svg` and `curves.png`."""
    with styled():
        figure = new_figure(2, _ASPECT)
        left, right = figure.subplots(1, 2)
        has_costs = any("mean_cost" in each for each in curves)
        _lines(left, curves, _COSTS if has_costs else _REWARDS)
        left.set(xlabel="round", ylabel="cost" if has_costs else "reward")
        _lines(right, curves, _SUCCESS)
        right.set(xlabel="round", ylabel="share of searches that succeed", ylim=(0, 1))
        return save(figure, folder / FIGURE, ("svg", "png"), dots_per_inch=150)


def _lines(axes: object, curves: Sequence[Mapping[str, float]], names: Mapping[str, str]) -> None:
    drawn = 0
    for i, (name, label) in enumerate(names.items()):
        points = [(each["round"], each[name]) for each in curves if name in each]
        if points:
            xs, ys = zip(*points, strict=True)
            marker = "o" if name.startswith("validation") else ""
            axes.plot(xs, ys, **get_line_style(i), marker=marker, ms=2.5, label=label, gid=f"curve/{name}")  # type: ignore[attr-defined]
            drawn += 1
    if drawn:
        axes.legend()  # type: ignore[attr-defined]


class PolicyValidation:
    """Flies a policy in the cases of validation, each with its own seed: in a batch, or a method in this process."""

    def __init__(self, family: str, cases: Sequence[LoadedScenario], pool: SearchPool | None) -> None:
        self._family, self._cases, self._pool = family, tuple(cases), pool
        self._seeds = np.array([case.scenario.seed for case in cases], np.int64)

    def figures(self, policy: Any) -> dict[str, float]:
        """Return mean cost and success, as `validation_cost` and `validation_success`."""
        if isinstance(policy, EvolvedParameters):
            rows = compute_rows(self._family, self._cases, policy.entry)
            costs = np.array([compute_cost(row) for row in rows])
            success = np.array([row["success"] for row in rows])
        else:
            assert self._pool is not None, "policies fly in batches"
            numbers = np.arange(len(self._cases))
            flown = run_searches(
                self._pool.envs, [policy], numbers, self._seeds, self._pool.places_of(policy.observation_names)
            )
            costs, success = flown.costs(*self._pool.scales(numbers)), flown.success
        return {"validation_cost": float(costs.mean()), "validation_success": float(success.mean())}


def build_entry(policy: Any, policy_file: Path) -> EntrySpec:
    """Return the suite entry of a trained policy: a method with its parameters, or the agent `learned` with a file."""
    if isinstance(policy, EvolvedParameters):
        return policy.entry
    assert isinstance(policy, ArrayPolicy), "trainers have policies or parameters"
    return EntrySpec(name=LEARNED, start=StartSpec(python=LEARNED), parameters={"policy": str(policy_file.resolve())})


def record_runs(family: str, cases: Sequence[LoadedScenario], entry: EntrySpec, runs_dir: Path) -> list[RunResult]:
    """Fly cases with recordings, each into a run's folder of its own, for `gslcosim view`."""
    return [CaseRun(family=family, case=case, entry=entry).record(runs_dir) for case in cases]


@dataclass(frozen=True, kw_only=True)
class TrainingResult:
    """Result of a training: figures of each round, and the best policy of those that were validated."""

    name: str
    folder: Path
    is_over: bool
    curves: list[dict[str, float]]
    best_round: int
    best: Any
    took_s: float


class Training:
    """Learns what a train file says, into a folder.

    Args:
        file: The train file.
        folder: Where checkpoint, policy and curves go; made where it is not there.
        is_resumed: Whether to go on from the checkpoint there.
        tell: Receives progress reports.
        show: Receives the figures of each round, and the number of the last.
        command: What makes the policy again, for its card.
    """

    def __init__(
        self,
        file: TrainFile,
        folder: Path,
        *,
        is_resumed: bool = False,
        tell: Told = lambda what, done, total: None,
        show: Callable[[Mapping[str, float], int], None] = lambda figures, last: None,
        command: str = "",
    ) -> None:
        self._file, self.folder, self._tell, self._show = file, folder, tell, show
        self._command = command or f"gslcosim train {file.path.name}"
        checkpoint = self._checkpoint(is_resumed=is_resumed)
        spec, family = file.spec, file.family
        cases: dict[str, list[LoadedScenario]] = {}
        wanted: tuple[tuple[Split, int], ...] = (
            ("training", spec.cases.training), ("validation", spec.cases.validation),
        )  # fmt: skip
        for split, n in wanted:
            cases[split] = family.cases(split, n, report=partial(tell, f"cases of {split}"))
        is_batched = not isinstance(spec.trainer, MethodSettings)
        if is_batched:
            _check_batch(file, (*cases["training"], *cases["validation"]))
        for split, _ in wanted:
            family.prepare(cases[split], report=partial(tell, f"rooms of {split}"))
            family.record_tapes(cases[split], report=partial(tell, f"tapes of {split}"))
        self.validation_cases = cases["validation"]
        self._pools: list[SearchPool] = []
        self.trainer: Trainer = self._trainer(cases["training"])
        validation_pool = self._pool(cases["validation"], len(cases["validation"])) if is_batched else None
        self._validation = PolicyValidation(family.name, cases["validation"], validation_pool)
        self._curves: list[dict[str, float]] = []
        self._best: Any = None
        self._best_round = 0
        self._took_s = 0.0
        self._state: Mapping[str, NDArray[Any]] = {}
        if checkpoint is not None:
            self._go_on(checkpoint)

    @property
    def n_rounds(self) -> int:
        """Number of rounds of the whole training."""
        trainer = self._file.spec.trainer
        return int(trainer.settings.get("rounds", 100)) if isinstance(trainer, PpoFileSettings) else trainer.rounds

    @property
    def _has_doping(self) -> bool:
        return self._file.spec.doping is not False and self._file.family.spec.doping is not None

    @property
    def n_done(self) -> int:
        """Number of rounds done."""
        return len(self._curves)

    def train(self, *, rounds: int | None = None) -> TrainingResult:
        """Learn to the end, or for some rounds, and leave checkpoint, policy and curves.

        Args:
            rounds: At most so many now; the training can be resumed afterwards.
        """
        last = self.n_rounds if rounds is None else min(self.n_done + rounds, self.n_rounds)
        spec, began, before_s = self._file.spec, time.monotonic(), self._took_s
        n_saved = self.n_done
        try:
            while self.n_done < last:
                figures, n = dict(self.trainer.step()), self.n_done + 1
                if n % spec.validate_every == 0 or n == self.n_rounds:
                    figures |= self._validated(n)
                self._state = self.trainer.state()
                self._curves.append(figures)
                self._took_s = before_s + time.monotonic() - began
                if n % spec.checkpoint_every == 0 or n == last:
                    self._save()
                    n_saved = n
                self._show(figures, self.n_rounds)
        finally:
            # What is kept is the state after the last whole round.
            if n_saved < self.n_done:
                self._save()
            for pool in self._pools:
                pool.close()
        return self.trained()

    def trained(self) -> TrainingResult:
        """Return the result of the training."""
        return TrainingResult(
            name=self._file.spec.name, folder=self.folder, is_over=self.n_done >= self.n_rounds,
            curves=list(self._curves), best_round=self._best_round, best=self._best, took_s=self._took_s,
        )  # fmt: skip

    def _checkpoint(self, *, is_resumed: bool) -> Checkpoint | None:
        if is_resumed:
            return load_checkpoint(self.folder, identity=self._file.identity)
        if (self.folder / CHECKPOINT).exists():
            raise UsageError(
                f"{self.folder}: expected a folder without a checkpoint, was one with. Go on with --resume, or give "
                "another folder with --out."
            )
        return None

    def _pool(self, cases: Any, n_envs: int, discount: float = 0.99) -> SearchPool:
        what = "searches of validation" if self._pools else "searches of training"
        spec = self._file.spec
        pool = SearchPool(
            cases, n_envs, action=spec.action.settings, discount=discount, flying=spec.flying,
            has_wind_frame=asks_wind_frame(spec.observations), report=partial(self._tell, what),
        )  # fmt: skip
        self._pools.append(pool)
        return pool

    def _trainer(self, cases: Any) -> Trainer:
        spec, family = self._file.spec, self._file.family
        settings, action, seed = spec.trainer, spec.action.settings, spec.seed
        weights = family.weights if self._has_doping else _evenly
        if isinstance(settings, CtrnnSettings):
            pool = self._pool(cases, settings.population * settings.cases_per_round)
            return EvolvedCtrnn(pool, action=action, settings=settings, seed=seed, weights=weights)
        if isinstance(settings, TableSettings):
            pool = self._pool(cases, settings.searches, settings.discount)
            return TabularQ(pool, action=action, settings=settings, seed=seed, weights=weights)
        if isinstance(settings, MethodSettings):
            return EvolvedMethod(family.name, cases, settings=settings, seed=seed, weights=weights)
        from gslcosim_training.trainers.recurrent_ppo import PpoSettings, RecurrentPpo

        ppo = PpoSettings.of(settings.settings)
        pool = self._pool(cases, settings.searches, ppo.discount)
        return RecurrentPpo(
            pool.envs, observation_names=pool.observation_names, action=action, settings=ppo, seed=seed,
            doping=pool.costs(weights) if self._has_doping else None,
        )  # fmt: skip

    def _validated(self, n: int) -> dict[str, float]:
        policy = self.trainer.policy()
        figures = self._validation.figures(policy)
        costs = [each["validation_cost"] for each in self._curves if "validation_cost" in each]
        if not costs or figures["validation_cost"] < min(costs):
            self._best, self._best_round = policy, n
        return figures

    def _save(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        best = self._best
        about: dict[str, Any] = {"curves": self._curves, "best_round": self._best_round, "took_s": self._took_s}
        arrays: dict[str, Any] = {}
        if isinstance(best, ArrayPolicy):
            arrays = dict(best.arrays)
            about["best"] = {
                "kind": best.kind, "observation_names": best.observation_names, "settings": best.settings,
            }  # fmt: skip
            save_policy(self.folder / POLICY_FILE, best, self._card())
        elif isinstance(best, EvolvedParameters):
            about["best"] = {"parameters": best.parameters}
            save_parameters(self.folder, best.entry.name, best.parameters, self._card())
        replace_file(self.folder, CURVES, (json.dumps(self._curves, indent=1) + "\n").encode())
        save_checkpoint(
            self.folder,
            Checkpoint(identity=self._file.identity, trainer=self._state, best=arrays, about=about),
        )

    def _go_on(self, checkpoint: Checkpoint) -> None:
        about = checkpoint.about
        self.trainer.resume(checkpoint.trainer)
        self._state = checkpoint.trainer
        self._curves, self._best_round = list(about["curves"]), int(about["best_round"])
        self._took_s = float(about["took_s"])
        best = about.get("best")
        if best is not None and "parameters" in best:
            policy = self.trainer.policy()
            self._best = EvolvedParameters(entry=policy.entry.model_copy(update={"parameters": best["parameters"]}))
        elif best is not None:
            self._best = KINDS[best["kind"]].of_arrays(
                tuple(best["observation_names"]), self._file.spec.action.settings, checkpoint.best, best["settings"]
            )

    def _card(self) -> dict[str, Any]:
        spec, seeds = self._file.spec, self._file.family.spec.seeds
        last = self._curves[-1]
        validated = [each for each in self._curves if "validation_cost" in each]
        best = min(validated, key=lambda each: each["validation_cost"], default={})
        return {
            "data": f"family {self._file.family.name}, {spec.cases.training} cases of training",
            "trainer": spec.trainer.model_dump(mode="json"),
            "seeds": {
                "training": spec.seed,
                "cases": [seeds.training.first, seeds.training.first + spec.cases.training - 1],
                "validation": [seeds.validation.first, seeds.validation.first + spec.cases.validation - 1],
            },
            "budget": {key: int(last[key]) for key in ("round", "steps", "flights") if key in last},
            "best_round": self._best_round,
            "validation": {key: best[key] for key in ("validation_cost", "validation_success") if key in best},
            "doping": self._has_doping,
            "training_time_s": round(self._took_s),
            "machine": f"{platform.machine()}, Python {platform.python_version()}",
            "versions": _versions(),
            "command": self._command,
        }


# Before rooms and winds are made, which may take minutes.
def _check_batch(file: TrainFile, cases: Sequence[LoadedScenario]) -> None:
    for case in cases:
        if (refusal := find_batch_refusal(case.scenario, file.spec.flying)) is not None:
            raise UsageError(
                f"{file.family.path}: seed {case.scenario.seed}: expected cases that can be batched for trainer.kind: "
                f"{file.spec.trainer.kind}. {refusal}"
            )


def _evenly(costs: Any) -> Any:
    return np.full(len(costs), 1.0 / len(costs))


def _versions() -> dict[str, str]:
    found: dict[str, str] = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
