"""Train files: the trainer, the family and the seed of a training."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from gslcosim.base.bundled import bundled_train_files
from gslcosim.base.errors import ScenarioError
from gslcosim.base.problems import Problem, broken_rule_error
from gslcosim.scenario.checks.registry import find_problems
from gslcosim.scenario.models.base import Name, NonNegative, Positive, Spec
from gslcosim.scenario.problems import did_you_mean
from gslcosim_bench.cases.spec_files import raise_located, read_spec_file
from gslcosim_search.learned.encoding import find_frame_problem, find_shield_problem
from gslcosim_search.learned.policy import ActionSettings
from gslcosim_training.family import Family, load_family
from gslcosim_training.trainers.trainer import CtrnnSettings, MethodSettings, TableSettings

_Count = Annotated[int, Field(ge=1, le=1_000_000)]


class PpoFileSettings(Spec):
    """Recurrent PPO in so many `searches` at once; `settings` are those of `PpoSettings`, `rounds` among them."""

    kind: Literal["recurrent_ppo"]
    searches: _Count = 512
    settings: dict[str, Any] = {}  # noqa: RUF012 - pydantic copies it


def _kind_of(value: Any) -> str | None:
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return kind if isinstance(kind, str) else None


TrainerSettings = Annotated[
    Annotated[CtrnnSettings, Tag("ctrnn")]
    | Annotated[TableSettings, Tag("table")]
    | Annotated[MethodSettings, Tag("method")]
    | Annotated[PpoFileSettings, Tag("recurrent_ppo")],
    Discriminator(_kind_of),
]


class ActionSpec(Spec):
    """Meaning of actions; see docs/train.md."""

    kind: Literal["velocity", "velocity_3d", "waypoint", "waypoint_3d", "heading"] = "velocity"
    step_m: Positive = 1.0
    speed_m_s: Positive = 1.0
    hold_s: NonNegative | None = None
    frame: Literal["world", "wind"] = "world"
    shield_m: NonNegative | None = None

    @model_validator(mode="after")
    def _check_frame_and_shield(self) -> Self:
        if find_frame_problem(self.kind, self.frame) is not None:
            raise broken_rule_error(
                key="frame", expected=f"world for {self.kind}", found=self.frame, remedy="Leave it out."
            )
        if find_shield_problem(self.kind, self.shield_m) is not None:
            raise broken_rule_error(
                key="shield_m", expected=f"none for {self.kind}", found=f"{self.shield_m}", remedy="Leave it out."
            )
        return self

    @property
    def settings(self) -> ActionSettings:
        """Settings that policies and environments take."""
        return ActionSettings(**self.model_dump())


class CasesSpec(Spec):
    """Numbers of cases of the family for training and for validation."""

    training: _Count = 256
    validation: _Count = 64


class TrainSpec(Spec):
    """A whole train file.

    After each `validate_every` rounds, and at the end, the policy flies the cases of validation; the best is kept.
    After each `checkpoint_every` a checkpoint is written. `doping: false` lets all cases come equally often whatever
    the family says. `flying` with another value trains with rotorcraft that fly as `BatchSearchEnv` says.
    """

    schema_: Literal["gslcosim/train/1"] = Field(alias="schema")
    name: Name
    family: str
    trainer: TrainerSettings
    action: ActionSpec = ActionSpec()
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    cases: CasesSpec = CasesSpec()
    validate_every: _Count = 10
    checkpoint_every: _Count = 10
    doping: bool = True
    flying: Literal["exact", "first_order", "rigid_body"] = "exact"

    @property
    def observations(self) -> tuple[str, ...]:
        """Names of observations that the file lists; none where the trainer takes what there is."""
        if isinstance(self.trainer, PpoFileSettings):
            return tuple(map(str, self.trainer.settings.get("observations") or ()))
        return self.trainer.observations if isinstance(self.trainer, CtrnnSettings) else ()

    @model_validator(mode="after")
    def _check_flying(self) -> Self:
        if self.flying != "exact" and isinstance(self.trainer, MethodSettings):
            raise broken_rule_error(
                key="flying",
                expected="none with a trainer of a method, which flies in full",
                found=self.flying,
                remedy="Leave it out.",
            )
        return self

    @model_validator(mode="after")
    def _check_action(self) -> Self:
        if isinstance(self.trainer, MethodSettings) and "action" in self.model_fields_set:
            raise broken_rule_error(
                key="action",
                expected="none for trainer.kind: method, whose methods command what they like",
                found="one",
                remedy="Leave it out.",
            )
        return self


@dataclass(frozen=True, kw_only=True)
class TrainFile:
    """A valid train file with its family."""

    spec: TrainSpec
    family: Family
    path: Path

    @property
    def identity(self) -> str:
        """A hash of all that decides what is learned: the file as resolved, and its family."""
        text = f"{self.spec.model_dump_json()}\n{self.family.identity}"
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def load_train_file(source: str | Path, *, is_flown: bool = False) -> TrainFile:
    """Read and check a train file, and its family.

    Args:
        is_flown: Whether trainer, settings and first cases are checked too, as for a training that begins.
    """
    path, bundled = Path(source), bundled_train_files()
    if not path.is_file():
        if str(source) not in bundled:
            raise ScenarioError(
                f"{source}: expected a train file or a bundled one ({', '.join(bundled)}), found neither. "
                f"{did_you_mean(str(source), list(bundled))}".rstrip()
            )
        path = bundled[str(source)]
    spec = read_spec_file(path, TrainSpec, shown_path=str(path), keys="family and trainer")
    beside = path.parent / spec.family
    family = load_family(beside if beside.is_file() else spec.family)
    file = TrainFile(spec=spec, family=family, path=path)
    problems: list[Problem] = []
    if "doping" in spec.model_fields_set and family.spec.doping is None:
        problems.append(
            Problem(
                where="doping",
                expected=f"nothing with the family {family.name}, which has no doping",
                found=str(spec.doping).lower(),
                remedy="Leave it out, or give the family doping.",
            )
        )
    if is_flown:
        problems += find_problems("train", file, path.parent)
    raise_located(problems, path, shown_path=str(path))
    return file
