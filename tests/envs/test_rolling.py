"""Copies that step without a pause, against a walk along each copy in plain Python."""

from __future__ import annotations

from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor

from credit.core.checks import check_windows
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Environment, Feedback, Transitions
from credit.core.store import Store
from credit.core.streams import generators
from credit.core.windows import Windows
from credit.data.replay import Replay
from credit.envs.feedback import BlockSum, EpisodeSum, Mean, Terminal
from credit.envs.rolling import Rolling
from credit.rounds import problem_of

HORIZON = 9
Step = tuple[int, int, int]  # copy, episode, step


def length(copy: int, episode: int, seed: int) -> int:
    """Of an episode: 1 to HORIZON; where it is HORIZON, it was cut short, and else it is over."""
    return 1 + (3 * copy + 5 * episode + seed) % HORIZON


def reward(copy: int, episode: int, step: int, seed: int) -> float:
    return 100.0 * seed + 10 * copy + episode + 0.01 * step


class Walks(Environment):
    """A state says which copy, which episode and which step it is."""

    horizon = HORIZON
    keeps: ClassVar = ("_place",)

    def __init__(self, copies: int = 1) -> None:
        self.copies = copies

    def problem(self, window: int, seeds: tuple[int, ...], device: torch.device | str) -> Problem:
        found = Problem.vectors(3, 1, window, seeds, device)
        return Problem(*(found.observation_space, found.action_space), window, seeds, found.device, True, HORIZON)

    def start(self, problem: Problem, copies: int = 1, purpose: str = "environment") -> None:
        self._seeds = problem.seeds
        self._place = torch.zeros(problem.replicas, copies, 3, dtype=torch.int64)
        self._place[..., 0] = torch.arange(copies)
        self._place[..., 1] = -1

    def reset(self, mask: Tensor | None = None) -> Tensor:
        begins = torch.ones_like(self._place[..., 0], dtype=torch.bool) if mask is None else mask
        self._place = self._place.clone()
        self._place[..., 1] += begins
        self._place[..., 2] *= ~begins
        return self._place.float()

    def step(self, actions: Tensor, mask: Tensor | None = None) -> Transitions:
        before = self._place.tolist()
        self._place = self._place.clone()
        self._place[..., 2] += torch.ones_like(self._place[..., 2]) if mask is None else mask
        pairs = [[(place, seed) for place in own] for own, seed in zip(before, self._seeds, strict=True)]
        rewards = torch.tensor([[reward(*place, seed) for place, seed in own] for own in pairs], dtype=FLOAT)
        ends = torch.tensor([[place[2] + 1 == length(*place[:2], seed) for place, seed in own] for own in pairs])
        long = torch.tensor([[length(*place[:2], seed) == HORIZON for place, seed in own] for own in pairs])
        return Transitions(self._place.float(), rewards, ends & ~long, ends & long)


class Still:
    """A policy that does nothing."""

    def act(self, states: Tensor, step: Tensor) -> Tensor:
        assert torch.equal(states[..., 2].long(), step)
        return torch.zeros(*step.shape, 1)


def begun(feedback: Feedback, copies: int, seeds: tuple[int, ...]) -> tuple[Rolling, Problem]:
    env = Walks(copies)
    problem = problem_of(env, feedback, seeds, "cpu", rolling=True)
    env.start(problem)
    feedback.start(problem)
    return Rolling(env, feedback, problem), problem


def walked(seed: int, copy: int, steps: int, window: int) -> list[tuple[list[Step], bool, bool]]:
    """The windows that a copy closes in so many steps: its steps, whether an end cut it short, whether it is over."""
    found, own, episode, step = [], list[Step](), 0, 0
    for _ in range(steps):
        own.append((copy, episode, step))
        ends = step + 1 == length(copy, episode, seed)
        if ends or len(own) == window:
            short = len(own) < window
            found.append((own, short, ends))
            own = []
        episode, step = (episode + 1, 0) if ends else (episode, step + 1)
    return found


