"""Where steps lie, where replicas have different numbers of them."""

from __future__ import annotations

import torch

from credit.core.problem import Problem
from credit.core.store import Store
from credit.core.windows import Episode, Windows
from credit.recovery.places import Rows


def episodes(*lengths: int) -> Windows:
    """One episode of each of two replicas."""
    each = [[Episode(*(torch.full((length, size), 0.1 * length) for size in (2, 1, 2)))] for length in lengths]
    return Windows.of_episodes(each, torch.ones(2, 1).double())


def test_newest_rows_are_found_where_replicas_have_different_numbers() -> None:
    # 5 and 2 rows, then 1 and 3: the second column of the first replica means nothing, and is no place of its own
    problem = Problem.vectors(2, 1, 5, (0, 1))
    places, store = Rows(problem), Store(problem)
    for lengths in ((5, 2), (1, 3)):
        store.append(episodes(*lengths))
        places.extend(store)
    assert places.counts == [6, 5]
    found = places.index(store.new)
    assert found.tolist() == [[5, 5, 5], [2, 3, 4]]
    assert places.index(store.windows).tolist() == [[0, 1, 2, 3, 4, 5]] * 2
