"""Replay: rewards that change, returns against a walk along each episode, preferred rows, nothing held twice."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import CreditAssigner
from credit.core.store import Store
from credit.core.streams import generators
from credit.core.windows import Windows
from credit.data.preferred import preferred
from credit.data.replay import Replay

Make = Callable[..., Problem]
MakeRagged = Callable[..., Windows]
LENGTHS = [[7, 3, 1, 5], [2, 4, 4, 1]]
LABELS = [[1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0]]


class Told(CreditAssigner):
    """Rewards that depend on the step, and, where it learns, on how often it was asked."""

    def __init__(self, learns: bool) -> None:
        self._learns, self.asked = learns, list[int]()

    def start(self, problem: Problem) -> None: ...

    def observe(self, store: Store) -> None: ...

    @property
    def learns(self) -> bool:
        return self._learns

    def rewards(self, windows: Windows) -> Tensor:
        self.asked.append(len(windows))
        return first(windows) * (len(self.asked) if self._learns else 1)


def first(windows: Windows) -> Tensor:
    """The states, or their first numbers [R, n]."""
    return (windows.states if windows.states.dim() == 2 else windows.states[..., 0]).double()


def filled(problem: Problem, *pieces: Windows) -> Store:
    store = Store(problem)
    for piece in pieces:
        store.append(piece)
    return store


def noise(windows: Windows, seed: int = 0) -> Tensor:
    """A reward for every row."""
    return torch.randn(windows.states.shape[:2], dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def rows_of(windows: Windows, replica: int) -> range:
    return range(len(windows) if windows.count is None else int(windows.count[replica]))


def walked(
    windows: Windows, rewards: Tensor, replica: int, row: int, n: int, discount: float, episodic: bool
) -> tuple[float, float, int, float]:
    """Return of n steps, discount behind it, its last row, and the return to the end, one step at a time."""
    count = len(rows_of(windows, replica))
    terminated, last, total = False, row, 0.0
    whole, stopped = 0.0, False
    for k in range(count - row):
        at = row + k
        whole += discount**k * float(rewards[replica, at])
        if k < n:
            total, last = total + discount**k * float(rewards[replica, at]), at
        if windows.ended is None:
            stopped = episodic and (at + 1) % int(windows.length or 1) == 0
            terminated = terminated or (stopped and at == last)
        else:
            stopped = bool(windows.ended[replica, at])
            terminated = terminated or (at == last and bool(windows.terminated[replica, at]))  # type: ignore[index]
        if stopped:
            break
    return total, 0.0 if terminated else discount ** (last - row + 1), last, whole


def grid(problem: Problem, windows: int, seed: int = 0) -> Windows:
    generator = torch.Generator().manual_seed(seed)
    shape = (problem.replicas, windows, problem.window)
    states, actions, following = (torch.randint(9, shape, generator=generator) for _ in range(3))
    return Windows.of_grid(states, actions, following, torch.zeros(shape[:2], dtype=torch.float64))


@pytest.mark.parametrize("n", [1, 3, 50])
@pytest.mark.parametrize("kind", ["episodes", "grid of episodes", "without end", "open episode"])
def test_returns_against_a_walk(make_trajectories: MakeRagged, n: int, kind: str) -> None:
    finite = Problem.finite(9, 9, 4, (0, 1), episodic=kind == "grid of episodes")
    if kind in ("grid of episodes", "without end"):
        problem, windows = finite, grid(finite, 3)
    else:
        problem, windows = Problem.vectors(4, 2, 9, (0, 1)), make_trajectories(LENGTHS, LABELS)
        if kind == "open episode":  # the last window of each replica belongs to an episode that is not over
            assert windows.ended is not None
            ended = windows.ended.scatter(1, windows.ends[:, -1:], False)
            ended = ended.scatter(1, windows.ends[:, 1:2], False)  # and the second window is no episode's end
            windows = replace(windows, ended=ended)
    rewards = noise(windows)
    replay = Replay(problem, n, 0.9, outcome=True, kind=torch.float64)
    replay.relabel(windows, rewards)
    for replica in range(2):
        for row in rows_of(windows, replica):
            batch = replay.at(torch.tensor([row]), replica)
            total, behind, last, whole = walked(windows, rewards, replica, row, n, 0.9, problem.episodic)
            assert batch.returns.item() == pytest.approx(total)
            assert batch.discount.item() == pytest.approx(behind)
            assert batch.outcome is not None
            assert batch.outcome.item() == pytest.approx(whole)
            assert torch.equal(batch.ahead[0], windows.next_states[replica, last])
            assert torch.equal(batch.observation[0], windows.states[replica, row])
            assert batch.step is not None
            assert batch.step.item() == windows.times[replica, row]


@pytest.mark.parametrize("learns", [False, True])
@pytest.mark.parametrize("kind", ["episodes", "grid of episodes", "without end"])
@pytest.mark.parametrize("outcome", [False, True])
def test_round_by_round_equals_all_at_once(
    make_trajectories: MakeRagged, learns: bool, kind: str, outcome: bool
) -> None:
    """Only rewards that changed are asked for; and a row that a new one reaches back to is summed again."""
    problem = Problem.finite(9, 9, 4, (0, 1), episodic=kind == "grid of episodes")
    pieces = [grid(problem, count, count) for count in (1, 2, 1, 4)]
    if kind == "episodes":
        problem = Problem.vectors(4, 2, 9, (0, 1))
        pieces = [make_trajectories([[3], [9]], [[1], [0]], first=k) for k in range(3)]
        pieces.append(make_trajectories([[9, 1], [1, 2]], [[0, 0], [0, 1]], first=7))
    keys: dict[str, Any] = {"n_step": 6, "discount": 0.9, "outcome": outcome}
    replay, told, store = Replay(problem, **keys), Told(learns), Store(problem)
    for number, piece in enumerate(pieces):
        store.append(piece)
        replay.update(store, told, cost=0.5)
        whole = Replay(problem, **keys)
        factor = len(told.asked) if learns else 1
        whole.relabel(store.windows, factor * first(store.windows) - 0.5)
        for replica in range(2):
            rows = torch.tensor(rows_of(store.windows, replica))
            for ours, theirs in zip(replay.at(rows, replica), whole.at(rows, replica), strict=True):
                assert ours is theirs is None or torch.equal(ours, theirs)
        assert told.asked[-1] == (len(store.windows) if learns or not number else len(piece))


def test_rewards_of_a_part_full_replay_are_replaced_everywhere(make_trajectories: MakeRagged) -> None:
    problem = Problem.vectors(4, 2, 9, (0, 1))
    store = filled(problem, make_trajectories(LENGTHS, LABELS))
    replay = Replay(problem)
    for number in (1, 2):
        rewards = number * noise(store.windows)
        replay.relabel(store.windows, rewards)
        for replica in range(2):
            count = len(rows_of(store.windows, replica))
            assert torch.equal(replay.rewards[replica, :count], rewards[replica, :count].float())
            assert not replay.rewards[replica, count:].any()
            sampled = replay.at(torch.arange(count), replica).returns
            assert torch.equal(sampled, rewards[replica, :count].float())
    store.append(make_trajectories([[2], [3]], [[1.0], [0.0]], first=9))
    with pytest.raises(UserError, match="new rewards are nan; give finite numbers"):
        replay.extend(store.windows, torch.full((2, 3), torch.nan))
    replay.extend(store.windows, torch.full((2, 3), 7.0))
    assert replay.rewards[0, 16:].tolist() == [7.0, 7.0]
    assert replay.rewards[1, 11:14].tolist() == [7.0, 7.0, 7.0]
    assert torch.equal(replay.rewards[0, :16], (2 * noise(make_trajectories(LENGTHS, LABELS)))[0, :16].float())


def test_no_column_of_the_store_is_held_twice(make_trajectories: MakeRagged) -> None:
    problem = Problem.vectors(4, 2, 9, (0, 1))
    store = filled(problem, make_trajectories(LENGTHS, LABELS))
    replay = Replay(problem, 3, prefer="success", share=0.5)
    replay.relabel(store.windows, noise(store.windows))
    for name in ("states", "actions", "next_states", "step", "ended", "terminated"):
        assert getattr(replay.windows, name).data_ptr() == getattr(store.windows, name).data_ptr(), name
    own = [value for value in vars(replay).values() if isinstance(value, Tensor)] + list(replay._columns.values())
    assert sum(part.nbytes for part in replay._columns.values()) == 2 * len(store.windows) * 16
    assert all(part.dim() == 2 for part in own)  # a number a row at most: no states, no actions


@pytest.mark.parametrize("capacity", [1, 2, 3, 9])
def test_only_the_newest_windows_are_remembered(make_trajectories: MakeRagged, capacity: int) -> None:
    problem = Problem.vectors(4, 2, 9, (0, 1))
    store = filled(problem, make_trajectories(LENGTHS, LABELS))
    replay = Replay(problem, capacity=capacity, prefer="success", share=0.5)
    replay.relabel(store.windows, noise(store.windows))
    batch = replay.sample(600)[0]
    for replica in range(2):
        first = sum(LENGTHS[replica][: max(4 - capacity, 0)])
        kept = store.windows.states[replica, first : sum(LENGTHS[replica])]
        assert replay.span(replica) == (first, len(kept))
        assert {tuple(row) for row in batch.observation[replica].tolist()} == {tuple(row) for row in kept.tolist()}


def test_a_share_comes_from_preferred_windows(make_trajectories: MakeRagged) -> None:
    """Also where one replica has some and the other has none."""
    problem = Problem.vectors(4, 2, 9, (0, 1))
    windows = make_trajectories(LENGTHS, LABELS)
    replay = Replay(problem, prefer="success", share=0.75)
    replay.relabel(windows, noise(windows))
    batch = replay.sample(4000)[0]
    won = torch.cat([windows.states[0, :7], windows.states[0, 10:11]])
    hits = (batch.observation.unsqueeze(2) == won).all(-1).any(-1).float()
    assert hits[0, :3000].all()
    assert hits[0, 3000:].mean() == pytest.approx(8 / 16, abs=0.05)
    assert hits[1].sum() == 0
    counts = (batch.observation[1].unsqueeze(1) == windows.states[1, :11]).all(-1).sum(0)
    assert counts.sum() == 4000
    assert counts.min() > 250


def test_which_windows_are_preferred() -> None:
    bits = torch.tensor([[1.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    assert preferred(bits, "success").tolist() == [[True, False, True], [False] * 3]
    real = torch.arange(20.0).flip(0).repeat(2, 1)
    real[1] *= -1
    best = preferred(real, "top")
    assert best[0].nonzero().flatten().tolist() == [0, 1]
    assert best[1].nonzero().flatten().tolist() == [18, 19]
    with pytest.raises(UserError, match=r"agent\.prefer=success.*0\.37.*agent\.prefer=top"):
        preferred(torch.tensor([[1.0, 0.37]]), "success")


def test_a_label_that_is_no_bit_is_never_taken_for_success(make_trajectories: MakeRagged) -> None:
    problem = Problem.vectors(4, 2, 9, (0,))
    windows = make_trajectories([[2, 2]], [[0.3, 2.5]])
    Replay(problem, prefer="top", share=0.5).relabel(windows, noise(windows))
    Replay(problem, prefer="success", share=0.0).relabel(windows, noise(windows))  # nothing is preferred
    with pytest.raises(UserError, match="success"):
        Replay(problem, prefer="success", share=0.5).relabel(windows, noise(windows))


def test_each_replica_draws_its_own_rows_from_its_own_stream(make_problem: Make) -> None:
    problem = make_problem((4, 9), window=3)
    windows = grid(problem, 4)
    replay = Replay(problem)
    replay.relabel(windows, noise(windows), checked=True)  # their actions are numbers of rows
    batches = replay.sample(5, 2) + replay.sample(5, 1)
    assert len(batches) == 3
    for replica, stream in enumerate(generators(problem.seeds, "replay")):
        for batch in batches:
            rows = (stream.random(5) * 12).astype(int)  # four windows of three steps
            assert batch.observation.shape == (2, 5)
            assert torch.equal(batch.observation[replica], windows.states[replica, rows])
            assert torch.equal(batch.returns[replica], noise(windows)[replica, rows].float())


def test_a_state_draws_on_and_asks_for_all_rewards_anew(make_trajectories: MakeRagged) -> None:
    problem, pieces = (
        Problem.vectors(4, 2, 9, (0, 1)),
        [make_trajectories(LENGTHS, LABELS, first=10 * k) for k in range(2)],
    )
    store, told, replay = filled(problem, pieces[0]), Told(False), Replay(problem, 2)
    replay.update(store, told)
    replay.sample(4, 3)
    held, rows = replay.state_dict(), store.state_dict()
    assert "states" not in str(held.keys())
    resumed, again, other = Replay(problem, 2), Store(problem), Told(False)
    resumed.load_state_dict(held)
    again.load_state_dict(rows)
    for each, memory, asked in ((store, replay, told), (again, resumed, other)):
        each.append(pieces[1])
        memory.update(each, asked)
    assert other.asked == [len(again.windows)]
    again.append(pieces[0])
    resumed.load_state_dict(replay.state_dict())  # what was known before is not trusted
    resumed.update(again, other)
    assert other.asked[-1] == len(again.windows)
    store.append(pieces[0])
    replay.update(store, told)
    assert told.asked[-1] == len(pieces[0])
    for ours, theirs in zip(replay.sample(9, 2), resumed.sample(9, 2), strict=True):
        assert all(a is b is None or torch.equal(a, b) for a, b in zip(ours, theirs, strict=True))


def test_bounds_of_a_return_contain_zero_and_grow(make_trajectories: MakeRagged) -> None:
    problem = Problem.vectors(4, 2, 9, (0, 1))
    store = filled(problem, make_trajectories([[2], [2]], [[0.0], [0.0]]))
    replay = Replay(problem, discount=0.5)
    replay.relabel(store.windows, torch.tensor([[-3.0, -1.0], [-2.0, 4.0]]))
    batch = replay.sample(1)[0]
    assert (batch.low.tolist(), batch.high.tolist()) == ([[-6.0], [-4.0]], [[0.0], [8.0]])
    store.append(make_trajectories([[2], [2]], [[0.0], [0.0]]))
    replay.extend(store.windows, torch.tensor([[5.0, 0.0], [0.0, 0.0]]))
    batch = replay.sample(1)[0]
    assert (batch.low.tolist(), batch.high.tolist()) == ([[-6.0], [-4.0]], [[10.0], [8.0]])


@pytest.mark.parametrize("counts", [[[2], [0]]])
def test_what_cannot_be_drawn(counts: Sequence[Sequence[int]], make_trajectories: MakeRagged) -> None:
    problem = Problem.vectors(4, 2, 9, (0, 1))
    windows = make_trajectories([[2], [1]], [[0.0], [0.0]])
    replay = Replay(problem)
    with pytest.raises(UserError, match="no rows yet"):
        replay.at(torch.zeros(2, 1, dtype=torch.int64))
    with pytest.raises(ValueError, match=r"\(2, 3\) for rows \(2, 2\)"):
        replay.relabel(windows, torch.zeros(2, 3))
    empty = replace(windows, count=torch.tensor(counts).flatten())
    with pytest.raises(RuntimeError, match=r"replicas \[1\] have no rows"):
        replay.relabel(empty, torch.zeros(2, 2), checked=True)
