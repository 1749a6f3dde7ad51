"""Selection of a plan's trials by the patterns of `--only` and `--filter`."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from gslcosim.base.errors import UsageError
from gslcosim.bench.cases.trials import Trial

KEYS = ("entry", "scenario", "family", "case", "repetition", "control", "trial")


@dataclass(frozen=True)
class Selection:
    """Patterns by key, as `--only entry=e_*,surge_cast` has them; of one key any may fit, of several keys all must."""

    patterns: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @classmethod
    def of(cls, only: Sequence[str], text: str | None = None) -> "Selection":
        """Return the selection of a command line.

        Args:
            only: Texts like `entry=e_coli,surge_*`.
            text: A pattern for the name of the case, such as `gsl_bench_3/*`.

        Raises:
            UsageError: a text is not `key=patterns`, or the key is unknown.
        """
        patterns: list[tuple[str, tuple[str, ...]]] = []
        for word in only:
            key, equals, values = word.partition("=")
            if not equals or key not in KEYS or not values:
                raise UsageError(
                    f"--only: expected KEY=PATTERN with a key among {', '.join(KEYS)}, was '{word}'. "
                    "For example: --only entry=e_coli,surge_*"
                )
            patterns.append((key, tuple(values.split(","))))
        if text is not None:
            patterns.append(("case", (text if any(c in text for c in "*?[") else f"*{text}*",)))
        return cls(tuple(patterns))

    def takes(self, trial: Trial) -> bool:
        """Return whether a trial is chosen."""
        values = {
            "entry": trial.entry,
            "scenario": trial.scenario,
            "family": trial.family,
            "case": trial.case,
            "repetition": str(trial.repetition),
            "control": "yes" if trial.is_control else "no",
            "trial": trial.id,
        }
        return all(any(fnmatchcase(values[key], one) for one in some) for key, some in self.patterns)
