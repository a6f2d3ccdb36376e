"""Windows of numbered states and actions with a label each → a reward for every pair, and how far it can be trusted.

Run:  python examples/recover_table.py
"""

from __future__ import annotations

import torch

from credit.core.problem import Problem
from credit.core.store import Store, Windows
from credit.recovery.features.tabular import Bilinear, Identity
from credit.recovery.mixers import RelativeMSE
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Bootstrap

STATES, ACTIONS, WINDOW, COUNT = 10, 3, 7, 400


def logged() -> tuple[Windows, torch.Tensor]:
    """Your windows: steps [R, K, T], here with R = 1, and labels [R, K]; and the reward behind them, to look at."""
    generator = torch.Generator().manual_seed(0)
    states, next_states = (torch.randint(STATES, (1, COUNT, WINDOW), generator=generator) for _ in range(2))
    actions = torch.randint(ACTIONS, (1, COUNT, WINDOW), generator=generator)
    truth = (0.1 + 0.05 * torch.arange(STATES).double().unsqueeze(1)) * torch.tensor([0.0, 1.0, 1.5]).double()
    noise = 0.2 * torch.randn(1, COUNT, dtype=torch.float64, generator=generator)
    return Windows.of_grid(states, actions, next_states, truth[states, actions].sum(-1) + noise), truth


def main() -> dict[str, float]:
    """Fit, and say what was found."""
    windows, truth = logged()
    problem = Problem.finite(STATES, ACTIONS, WINDOW, seeds=(0,))
    bootstrap = Bootstrap(draws=20)  # one for all models: Δ̂² compares their fits to the same resampled windows
    reference = LinearModel("ridge", Identity(), bootstrap)
    surrogates = {"linear": LinearModel("linear", Bilinear(), bootstrap)}
    recovery = Recovery(reference, surrogates, RelativeMSE(), bonus={})
    store = Store(problem)
    recovery.start(problem)
    store.append(windows)  # and more, as they come
    recovery.observe(store)

    belief = recovery.belief()
    assert belief is not None
    for name, error, weight in zip(belief.models, belief.mse[0], belief.weights[0], strict=True):
        print(f"{name:8} root of the MSE proxy {error.mean().sqrt():.3f}, weight {weight.mean():.2f}")
    print(
        "reward of every state and action:", belief.mixed[0].view(STATES, ACTIONS).round(decimals=2).tolist(), sep="\n"
    )
    error = (belief.mixed[0] - truth.flatten()).square().mean().sqrt()
    alone = (belief.mean[0, 0] - truth.flatten()).square().mean().sqrt()
    steps = recovery.rewards(windows)  # [R, rows]: what an agent would learn from
    print(f"error of a reward: {error:.3f}, by the reference alone {alone:.3f}; {steps.numel()} steps were relabelled")
    return {"error": float(error), "alone": float(alone), "steps": steps.numel()}


if __name__ == "__main__":
    main()
