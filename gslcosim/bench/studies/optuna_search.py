"""Optuna's tree-structured Parzen estimator as the source of settings; the only import of Optuna."""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gslcosim.base.errors import UsageError
from gslcosim.bench.studies.parameter_values import ParameterRange

STUDY = "tuning"


class OptunaSearch:
    """A study that asks for settings in batches and gets their scores in order: equal calls, equal settings.

    Nothing of it depends on who flew, or when: settings are drawn by the seed and by the scores given so far.
    The study is kept in a file that Optuna's own tools read; it is written again each time, from runs that are
    there.

    Source:
        Bergstra et al. 2011, Algorithms for Hyper-Parameter Optimization (TPE); Optuna: Akiba et al. 2019,
        doi:10.1145/3292500.3330701. Of a batch, settings without a score yet count as bad ones ("constant liar").
    """

    def __init__(self, ranges: Sequence[ParameterRange], *, seed: int, log: Path) -> None:
        """Begin a study.

        Args:
            ranges: What is searched.
            seed: Of all that is drawn.
            log: Where the study is kept; what stands there is replaced.

        Raises:
            UsageError: Optuna is not installed.
        """
        self._optuna = load_optuna()
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend

        self._ranges = tuple(ranges)
        self._distributions = {each.name: self._distribution(each) for each in ranges}
        self._waiting: list[Any] = []
        log.unlink(missing_ok=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", self._optuna.exceptions.ExperimentalWarning)
            sampler = self._optuna.samplers.TPESampler(seed=seed, constant_liar=True)
        self._study = self._optuna.create_study(
            storage=JournalStorage(JournalFileBackend(str(log))),
            sampler=sampler,
            study_name=STUDY,
            direction="maximize",
        )

    def ask(self, n: int) -> list[dict[str, int | float]]:
        """Return the next settings; their scores are given before the next ones are asked for."""
        assert not self._waiting, "scores are told before more is asked for"
        self._waiting = [self._study.ask(self._distributions) for _ in range(n)]
        return [{each.name: each.rounded(trial.params[each.name]) for each in self._ranges} for trial in self._waiting]

    def tell(self, scores: Sequence[float]) -> None:
        """Take the scores of the settings that were asked for, in their order."""
        for trial, score in zip(self._waiting, scores, strict=True):
            self._study.tell(trial, score)
        self._waiting = []

    def add(self, values: Mapping[str, int | float], score: float) -> None:
        """Take a setting that was not asked for, and its score."""
        self._study.add_trial(
            self._optuna.trial.create_trial(params=dict(values), distributions=self._distributions, value=score)
        )

    def _distribution(self, each: ParameterRange) -> Any:
        if each.is_whole:
            return self._optuna.distributions.IntDistribution(int(each.low), int(each.high), log=each.is_log)
        return self._optuna.distributions.FloatDistribution(float(each.low), float(each.high), log=each.is_log)


def load_optuna() -> Any:
    """Return Optuna, which then prints nothing by itself.

    Raises:
        UsageError: it is not installed.
    """
    try:
        import optuna
    except ModuleNotFoundError as error:
        raise UsageError(
            "tune: expected Optuna to be installed, was not. Install it: pip install 'gslcosim[tune]'"
        ) from error
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    return optuna
