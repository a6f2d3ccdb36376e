"""A recovery from Python: parts with their defaults, windows that are there, and what is refused."""

from __future__ import annotations

import pytest
import torch

from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.store import Store
from credit.core.windows import Episode, Windows
from credit.recovery.bonuses import Count
from credit.recovery.features.motion import Motion
from credit.recovery.features.tabular import Bilinear, Identity
from credit.recovery.mixers import RelativeMSE
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap

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


def test_rows_have_rewards_of_their_own() -> None:
    problem = Problem.vectors(2, 1, window=3, seeds=(0,))
    recovery = Recovery(LinearModel("linear", Motion(), Analytic(noise=1.0)))
    for prepare in (lambda: None, lambda: recovery.start(problem)):
        prepare()
        belief = recovery.belief()
        assert belief is None or belief.mixed.shape == (1, 0)
        with pytest.raises(UserError, match="has seen no windows yet"):
            recovery.rewards(rows(0))
    recovery.fit(rows(0), problem)
    assert torch.equal(recovery.rewards(rows(0)), recovery.fit(rows(0), problem).rewards(rows(0)))
    with pytest.raises(UserError, match=r"these 9 rows are neither all 9 .* nor the newest 9.* ask `believe"):
        recovery.rewards(rows(1))


def rows(seed: int) -> Windows:
    generator = torch.Generator().manual_seed(seed)
    states, actions = torch.randn(1, 3, 4, 2, generator=generator), torch.rand(1, 3, 3, 1, generator=generator)
    return Windows.of_grid(states[..., :-1, :], actions, states[..., 1:, :], actions.sum((2, 3)).to(FLOAT))


def test_steps_that_do_not_belong_together_are_no_windows() -> None:
    some = torch.zeros(4, 2)
    good, bad = Episode(some, some, some), Episode(some, some[:3], some)
    with pytest.raises(UserError, match="episode 1 of replica 0 has 4 states, 3 actions and 4 next states"):
        Windows.of_episodes([[good, bad]], torch.zeros(1, 2))
    with pytest.raises(UserError, match=r"labels have the shape \[1, 2\], and these episodes need \[1, 1\]"):
        Windows.of_episodes([[good]], torch.zeros(1, 2))
    grid = torch.zeros(1, 2, 3, dtype=torch.int64)
    with pytest.raises(UserError, match=r"\[\[1, 2, 3\], \[1, 2, 2\], \[1, 2, 3\]\], and labels have \[1, 2\]"):
        Windows.of_grid(grid, grid[..., :2], grid, torch.zeros(1, 2))


def test_a_store_without_windows_is_refused() -> None:
    recovery = Recovery(parts()[0])
    recovery.start(PROBLEM)
    store = Store(PROBLEM)
    for ask in (lambda: recovery.observe(store), lambda: store.windows, lambda: store.new):
        with pytest.raises(UserError, match="no windows yet: append some"):
            ask()
