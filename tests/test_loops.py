"""Every loop does what the tensor operations beside it do, to rounding: as Python here, and compiled where Numba is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from credit.agents.value_iteration import ValueIteration
from credit.core import compiled
from credit.core.problem import FLOAT, Problem
from credit.core.windows import Windows
from credit.envs.advertiser.environment import Advertiser
from credit.envs.collect import Collector
from credit.envs.exact.loops import follow
from credit.envs.feedback import BlockSum
from credit.planning.counts import Counts
from credit.planning.loops import improve
from credit.planning.solve import NEARLY_ONE, best_policy, policy_iteration
from credit.recovery.features.tabular import Bilinear, Identity
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.loops import sherman_morrison
from credit.recovery.uncertainty.bootstrap import Analytic, FitUncertainty
from credit.trainer import Trainer

from .recovery.fits import Experience, Given, poisson

Use = Callable[[bool], None]
ROUNDING = 1e-11  # fits of rewards below 1: 1e-14 after 60 windows, and another bootstrap differs by .01


@pytest.fixture(params=["python", "compiled"])
def use(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Use:
    """Call with whether loops take the place of tensor operations."""
    if request.param == "python":
        monkeypatch.setattr(compiled, "kept", lambda function: function)
        for loop in (follow, improve, sherman_morrison):
            monkeypatch.setattr(loop, "_compiled", None)
    return lambda looping: monkeypatch.setenv("NUMBA_DISABLE_JIT", "0" if looping else "1")


@pytest.mark.parametrize("uncertainty", [lambda: Given(3), lambda: Analytic(noise=None)])
@pytest.mark.parametrize("features", [Identity, Bilinear])
def test_recursive_least_squares(
    use: Use,
    make_problem: Callable[..., Problem],
    make_windows: Callable[..., Windows],
    features: type,
    uncertainty: Callable[[], FitUncertainty],
) -> None:
    problem = make_problem((0, 1))
    windows, found = make_windows(problem, 4, seed=2), []
    weights = poisson(windows, 3)
    assert (weights == 0).any()
    for looping in (False, True):
        use(looping)
        model = LinearModel("ridge", features(), uncertainty())
        Experience(problem, model).see(windows, weights)
        estimate = model.estimate()
        residual = model.residual() if model.uncertainty.sees_residuals else torch.zeros(0)
        found.append((estimate.mean, estimate.draws, estimate.variance, residual, model._inverse))
    for tensors, looped in zip(*found, strict=True):
        torch.testing.assert_close(looped, tensors, atol=ROUNDING, rtol=0)
    assert torch.equal(found[1][-1], found[1][-1].mT), "V⁻¹ stays symmetric"


def test_a_fit_in_which_a_window_counts_nothing_is_left_alone(
    use: Use, make_problem: Callable[..., Problem], make_windows: Callable[..., Windows]
) -> None:
    use(True)
    problem = make_problem((0,))
    windows = make_windows(problem, 1)
    model = LinearModel("ridge", Identity(), Given(1))
    Experience(problem, model).see(windows, torch.tensor([[[1.0, 0.0]]], dtype=FLOAT))
    assert not model._theta[0, 1].any()
    assert model._theta[0, 0].any()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("discount", [NEARLY_ONE, 0.9])
def test_policy_iteration(use: Use, seed: int, discount: float) -> None:
    rng = np.random.default_rng(seed)
    transition = torch.from_numpy(rng.dirichlet(np.ones(6), size=(4, 6, 3)))
    transition[0, :2] = 0  # rows of pairs that were never seen, to the letter
    reward = torch.from_numpy(rng.normal(size=(4, 6, 3)).round(1))  # some ties
    start = torch.from_numpy(rng.integers(3, size=(4, 6)))
    use(True)
    before = start.clone()
    found = best_policy(transition, reward, discount, start)
    assert torch.equal(start, before), "the last plan may be needed again"
    assert torch.equal(found, policy_iteration(transition, reward, discount, start).policy)


def test_ties_go_to_the_first_action_and_keep_the_one_that_is_there(use: Use) -> None:
    use(True)
    transition, reward = torch.full((2, 2, 3, 2), 0.5, dtype=FLOAT), torch.tensor([0.0, 1.0, 1.0], dtype=FLOAT)
    start = torch.tensor([[0, 0], [2, 1]])
    assert best_policy(transition, reward.expand(2, 2, 3), 0.9, start).tolist() == [[1, 1], [2, 1]]


@pytest.mark.parametrize("rounds", [(1, 1, 1), (3,), (2, 1)])
def test_following_a_table_is_stepping(use: Use, rounds: tuple[int, ...]) -> None:
    found = []
    for looping in (False, True):
        use(looping)
        env, feedback, agent = Advertiser(), BlockSum(window=7), ValueIteration(Counts())
        problem = env.problem(7, (0, 5), "cpu")
        for part in (env, feedback, agent):
            part.start(problem)
        agent._actions = torch.arange(20).view(2, 10) % 3
        collector = Collector(env, feedback, problem)
        parts = [collector.collect(agent, count) for count in rounds]
        parts.append(collector.collect(agent, 1, 3))  # one that is cut short
        held = collector.state_dict(), env.state_dict()
        again = Advertiser()
        again.start(problem)
        other = Collector(again, feedback, problem)
        other.load_state_dict(held[0])
        again.load_state_dict(held[1])
        parts += [collector.collect(agent, 1, 4), collector.collect(agent, 1)]
        resumed = [other.collect(agent, 1, 4), other.collect(agent, 1)]
        assert torch.equal(parts[-1][0].states, resumed[-1][0].states)
        found.append(parts)
    for (stepped, first), (followed, second) in zip(*found, strict=True):
        assert torch.equal(first, second)
        for name in ("states", "actions", "next_states", "labels"):
            assert torch.equal(getattr(stepped, name), getattr(followed, name)), name


def test_a_run_takes_the_same_actions(use: Use, make_trainer: Callable[..., Trainer]) -> None:
    found = []
    for looping in (False, True):
        use(looping)
        trainer = make_trainer("disagreement", (0, 1), "trainer.steps=140")
        trainer.run(lambda step, values: None)
        found.append(trainer)
    tensors, looped = found
    assert torch.equal(tensors.store.windows.actions, looped.store.windows.actions)
    torch.testing.assert_close(looped.belief().plan, tensors.belief().plan, atol=ROUNDING, rtol=0)