def windows_of(windows: Windows, replica: int) -> list[list[Step]]:
    """The steps of each window that there is."""
    states = [tuple(int(x) for x in row) for row in windows.states[replica].tolist()]
    ends, lengths = windows.ends[replica].tolist(), windows.lengths[replica].tolist()
    return [states[end - size + 1 : end + 1] for end, size in zip(ends, lengths, strict=True) if size]  # type: ignore


@pytest.mark.parametrize("copies", [1, 3])
@pytest.mark.parametrize("window", [1, 4, HORIZON])
@pytest.mark.parametrize("rounds", [(60,), (7, 1, 20, 2, 30)])
def test_windows_are_those_of_a_walk(copies: int, window: int, rounds: tuple[int, ...]) -> None:
    seeds = (2, 5)
    rolling, problem = begun(BlockSum(window, noise=0.0), copies, seeds)
    store, found = Store(problem), list[Windows]()
    for steps in rounds:
        if (new := rolling.collect(Still(), steps)) is not None:
            windows, primitive = new
            check_windows(windows, problem)
            store.append(windows)
            found.append(windows)
            assert torch.allclose(windows.sums(primitive), windows.labels, rtol=0, atol=1e-9)
    for replica, seed in enumerate(seeds):
        for copy in range(copies):
            expected = [own for own, _, _ in walked(seed, copy, sum(rounds), window)]
            assert [own for part in found for own in windows_of(part, replica) if own[0][0] == copy] == expected
        every = windows_of(store.windows, replica)
        labels = store.windows.labels[replica][store.windows.lengths[replica] > 0].tolist()
        assert labels == pytest.approx([sum(reward(*step, seed) for step in own) for own in every])
        known = store.windows.labelled
        assert known is None or int(known[replica].sum()) == len(every)


@pytest.mark.parametrize("copies", [1, 2])
def test_returns_run_over_windows_of_one_copy_alone(copies: int) -> None:
    rolling, problem = begun(BlockSum(4, noise=0.0), copies, (3,))
    store, replay = Store(problem), Replay(problem, n_step=3, discount=0.5)
    for steps in (30, 25):
        new = rolling.collect(Still(), steps)
        assert new is not None
        store.append(new[0])
    windows = store.windows
    rewards = torch.arange(1, len(windows) + 1, dtype=FLOAT).unsqueeze(0)
    replay.relabel(windows, rewards)
    places = windows.states[0].long().tolist()
    batch = replay.at(torch.arange(len(windows)).unsqueeze(0))
    for row, (copy, episode, step) in enumerate(places):
        total, k, end = 0.0, 0, row
        while k < 3:
            total += 0.5**k * float(rewards[0, row + k])
            end, k = row + k, k + 1
            last = places[end][2] + 1 == length(copy, episode, 3)
            follows = end + 1 < len(places) and places[end + 1] == [copy, episode, step + k]
            if last or not follows:
                break
        over = places[end][2] + 1 == length(copy, episode, 3) < HORIZON
        assert float(batch.returns[0, row]) == pytest.approx(total)
        assert float(batch.discount[0, row]) == pytest.approx(0 if over else 0.5**k)
        assert batch.ahead[0, row].tolist() == [copy, episode, step + k]
        assert batch.after is not None
        assert int(batch.after[0, row]) == step + k


def test_whole_episodes_are_never_cut_short() -> None:
    rolling, problem = begun(EpisodeSum(cut="drop"), 1, (4,))
    assert (problem.window, problem.horizon) == (HORIZON, HORIZON)
    new = rolling.collect(Still(), 50)
    assert new is not None
    assert new[0].labelled is None
    assert windows_of(new[0], 0) == [own for own, _, ends in walked(4, 0, 50, HORIZON) if ends]


