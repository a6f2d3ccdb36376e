"""P̂ from counts, by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import torch

from credit.core.problem import Problem
from credit.core.seams import Transition
from credit.core.windows import Windows
from credit.envs.advertiser.shift import ShiftMixture
from credit.envs.sepsis.factored import FactoredMixture
from credit.planning.counts import Counts, ObservedCounts


def model(problem: Problem, prior: str, pseudo: float, *steps: tuple[int, int, int]) -> torch.Tensor:
    """P̂ of one replica after some (s, a, s')."""
    counts = Counts(prior, pseudo)  # type: ignore[arg-type]
    counts.start(problem)
    for s, a, then in steps:
        shape = (problem.replicas, 1, 1)
        counts.observe(Windows.of_grid(*(torch.full(shape, value) for value in (s, a, then)), torch.zeros(shape[:2])))
    return counts.probabilities()


def test_neighbour_prior_by_hand(make_problem: Callable[..., Problem]) -> None:
    problem = make_problem((0,), states=4, actions=2)
    found = model(problem, "neighbour", 3.0, (1, 0, 2), (1, 0, 2), (1, 0, 1))[0]
    assert found[0, 0].tolist() == pytest.approx([2 / 3, 1 / 3, 0, 0])  # reflecting
    assert found[3, 1].tolist() == pytest.approx([0, 0, 1 / 3, 2 / 3])
    assert found[1, 0].tolist() == pytest.approx([1 / 6, 2 / 6, 3 / 6, 0])  # (0, 1, 2) + (1, 1, 1) over 6
    assert found[1, 1].tolist() == pytest.approx([1 / 3, 1 / 3, 1 / 3, 0])


def test_other_priors_by_hand(make_problem: Callable[..., Problem]) -> None:
    problem = make_problem((0,), states=4, actions=2)
    step = (1, 0, 2)
    self_loop = model(problem, "self_loop", 1.0, step)[0]
    assert self_loop[1, 0].tolist() == [0, 0.5, 0.5, 0]
    assert self_loop[2, 1].tolist() == [0, 0, 1, 0]
    uniform = model(problem, "uniform", 2.0, step)[0]
    assert uniform[1, 0].tolist() == pytest.approx([0.5 / 3, 0.5 / 3, 1.5 / 3, 0.5 / 3])
    assert uniform[2, 1].tolist() == [0.25] * 4
    zero = model(problem, "zero", 1.0, step)[0]
    assert zero[1, 0].tolist() == [0, 0, 1, 0]
    assert zero[2, 1].tolist() == [0, 0, 0, 0]
    assert model(problem, "neighbour", 0.0)[0].abs().sum() == 0


@pytest.mark.parametrize("prior", ["neighbour", "self_loop", "uniform"])
def test_rows_are_distributions(
    make_problem: Callable[..., Problem], make_windows: Callable[..., Windows], prior: str
) -> None:
    problem = make_problem((0, 1))
    counts = Counts(prior, 0.5)  # type: ignore[arg-type]
    counts.start(problem)
    counts.observe(make_windows(problem, 9))
    torch.testing.assert_close(counts.probabilities().sum(-1), torch.ones(2, 10, 3, dtype=torch.float64))


def test_replicas_and_windows_are_counted_apart_and_together(
    make_problem: Callable[..., Problem], make_windows: Callable[..., Windows]
) -> None:
    problem = make_problem((0, 1))
    windows = make_windows(problem, 40)
    counts = Counts("zero", 0.0)
    counts.start(problem)
    counts.observe(windows)
    for replica in range(2):
        expected = torch.zeros(10, 3, 10, dtype=torch.float64)
        steps = (windows.states, windows.actions, windows.next_states)
        for s, a, then in zip(*(part[replica].flatten().tolist() for part in steps), strict=True):
            expected[s, a, then] += 1
        torch.testing.assert_close(
            counts.probabilities()[replica], expected / expected.sum(-1, keepdim=True).clamp(min=1)
        )


def test_shift_mixture_by_hand(make_problem: Callable[..., Problem]) -> None:
    # One action, four states. Seen: 1→2, 2→2, 0→0 (an end, which tells nothing of the shift).
    # Shifts with 3 pseudo-counts: (−1: 1, 0: 2, +1: 2)/5. Structure at 1: (.2, .4, .4, 0), at 0: (.6, .4, 0, 0).
    problem = make_problem((0,), states=4, actions=1)
    mixture = ShiftMixture(pseudo_counts=4.0, shift_counts=3.0)
    mixture.start(problem)
    for s, then in ((1, 2), (2, 2), (0, 0)):
        mixture.observe(Windows.of_grid(*(torch.full((1, 1, 1), value) for value in (s, 0, then)), torch.zeros(1, 1)))
    found = mixture.probabilities()[0, :, 0]
    assert found[1].tolist() == pytest.approx([0.8 / 5, 1.6 / 5, (1 + 1.6) / 5, 0])
    assert found[0].tolist() == pytest.approx([(1 + 4 * 0.6) / 5, 4 * 0.4 / 5, 0, 0])
    assert found[3].tolist() == pytest.approx([0, 0, 0.2, 0.8])  # nothing seen: the structure, reflecting


def part(windows: Windows, replicas: slice, rows: slice) -> Windows:
    pieces = (*map(windows.grid, (windows.states, windows.actions, windows.next_states)), windows.labels)
    return Windows.of_grid(*(piece[replicas, rows] for piece in pieces))


def test_observed_counts_against_a_table_of_counts(
    make_problem: Callable[..., Problem], make_windows: Callable[..., Windows]
) -> None:
    problem = make_problem((0, 1, 2))
    windows = make_windows(problem, 12)
    values = torch.randn(3, 10, dtype=torch.float64, generator=torch.Generator().manual_seed(5))
    model = ObservedCounts()
    model.start(problem)
    assert (model.backup(values) == 0).all()  # no transition was seen
    counts = np.zeros((3, 10, 3, 10))
    for rows in (slice(1), slice(1, 5), slice(5, 12)):
        piece = part(windows, slice(None), rows)
        model.observe(piece)
        steps = (piece.states, piece.actions, piece.next_states)
        for replica in range(3):
            np.add.at(counts[replica], tuple(step[replica].numpy().ravel() for step in steps), 1)
        visits = counts.sum(-1)
        expected = np.einsum("rsat,rt->rsa", counts, values.numpy()) / np.maximum(visits, 1)
        np.testing.assert_allclose(model.backup(values), expected, atol=1e-12)
        assert (model.backup(values).numpy()[visits == 0] == 0).all()
        assert (visits == 0).any()
    table = Counts("zero", 0.0)
    table.start(problem)
    table.observe(windows)
    torch.testing.assert_close(table.backup(values), model.backup(values))


def test_observed_counts_of_a_replica_are_the_same_alone(
    make_problem: Callable[..., Problem], make_windows: Callable[..., Windows]
) -> None:
    windows = make_windows(make_problem((0, 1, 2)), 200)
    values = torch.randn(3, 10, dtype=torch.float64, generator=torch.Generator().manual_seed(5))
    batch, alone = ObservedCounts(), ObservedCounts()
    batch.start(make_problem((0, 1, 2)))
    alone.start(make_problem((1,)))
    for rows in (slice(3), slice(3, 200)):
        batch.observe(part(windows, slice(None), rows))
        alone.observe(part(windows, slice(1, 2), rows))
        torch.testing.assert_close(alone.backup(values[1:2])[0], batch.backup(values)[1], rtol=1e-12, atol=0)


def test_factored_mixture_against_plain_sums(make_problem: Callable[..., Problem]) -> None:
    # State = diabetes·648 + four vitals in base 3, times 8, + treatments; each vital moves by its own table of counts.
    problem = make_problem((0, 1), states=1296, actions=8, window=5)
    generator = torch.Generator().manual_seed(2)
    states, then = (torch.randint(648, (2, 400, 5), generator=generator) for _ in range(2))
    actions, sick = (torch.randint(size, (2, 400, 5), generator=generator) for size in (8, 2))
    states, then = states + 648 * sick, then // 8 * 8 + actions + 648 * sick
    windows = Windows.of_grid(states, actions, then, torch.zeros(2, 400, dtype=torch.float64))
    values = torch.randn(2, 1296, dtype=torch.float64, generator=generator)
    model, own = FactoredMixture(pseudo_counts=3.0, level_counts=0.6, inertia=0.5), ObservedCounts()
    for each in (model, own):
        each.start(problem)
        for rows in (slice(150), slice(150, 400)):
            each.observe(part(windows, slice(None), rows))
    found, observed = model.backup(values), own.backup(values)
    places = (216, 72, 24, 8)
    for replica in range(2):
        moves = np.full((4, 2, 8, 8, 3, 3), 0.1) + 0.3 * np.eye(3)  # .6 · (half on the own level, half on all three)
        visits = np.zeros((1296, 8))
        steps = (windows.states, windows.actions, windows.next_states)
        for s, a, n in zip(*(step[replica].flatten().tolist() for step in steps), strict=True):
            visits[s, a] += 1
            for vital, place in enumerate(places):
                moves[vital, s // 648, s % 8, a, s // place % 3, n // place % 3] += 1
        moves /= moves.sum(-1, keepdims=True)
        seen = zip(states[replica, :20, 0].tolist(), actions[replica, :20, 0].tolist(), strict=True)
        for s, a in [(0, 0), (1295, 7), *seen]:
            chances = [moves[vital, s // 648, s % 8, a, s // place % 3] for vital, place in enumerate(places)]
            structured = 0.0
            for levels in product(range(3), repeat=4):
                chance = np.prod([row[level] for row, level in zip(chances, levels, strict=True)])
                arrival = s // 648 * 648 + sum(p * v for p, v in zip(places, levels, strict=True)) + a
                structured += chance * float(values[replica, arrival])
            count = visits[s, a]
            expected = (count * float(observed[replica, s, a]) + 3 * structured) / (count + 3)
            assert float(found[replica, s, a]) == pytest.approx(expected, abs=1e-12)


def padded(long: Windows, short: int) -> Windows:
    """Windows of two replicas, of which the second has only so many rows; what is behind them is no step."""
    rows, count = len(long), torch.tensor([len(long), short])
    last = torch.tensor([[2, rows - 1], [1, short - 1]])
    return replace(long, labels=torch.zeros(2, 2), length=None, last=last, count=count)


@pytest.mark.parametrize(
    ("kind", "states", "actions"),
    [(Counts, 10, 3), (ObservedCounts, 10, 3), (ShiftMixture, 10, 3), (FactoredMixture, 1296, 8)],
)
def test_rows_that_mean_nothing_are_not_counted(
    make_problem: Callable[..., Problem], kind: type, states: int, actions: int
) -> None:
    generator = torch.Generator().manual_seed(0)
    rows = [torch.randint(size, (2, 9), generator=generator) for size in (states, actions, states)]
    windows = padded(Windows(*rows, labels=torch.zeros(2, 2)), 4)
    apart = [
        Windows(*(x[:1] for x in rows), labels=torch.zeros(1, 2), last=torch.tensor([[2, 8]])),
        Windows(*(x[1:, :4] for x in rows), labels=torch.zeros(1, 2), last=torch.tensor([[1, 3]])),
    ]
    values = torch.rand(1, states, dtype=torch.float64, generator=generator)
    both = values.expand(2, -1)

    def made(*seeds: int) -> Transition:
        model: Transition = kind()
        model.start(make_problem(seeds, states=states, actions=actions))
        return model

    beside, singles = made(0, 1), [made(0), made(1)]
    for _ in range(2):  # what padding left behind is overwritten by what is new
        beside.observe(windows)
        for single, own in zip(singles, apart, strict=True):
            single.observe(own)
        expected = torch.cat([single.backup(values) for single in singles])
        torch.testing.assert_close(beside.backup(both), expected)
    again = made(0, 1)
    again.load_state_dict(beside.state_dict())
    again.observe(windows)
    beside.observe(windows)
    assert torch.equal(again.backup(both), beside.backup(both))
