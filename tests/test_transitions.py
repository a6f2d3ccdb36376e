"""P̂ from counts, by hand."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from credit.transitions import Counts, ShiftMixture
from credit.types import Problem, Windows


def model(problem: Problem, prior: str, pseudo: float, *steps: tuple[int, int, int]) -> torch.Tensor:
    """P̂ of one replica after some (s, a, s')."""
    counts = Counts(prior, pseudo)  # type: ignore[arg-type]
    counts.start(problem)
    for s, a, then in steps:
        shape = (problem.replicas, 1, 1)
        counts.observe(
            Windows(*(torch.full(shape, value) for value in (s, a, then)), torch.zeros(shape[:2], dtype=torch.float64))
        )
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
        shape = (1, 1, 1)
        mixture.observe(
            Windows(*(torch.full(shape, value) for value in (s, 0, then)), torch.zeros(1, 1, dtype=torch.float64))
        )
    found = mixture.probabilities()[0, :, 0]
    assert found[1].tolist() == pytest.approx([0.8 / 5, 1.6 / 5, (1 + 1.6) / 5, 0])
    assert found[0].tolist() == pytest.approx([(1 + 4 * 0.6) / 5, 4 * 0.4 / 5, 0, 0])
    assert found[3].tolist() == pytest.approx([0, 0, 0.2, 0.8])  # nothing seen: the structure, reflecting
