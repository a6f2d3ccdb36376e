"""Episodes of real numbers, of any lengths, with a label each → a reward for every step; with a surrogate of one's own.

Run:  python examples/recover_steps.py
"""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from credit.core.problem import Problem
from credit.core.seams import FeatureMap
from credit.core.steps import Steps
from credit.core.windows import Episode, Windows
from credit.recovery.features.motion import Motion
from credit.recovery.mixers import RelativeMSE
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.neural import NeuralModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Analytic
from credit.recovery.uncertainty.networks import LastLayer


class Speed(FeatureMap):
    """What I believe that the reward looks at: how fast a body moves, and whether it pushes."""

    observations: ClassVar = "vector"

    def start(self, problem: Problem) -> None:
        """Nothing to learn."""

    def __call__(self, steps: Steps) -> Tensor:
        """(1, |v|, |a|) [..., 3]."""
        speed, push = steps.states[..., 2:].norm(dim=-1), steps.actions.norm(dim=-1)
        return torch.stack([torch.ones_like(speed), speed, push], -1)


def worth(states: Tensor, actions: Tensor) -> Tensor:
    """The reward behind the labels [...]."""
    return 0.05 * states[..., 2:].norm(dim=-1) - 0.02 * actions.norm(dim=-1)


def logged(count: int = 300) -> Windows:
    """Your episodes; here random walks of a body (x, y, vx, vy), whose label is the sum of a reward, and noise."""
    generator = torch.Generator().manual_seed(0)
    episodes, labels = [], []
    for _ in range(count):
        length = int(torch.randint(5, 11, (1,), generator=generator))
        path, push = torch.randn(length + 1, 4, generator=generator), torch.randn(length, 2, generator=generator)
        episodes.append(Episode(path[:-1], push.clamp(-1, 1), path[1:]))
        noise = 0.05 * float(torch.randn(1, generator=generator))
        labels.append(float(worth(path[:-1], push.clamp(-1, 1)).sum()) + noise)
    return Windows.of_episodes([episodes], torch.tensor([labels], dtype=torch.float64))


def main() -> dict[str, float]:
    """Fit, and say what was found."""
    windows = logged()
    problem = Problem.vectors(observations=4, actions=2, window=10, seeds=(0,))
    reference = NeuralModel("network", Motion(), LastLayer(noise=0.05), width=16, stride=1, first_steps=800)
    surrogates = {"speed": LinearModel("speed", Speed(), Analytic(noise=None), regularization=0.01)}
    recovery = Recovery(reference, surrogates, RelativeMSE(alpha=0.1)).fit(windows, problem)

    rewards, true = recovery.rewards(windows)[0], worth(windows.states, windows.actions)[0]
    correlation = torch.corrcoef(torch.stack([rewards, true]))[0, 1]
    belief = recovery.belief()
    assert belief is not None
    weights = dict(zip(belief.models, belief.weights[0].mean(-1).tolist(), strict=True))
    print(f"{len(windows)} steps; correlation with the true reward {correlation:.2f}; mean weights {weights}")
    return {"correlation": float(correlation), **weights}


if __name__ == "__main__":
    torch.set_num_threads(1)  # networks this small are slower on several
    main()