def test_a_window_that_is_cut_short_can_go_without_a_label() -> None:
    seed = 4
    rolling, _ = begun(BlockSum(4, noise=0.0, cut="drop"), 1, (seed,))
    new = rolling.collect(Still(), 50)
    assert new is not None
    windows, expected = new[0], walked(seed, 0, 50, 4)
    assert windows.labelled is not None
    assert windows.labelled[0].tolist() == [not short for _, short, _ in expected]
    assert not windows.labels[0][~windows.labelled[0]].any()
    assert windows_of(windows, 0) == [own for own, _, _ in expected]  # its steps are there


@pytest.mark.parametrize(("delay", "windows"), [(5, 0), (0, 2), (6, 1)])
def test_late_labels_come_late_and_none_is_lost(delay: int, windows: int) -> None:
    feedback = BlockSum(4, noise=0.0, delay=delay, delay_windows=windows)
    rolling, _ = begun(feedback, 1, (4,))
    expected, found = walked(4, 0, 60, 4), list[list[Step]]()
    closed_at, taken = [], 0
    for own, _, _ in expected:
        taken += len(own)
        closed_at.append(taken)
    for now in range(1, 61):
        new = rolling.collect(Still(), 1)
        found += [] if new is None else windows_of(new[0], 0)
        come = [at + delay <= now and sum(at < other <= now for other in closed_at) >= windows for at in closed_at]
        assert len(found) == sum(come), now
    assert found == [own for own, _, _ in expected][: len(found)]


