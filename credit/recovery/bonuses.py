"""What optimism adds to the mixed reward: pure equations on [R, N] and the components that carry their scales."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from credit.core.belief import Belief
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.ranges import NonNegative, Positive
from credit.core.seams import Bonus, RewardModel
from credit.core.shapes import agree
from credit.core.steps import Steps
from credit.core.streams import generators
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.ridge import RidgeModel


def shrink(visits: Tensor, lambda_visits: float) -> Tensor:
    """1/√(λ + N(s, a)), the decay that all count-scaled bonuses share."""
    return (lambda_visits + visits).rsqrt()


def best_error(mse: Tensor, best: Tensor) -> Tensor:
    """√MSE of the locally best model, (17) and (33): mse [..., M, N], best [..., N]."""
    agree(mse=(mse, "M N"), best=(best, "N"))
    return mse.gather(-2, best.unsqueeze(-2)).squeeze(-2).sqrt()


def disagreement_signal(mse: Tensor, disagreement: Tensor, best: Tensor) -> Tensor:
    """e(s, a) of (18): √MSE_ref where the reference is locally best, √Δ̂² of the best surrogate elsewhere.

    Args:
        mse: [..., M, N], the reference first. disagreement: Δ̂² [..., M−1, N]. best: [..., N], 0 is the reference.
    """
    agree(mse=(mse, "M N"), disagreement=(disagreement, "M-1 N"), best=(best, "N"))
    choices = torch.cat([mse[..., :1, :], disagreement], dim=-2)
    return choices.gather(-2, best.unsqueeze(-2)).squeeze(-2).sqrt()


class _Scaled(Bonus):
    """A bonus c·(…)/√(λ + N) that decays with the visits; or, where none can be counted, one that does not."""

    by_belief: ClassVar = True

    def __init__(self, scale: NonNegative = 1.0, lambda_visits: Positive | None = 1.0) -> None:
        self.scale = scale
        self.lambda_visits = lambda_visits

    def start(self, problem: Problem) -> None:
        """Refuse to decay with visits where there are none.

        Raises:
            UserError: there are no visits to count, and λ is a number.
        """
        if not problem.tabular and self.scale and self.lambda_visits is not None:
            raise UserError(
                f"bonus: {type(self).__name__} with scale={self.scale} decays with visits, and where states are real "
                "numbers there are none to count; set its scale to 0, or lambda_visits=null if it has meaning without"
            )

    def decay(self, belief: Belief) -> Tensor | float:
        """1/√(λ + N), or 1."""
        if self.lambda_visits is None or belief.visits is None:
            return 1.0
        return shrink(belief.visits, self.lambda_visits)


class Count(_Scaled):
    """The count bonus c/√(λ + N(s, a)) of (17) and (19).

    Args:
        scale: c_base; 0 where visits cannot be counted.
        lambda_visits: λ added to the visits.
    """

    def __init__(self, scale: NonNegative = 0.35, lambda_visits: Positive = 1.0) -> None:
        super().__init__(scale, lambda_visits)

    def __call__(self, belief: Belief, reference: RewardModel, steps: Steps | None = None) -> Tensor:
        """c/√(λ + N)."""
        decay = self.decay(belief)
        return self.scale * decay if isinstance(decay, Tensor) else torch.full_like(belief.mixed, self.scale * decay)


class LocalMSE(_Scaled):
    """Uncertainty of the locally best model, c·√MSE_j*/√(λ + N) (17), (31); with the reference alone it is (30).

    Args:
        scale: c_mse.
        lambda_visits: λ added to the visits; null leaves the decay out, which makes it (33).
    """

    def __call__(self, belief: Belief, reference: RewardModel, steps: Steps | None = None) -> Tensor:
        """Equation (17), last term, or (33)."""
        return self.scale * best_error(belief.mse, belief.best) * self.decay(belief)


class Disagreement(_Scaled):
    """Reference uncertainty or reference–surrogate disagreement, c·e/√(λ + N) (18), (19), (32).

    Args:
        scale: c_dis.
        lambda_visits: λ added to the visits; null leaves the decay out, which makes it (34).
    """

    def __call__(self, belief: Belief, reference: RewardModel, steps: Steps | None = None) -> Tensor:
        """Equation (19), last term, or (34)."""
        signal = disagreement_signal(belief.mse, belief.disagreement, belief.best)
        return self.scale * signal * self.decay(belief)


class Elliptical(Bonus):
    """The width of the ridge confidence set, c·σ·√(φᵀV⁻¹φ): what the proof of theorem 1 bounds (38), (39).

    Args:
        scale: c.
        noise: σ, standard deviation of a label's noise, in units of reward.
    """

    needs: ClassVar = {"reference": RidgeModel}

    def __init__(self, scale: NonNegative = 2.0, noise: Positive = 0.2) -> None:
        self.scale = scale
        self.noise = noise

    def __call__(self, belief: Belief, reference: RewardModel, steps: Steps | None = None) -> Tensor:
        """c·σ·√(φᵀV⁻¹φ)."""
        assert isinstance(reference, RidgeModel)
        return self.scale * self.noise * reference.leverage(steps).sqrt()


class Thompson(Bonus):
    """A posterior draw in place of a bonus: adds Φ(θ̃ − θ̂) with θ̃ ~ N(θ̂, v²V⁻¹), drawn anew at every refit.

    Args:
        scale: v, in units of reward.
    """

    needs: ClassVar = {"reference": LinearModel}

    def __init__(self, scale: NonNegative = 0.15) -> None:
        self.scale = scale

    def start(self, problem: Problem) -> None:
        """Make the generators; how many numbers they draw, the reference says."""
        self._generators = generators(problem.seeds, "thompson")
        self._normal = problem.zeros(0)

    def __call__(self, belief: Belief, reference: RewardModel, steps: Steps | None = None) -> Tensor:
        """v·Φ V^{-1/2} z; other steps than all places are looked at with the last z."""
        assert isinstance(reference, LinearModel)
        if steps is None or not self._normal.shape[1]:
            drawn = np.stack([g.standard_normal(reference.theta.shape[-1]) for g in self._generators])
            self._normal = torch.from_numpy(drawn).to(self._normal.device)
        return self.scale * reference.perturbation(self._normal, steps)
