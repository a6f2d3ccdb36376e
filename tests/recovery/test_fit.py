"""A recovery from Python: parts with their defaults, windows that are there, and what is refused."""

from __future__ import annotations

import pytest
import torch

from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.store import Store
from credit.core.windows import Windows
from credit.recovery.bonuses import Count
from credit.recovery.features.tabular import Bilinear, Identity
from credit.recovery.mixers import RelativeMSE
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Bootstrap

PROBLEM = Problem.finite(4, 2, window=3, seeds=(0, 1))


def windows(count: int = 12) -> Windows:
    generator = torch.Generator().manual_seed(0)
    states = torch.randint(4, (2, count, 4), generator=generator)
    actions = torch.randint(2, (2, count, 3), generator=generator)
    labels = (states[..., :-1] + actions).sum(-1).to(FLOAT)
    return Windows.of_grid(states[..., :-1], actions, states[..., 1:], labels)


def parts() -> tuple[LinearModel, dict[str, LinearModel]]:
    bootstrap = Bootstrap(4)
    return LinearModel("ridge", Identity(), bootstrap), {"linear": LinearModel("linear", Bilinear(), bootstrap)}


def test_fit_is_start_append_and_observe() -> None:
    whole = Recovery(*parts(), RelativeMSE(), {"bonus": Count()})
    store = Store(PROBLEM)
    store.append(windows())
    whole.start(PROBLEM)
    whole.observe(store)
    quick = Recovery(*parts(), bonus=Count()).fit(windows(), PROBLEM)
    one, other = whole.belief(), quick.belief()
    assert one is not None
    assert other is not None
    assert torch.equal(one.plan, other.plan)
    assert torch.equal(one.weights, other.weights)
    assert other.bonus.keys() == {"bonus"}
    assert torch.equal(quick.rewards(windows()), whole.rewards(windows()))


def test_a_reference_alone_is_enough() -> None:
    recovery = Recovery(parts()[0]).fit(windows(), PROBLEM)
    assert recovery.rewards(windows()).shape == (2, 36)


def test_a_store_without_windows_is_refused() -> None:
    recovery = Recovery(parts()[0])
    recovery.start(PROBLEM)
    with pytest.raises(UserError, match="no windows yet: append some"):
        recovery.observe(Store(PROBLEM))