@pytest.mark.parametrize("copies", [1, 3])
@pytest.mark.parametrize("delay", [0, 3])
@pytest.mark.parametrize("window", [4, HORIZON])
def test_rows_say_whether_they_are_of_the_newest_round(copies: int, delay: int, window: int) -> None:
    rolling, _ = begun(BlockSum(window, noise=0.0, delay=delay), copies, (2, 5))
    before, old = 0, 0
    for steps in (20, 7, 30, 1, 12, 25):
        done = [
            [step for own, _, _ in walked(seed, copy, 99, 99) for step in own]
            for seed in (2, 5)
            for copy in range(copies)
        ]
        taken = {(2, 5)[place // copies]: set[Step]() for place in range(len(done))}
        for place, own in enumerate(done):
            taken[(2, 5)[place // copies]] |= set(own[before : before + steps])
        before += steps
        if (new := rolling.collect(Still(), steps)) is None:
            continue
        windows, _ = new
        for replica, seed in enumerate((2, 5)):
            rows = [tuple(int(x) for x in row) for row in windows.states[replica].tolist()]
            rows = rows[: len(rows) if windows.count is None else int(windows.count[replica])]
            expected = [row in taken[seed] for row in rows]
            fresh = [True] * len(rows) if windows.fresh is None else windows.fresh[replica, : len(rows)].tolist()
            assert fresh == expected
            old += len(rows) - sum(expected)
    assert old  # windows that were open across rounds


def test_lengths_are_drawn_between_their_limits() -> None:
    rolling, problem = begun(BlockSum([2, 4], noise=0.0), 2, (4, 9))
    assert problem.window == 4
    new = rolling.collect(Still(), 400)
    assert new is not None
    lengths = new[0].lengths
    assert int(lengths.max()) == 4
    counts = torch.bincount(lengths.flatten())[2:5]
    assert (counts > 0.2 * counts.sum()).all()
    alone, _ = begun(BlockSum([2, 4], noise=0.0), 2, (9,))
    other = alone.collect(Still(), 400)
    assert other is not None
    assert windows_of(other[0], 0) == windows_of(new[0], 1)  # of the seed, whoever is beside it


def test_missing_labels_and_noise_are_of_the_seed_alone() -> None:
    def labels(seeds: tuple[int, ...]) -> Windows:
        rolling, _ = begun(BlockSum(3, noise=0.5, missing=0.4), 1, seeds)
        new = rolling.collect(Still(), 900)
        assert new is not None
        return new[0]

    both, alone = labels((2, 7)), labels((7,))
    assert both.labelled is not None
    assert alone.labelled is not None
    count = alone.labels.shape[1]
    assert torch.equal(both.labelled[1, :count], alone.labelled[0])
    assert torch.equal(both.labels[1, :count], alone.labels[0])
    assert 0.5 < float(alone.labelled.double().mean()) < 0.7
    real = int((both.lengths[1] > 0).sum())
    drawn = generators((7,), "feedback, missing")[0].random((real, 1))[:, 0] >= 0.4
    assert both.labelled[1, :real].tolist() == drawn.tolist()


def test_a_mean_and_a_last_reward_know_how_long_a_window_was() -> None:
    for feedback, expected in (
        (Mean(4), lambda rewards: sum(rewards) / len(rewards)),
        (Terminal(4), lambda rewards: rewards[-1]),
    ):
        rolling, _ = begun(feedback, 1, (4,))
        new = rolling.collect(Still(), 50)
        assert new is not None
        own = windows_of(new[0], 0)
        found = new[0].labels[0][: len(own)].tolist()
        assert found == pytest.approx([expected([reward(*step, 4) for step in steps]) for steps in own])


def test_it_goes_on_where_it_was_with_labels_under_way() -> None:
    feedbacks = [BlockSum([2, 4], noise=0.3, missing=0.2, delay=7) for _ in range(2)]
    first, second = (begun(feedback, 2, (4, 9))[0] for feedback in feedbacks)
    first.collect(Still(), 23)
    second.load_state_dict(first.state_dict())
    feedbacks[1].load_state_dict(feedbacks[0].state_dict())
    for steps in (1, 30):
        one, two = first.collect(Still(), steps), second.collect(Still(), steps)
        assert (one is None) == (two is None)
        if one is None or two is None:
            continue
        pairs: dict[str, Any] = vars(one[0])
        for name, value in pairs.items():
            other = getattr(two[0], name)
            assert torch.equal(value, other) if isinstance(value, Tensor) else value == other, name
        assert torch.equal(one[1], two[1])


@pytest.mark.parametrize(("copies", "window", "delay"), [(1, 4, 0), (3, 4, 0), (3, HORIZON, 0), (3, 2, 5)])
def test_episodes_are_taken_whole_and_no_more(copies: int, window: int, delay: int) -> None:
    rolling, problem = begun(BlockSum(window, noise=0.0, delay=delay), copies, (2,))
    store, taken, rounds = Store(problem), 0, 0
    while rolling.episodes < 4 * copies:
        new = rolling.collect(Still(), 6, 4)
        taken, rounds = taken + rolling.taken, rounds + 1
        if new is not None:
            store.append(new[0])
    lengths = [[length(copy, episode, 2) for episode in range(4)] for copy in range(copies)]
    assert taken == sum(map(sum, lengths))
    assert rounds == -(-max(map(sum, lengths)) // 6)
    found = windows_of(store.windows, 0)
    for copy, own in enumerate(lengths):
        steps = max(map(sum, lengths)) if delay else sum(own)  # labels come as long as another copy goes on
        expected = [steps for steps, _, _ in walked(2, copy, sum(own), window)]
        mine = [steps for steps in found if steps[0][0] == copy]
        assert mine == expected[: len(mine)]
        late = sum(len(rest) for rest in expected[len(mine) :])
        assert late <= max(0, delay - (steps - sum(own))) + window * bool(delay)


def test_a_budget_of_episodes_goes_on_where_it_was() -> None:
    first, second = (begun(BlockSum(4, noise=0.0), 2, (4,))[0] for _ in range(2))
    first.collect(Still(), 11, 3)
    second.load_state_dict(first.state_dict())
    assert second.episodes == first.episodes
    while first.episodes < 6:
        one, two = first.collect(Still(), 3, 3), second.collect(Still(), 3, 3)
        assert (one is None) == (two is None)
        assert first.taken == second.taken
        if one is not None and two is not None:
            assert torch.equal(one[0].states, two[0].states)
