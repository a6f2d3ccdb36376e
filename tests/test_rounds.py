"""The start of a run: rounds of their own size, windows of random actions, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch

from credit.agents.random import Random
from credit.core.errors import UserError
from credit.core.policy import tabulate
from credit.core.seams import CreditAssigner
from credit.core.store import Store
from credit.trainer import Trainer

Make = Callable[..., Trainer]
Journal = list[tuple[int, dict[str, torch.Tensor]]]


def run(trainer: Trainer) -> Journal:
    journal: Journal = []
    trainer.run(lambda step, values: journal.append((step, values)))
    return journal


class Fixed(Random):
    """Acts by the state, and counts the windows of every round."""

    def __init__(self) -> None:
        self.rounds: list[int] = []

    def act(self, states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        return (states + step) % 3

    def improve(self, store: Store, assigner: CreditAssigner) -> None:
        assert store.new.labels.shape[1] == len(store) - sum(self.rounds)
        self.rounds.append(store.new.labels.shape[1])


@pytest.mark.parametrize(
    ("size", "first", "first_size", "random", "expected"),
    [
        (4, 0, 1, 0, [4, 4, 2]),
        (1, 0, 1, 0, [1] * 10),
        (4, 5, 2, 0, [2, 2, 1, 4, 1]),  # a round ends where the first windows do
        (4, 4, 2, 0, [2, 2, 4, 2]),
        (2, 6, 3, 0, [3, 3, 2, 2]),  # they may be the larger ones
        (4, 5, 2, 3, [2, 1, 2, 4, 1]),  # and where random actions end
        (4, 5, 2, 7, [2, 2, 1, 2, 3]),
        (4, 0, 1, 6, [4, 2, 4]),
        (4, 4, 2, 4, [2, 2, 4, 2]),  # both at once
        (4, 20, 3, 0, [3, 3, 3, 1]),  # all of a short run are first ones
        (10, 10, 10, 10, [10]),
        (4, 1, 10, 0, [1, 4, 4, 1]),
    ],
)
def test_rounds_by_hand(
    make_trainer: Make, size: int, first: int, first_size: int, random: int, expected: list[int]
) -> None:
    trainer = make_trainer("random", (0, 1), "trainer.steps=70")
    trainer.windows_per_round, trainer.first_windows = size, first
    trainer.first_windows_per_round, trainer.random_windows = first_size, random
    spy = trainer.agent = Fixed()
    trainer.start((0, 1))
    run(trainer)
    assert spy.rounds == expected
    windows = trainer.store.windows
    # by chance once in 2187 windows
    by_state = windows.grid((windows.states + windows.times) % 3 == windows.actions).all(-1)
    assert by_state.tolist() == [[False] * random + [True] * (10 - random)] * 2


def test_random_windows_are_those_of_the_random_method(make_trainer: Make) -> None:
    # The environment and the actions have streams of their own: random's run is the same until the policy begins.
    random = make_trainer("random", (3, 4), "trainer.steps=140")
    late = make_trainer("disagreement", (3, 4), "trainer.steps=140", "trainer.random_windows=12")
    for trainer in (random, late):
        run(trainer)
    theirs, mine = random.store.windows, late.store.windows
    assert torch.equal(mine.actions[:, :84], theirs.actions[:, :84])
    assert torch.equal(mine.labels[:, :12], theirs.labels[:, :12])
    assert not torch.equal(mine.actions[:, 84:], theirs.actions[:, 84:])
    shares = make_trainer("disagreement", tuple(range(40)), "trainer.steps=70", "trainer.random_windows=10")
    run(shares)
    frequencies = shares.store.windows.actions.flatten().bincount(minlength=3) / 2800
    assert (frequencies - 1 / 3).abs().max() < 5 * (2 / 9 / 2800) ** 0.5


SEPSIS = ("experiment=sepsis", "trainer.steps=100", "trainer.windows_per_round=4", "trainer.log_every=4")


@pytest.mark.parametrize("feedback", ["block_sum", "terminal"])
def test_random_windows_count_as_the_uniform_policy(make_trainer: Make, feedback: str) -> None:
    trainer = make_trainer("disagreement", (0, 1), *SEPSIS, f"feedback={feedback}", "trainer.random_windows=8")
    mdp = trainer.env.mdp  # type: ignore[attr-defined]
    uniform = torch.full((1, 5, 1296, 8), 1 / 8, dtype=torch.float64)
    additive = feedback == "block_sum"
    value = float(mdp.evaluate(uniform, additive))
    gap = float(mdp.optimal(5, additive)[0][0] @ mdp.initial) - value
    executed = []
    improve = trainer.agent.improve

    def spy(*arguments: Any) -> None:
        policy = tabulate(trainer.agent.executed(), trainer.problem)
        assert policy is not None
        executed.append(mdp.evaluate(policy, additive))  # that of the round which ends here
        improve(*arguments)

    trainer.agent.improve = spy  # type: ignore[method-assign]
    journal = run(trainer)
    assert [step for step, _ in journal] == [20, 40, 60, 80, 100]
    regret = torch.zeros(2, dtype=torch.float64)
    for row, (_, values) in enumerate(journal):
        if row < 2:
            assert values["return/policy"].tolist() == pytest.approx([value] * 2)
            assert values["regret/share"].tolist() == pytest.approx([1, 1])
            regret = regret + 4 * gap
        else:
            torch.testing.assert_close(values["return/policy"], executed[row])
            regret = regret + 4 * (value + gap - executed[row])
        torch.testing.assert_close(values["regret/cumulative"], regret)
    assert (executed[2] - value).abs().min() > 1e-3  # the policy is worth something else


def test_what_random_windows_show_is_learned_from(make_trainer: Make) -> None:
    trainer = make_trainer("reference", (0,), "trainer.steps=70", "trainer.random_windows=10")
    run(trainer)
    belief = trainer.belief()
    assert belief is not None
    assert belief.visits is not None
    assert belief.visits.sum() == 70
    assert belief.mixed.abs().max() > 0.1


@pytest.mark.parametrize("key", ["windows_per_round", "first_windows_per_round", "random_windows"])
def test_more_windows_than_the_run_has_are_refused(make_trainer: Make, key: str) -> None:
    trainer = make_trainer("random", (0,), "trainer.steps=70")
    trainer.steps = 76
    setattr(trainer, key, 10)
    trainer.start((0,))
    run(trainer)
    assert len(trainer.store) == 10
    setattr(trainer, key, 11)
    with pytest.raises(
        UserError, match=rf"trainer\.{key}=11: more than the 10 windows.*steps=76.*window=7.*at most 10"
    ):
        trainer.start((0,))


def test_a_budget_of_episodes_is_that_many_windows(make_trainer: Make) -> None:
    journals = []
    for budget in (("trainer.steps=100",), ("trainer.episodes=20", "trainer.steps=null")):
        trainer = make_trainer("disagreement", (0, 1), "experiment=sepsis", "trainer.log_every=8", *budget)
        assert trainer.total == 100
        journals.append(run(trainer))
    assert [step for step, _ in journals[0]] == [step for step, _ in journals[1]]
    for one, other in zip(*journals, strict=True):
        assert all(torch.equal(values, other[1][name]) for name, values in one[1].items())


CARTPOLE = ("env=gymnasium", "env.id=CartPole-v1", "trainer.steps=null", "trainer.steps_per_round=25")


@pytest.mark.parametrize("copies", [1, 2])
def test_rounds_of_steps_take_whole_episodes(make_trainer: Make, copies: int) -> None:
    rounds = (f"env.copies={copies}", f"trainer.steps_per_round={25 * copies}", "trainer.log_every=1")
    trainer = make_trainer("random", (3,), *CARTPOLE, "trainer.episodes=6", *rounds)
    told, steps = list[int](), [0]
    trainer.run(lambda step, values: steps.append(step), told.append)
    windows = trainer.store.windows
    assert windows.terminated is not None
    assert int(windows.terminated.sum()) == 6  # a pole falls under random actions, sooner or later
    assert bool(windows.terminated[0, -1])
    assert steps[-1] == trainer.collected == len(windows)
    if copies == 1:  # of several, some wait for the last
        assert steps[1:-1] == list(range(25, steps[-1], 25))
    assert told[-1] == trainer.total == 6
    assert told == sorted(told)


def test_a_budget_is_given_once(make_trainer: Make) -> None:
    for experiment, words, said in (
        ("sepsis", ("trainer.episodes=6", "trainer.steps=60"), "trainer.steps=60 and trainer.episodes=6"),
        ("sepsis", ("trainer.steps=null",), "trainer.episodes=null: how long is the run"),
        ("advertiser", ("trainer.episodes=6", "trainer.steps=null"), "goes on for ever"),
    ):
        with pytest.raises(UserError, match=said):
            make_trainer("random", (0,), f"experiment={experiment}", *words)
    with pytest.raises(UserError, match="2 replicas side by side"):
        make_trainer("random", (0, 1), *CARTPOLE, "trainer.episodes=6")
    with pytest.raises(UserError, match="take multiples of 2"):
        make_trainer("random", (0,), *CARTPOLE, "env.copies=2", "trainer.episodes=6")
