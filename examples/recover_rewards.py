"""Windows that you have, each with one label, become a reward for every step.

A shop knows its stock (0 to 9) and its price (low, middle, high) of every day, and its profit of every week.
"""

from __future__ import annotations

import numpy as np
import torch

from credit.core.problem import Problem
from credit.core.windows import Windows
from credit.recovery.bonuses import Disagreement
from credit.recovery.features.tabular import Bilinear, Identity
from credit.recovery.mixers import RelativeMSE
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Bootstrap

STOCKS, PRICES, DAYS, WEEKS = 10, 3, 7, 150


def weeks() -> tuple[Windows, np.ndarray]:
    """What the shop has written down, and the daily profit of each stock and price, which it does not know."""
    generator = np.random.default_rng(0)
    stock = generator.integers(STOCKS, size=(1, WEEKS, DAYS + 1))  # the first dimension: one replica
    price = generator.integers(PRICES, size=(1, WEEKS, DAYS))
    s, a = np.arange(STOCKS)[:, None], np.arange(PRICES)
    daily = 1 + 0.3 * s - 0.5 * a + 0.1 * s * a
    weekly = daily[stock[..., :-1], price].sum(-1) + generator.normal(0, 0.5, (1, WEEKS))
    steps = (torch.from_numpy(part) for part in (stock[..., :-1], price, stock[..., 1:], weekly))
    return Windows.of_grid(*steps), daily


def main() -> None:
    """Fit, and ask."""
    windows, daily = weeks()
    problem = Problem.finite(STOCKS, PRICES, window=DAYS, seeds=(0,))
    bootstrap = Bootstrap(draws=20)  # one for both models: they see the same resampled weeks
    recovery = Recovery(
        reference=LinearModel("ridge", Identity(), bootstrap),  # a number for each stock and price
        surrogates={"linear": LinearModel("linear", Bilinear(), bootstrap)},  # 1, s, a, s·a
        mixer=RelativeMSE(),
        bonus={"disagreement": Disagreement(scale=1.0)},
    )
    recovery.fit(windows, problem)

    belief = recovery.belief()  # of every cell [1, ..., N], N = stocks × prices
    assert belief is not None
    print(f"a reward for each of {recovery.rewards(windows).shape[1]} days, optimism included")
    for index, name in enumerate(belief.models):
        proxy, weight = float(belief.mse[:, index].mean()), float(belief.weights[:, index].mean())
        print(f"{name:<7} MSE proxy {proxy:.4f}, weight {weight:.2f}")
    print(f"disagreement of the two: {float(belief.disagreement.mean().sqrt()):.3f}")
    error = belief.mixed[0].view(STOCKS, PRICES).numpy() - daily
    print(f"recovered within {np.sqrt((error**2).mean()):.3f} of daily profits that range over {np.ptp(daily):.1f}")


if __name__ == "__main__":
    main()
