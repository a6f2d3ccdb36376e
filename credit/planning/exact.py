"""The true transitions: not a learner, but how much of the regret is due to an estimated P."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor

from credit.core.interfaces import Environment
from credit.core.tables import TransitionModel
from credit.core.types import Problem, Windows
from credit.envs.exact.episodic import EpisodicEnvironment


class Exact(TransitionModel):
    """P itself, told by the environment: an oracle for planners.

    Args:
        env: the environment.
    """

    domain: ClassVar = "tabular"
    setting: ClassVar = "episodic"
    needs: ClassVar = {"env": EpisodicEnvironment}
    keeps: ClassVar = ()

    def __init__(self, env: Environment) -> None:
        self.env = env

    def start(self, problem: Problem) -> None:
        """Nothing to learn."""

    def observe(self, windows: Windows) -> None:
        """Nothing to learn."""

    def backup(self, values: Tensor) -> Tensor:
        """Σ P(s'|s, a) v(s') [R, S, A]."""
        assert isinstance(self.env, EpisodicEnvironment)
        return self.env.mdp.backup(values).to(values.device)
