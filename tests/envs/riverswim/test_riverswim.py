"""Facts of RiverSwim: P by hand, and its average reward in closed form."""

from __future__ import annotations

import pytest
import torch

from credit.core.errors import UserError
from credit.envs.feedback import BlockSum
from credit.envs.riverswim.environment import RiverSwim

from ..collecting import collected


def test_transition_rows_by_hand() -> None:
    p = RiverSwim().mdp.transition
    assert p.shape == (6, 2, 6)
    for s in range(6):
        assert float(p[s, 0, max(s - 1, 0)]) == 1
    expected = {0: {0: 0.4, 1: 0.6}, 5: {4: 0.4, 5: 0.6}}
    expected |= {s: {s - 1: 0.05, s: 0.6, s + 1: 0.35} for s in range(1, 5)}
    for s, row in expected.items():
        assert {int(i): pytest.approx(float(p[s, 1, i])) for i in p[s, 1].nonzero()} == row


def test_rewards_by_hand() -> None:
    reward = RiverSwim().mdp.reward
    assert reward.nonzero().tolist() == [[0, 0], [5, 1]]
    assert float(reward[0, 0]) == 0.005
    assert float(reward[5, 1]) == 1


def test_the_best_is_to_swim_and_its_gain_is_that_of_a_birth_death_chain() -> None:
    """Detailed balance: 1, ·.6/.05, three times ·.35/.05, ·.35/.4 → 3601.5 of 8402.5 steps in the last state."""
    mdp = RiverSwim().mdp
    weights = torch.tensor([1, 12, 84, 588, 4116, 3601.5], dtype=torch.float64)
    assert mdp.optimal.policy.tolist() == [1] * 6
    assert float(mdp.optimal.gain) == pytest.approx(3601.5 / 8402.5)
    torch.testing.assert_close(mdp.occupancy, weights / weights.sum())


def test_the_numbers_of_the_first_paper() -> None:
    """γ = .95 there; by the average reward, too, it is best to swim."""
    mdp = RiverSwim(forward=0.3, back=0.1, first=0.3, last=0.3, near=5, far=3000).mdp
    weights = torch.tensor([1, 3, 9, 27, 81, 81 * 0.3 / 0.7], dtype=torch.float64)
    assert mdp.optimal.policy.tolist() == [1] * 6
    assert float(mdp.optimal.gain) == pytest.approx(float(3000 * weights[5] / weights.sum()))


def test_a_run_of_the_current_alone_gives_the_small_reward() -> None:
    windows, primitive = collected(RiverSwim(), BlockSum(7, 0.0), (0, 1), lambda s, _: torch.zeros_like(s), 3)
    assert torch.equal(windows.states, torch.zeros_like(windows.states))
    torch.testing.assert_close(primitive, torch.full_like(primitive, 0.005))


def test_what_is_refused() -> None:
    with pytest.raises(UserError, match=r"forward \+ env.back = 1.2"):
        RiverSwim(forward=0.7, back=0.5)
    with pytest.raises(UserError, match="states"):
        RiverSwim(states=1)
