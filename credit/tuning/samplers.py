"""Optuna's samplers, so that the same study asks for the same trials, also after it was killed and gone on with."""

from __future__ import annotations

import importlib.util
import warnings
from typing import Any

from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.exceptions import ExperimentalWarning
from optuna.samplers import BaseSampler, BruteForceSampler, CmaEsSampler, RandomSampler, TPESampler
from optuna.study import Study
from optuna.trial import FrozenTrial, TrialState

from credit.core.errors import UserError, nearest
from credit.tuning.space import Space, rounded

SAMPLERS = {"tpe": TPESampler, "random": RandomSampler, "cmaes": CmaEsSampler, "grid": BruteForceSampler}


def require(name: str, space: Space) -> None:
    """Refuse a sampler that there is not, or that cannot search a space.

    Raises:
        UserError: with what to write instead.
    """
    if name not in SAMPLERS:
        raise UserError(f"sampler={name}: there is none of that name; {nearest(name, SAMPLERS)}")
    if name == "grid" and space.count() is None:
        raise UserError("sampler=grid tries every setting, and an interval has no end of them; write range(…) or a,b,c")
    if name == "cmaes" and importlib.util.find_spec("cmaes") is None:
        raise UserError("sampler=cmaes: cmaes is not installed; pip install 'credit-rl[tune]', or leave sampler= out")


def sampler(name: str, number: int) -> BaseSampler:
    """What chooses a trial: a sampler whose random numbers depend on the trial's number alone.

    Args:
        name: tpe, random, cmaes or grid. number: of the trial.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        return Rounding(SAMPLERS[name](seed=number))


class Rounding(BaseSampler):
    """Another sampler with shorter numbers, so that folders, the store and the words to type agree.

    Args:
        inner: the sampler.
    """

    def __init__(self, inner: BaseSampler) -> None:
        self._inner = inner

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        """As the sampler has it."""
        return self._inner.infer_relative_search_space(study, trial)

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """The sampler's values of several keys, rounded."""
        found = self._inner.sample_relative(study, trial, search_space)
        return {key: _short(value, search_space[key]) for key, value in found.items()}

    def sample_independent(
        self, study: Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """The sampler's value of one key, rounded."""
        value = self._inner.sample_independent(study, trial, param_name, param_distribution)
        return _short(value, param_distribution)

    def before_trial(self, study: Study, trial: FrozenTrial) -> None:
        """As the sampler has it."""
        self._inner.before_trial(study, trial)

    def after_trial(self, study: Study, trial: FrozenTrial, state: TrialState, values: Any) -> None:
        """As the sampler has it; one that has tried all would stop a loop of Optuna's, which there is not."""
        if not isinstance(self._inner, BruteForceSampler):
            self._inner.after_trial(study, trial, state, values)

    def reseed_rng(self) -> None:
        """As the sampler has it."""
        self._inner.reseed_rng()


def _short(value: Any, allowed: BaseDistribution) -> Any:
    return rounded(value, allowed) if isinstance(allowed, FloatDistribution) else value
