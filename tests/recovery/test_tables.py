"""Cells that are alike: what stands for what, by hand, and the same recovery with and without."""

from __future__ import annotations

from collections.abc import Callable

import torch

from credit.recovery.recovery import Recovery
from credit.recovery.tables import Alike, spread_out
from credit.trainer import Trainer


def test_visited_cells_stand_for_themselves_and_others_for_their_kind() -> None:
    # two models: kinds (0, 0), (0, 1), (0, 1), (0, 0), (1, 1)
    alike = Alike([torch.tensor([0, 0, 0, 0, 1]), torch.tensor([0, 1, 1, 0, 1])])
    visits = torch.tensor([[0, 0, 0, 0, 0], [2, 0, 1, 0, 3]])
    cells, column = alike.choose(visits)
    assert cells.tolist() == [[0, 1, 4, 0, 0], [0, 1, 2, 3, 4]]  # the first replica is filled up with cell 0
    assert cells.gather(1, column).tolist() == [[0, 1, 1, 0, 4], [0, 1, 2, 3, 4]]
    assert not alike.saves  # five cells are not worth it


def test_values_are_spread_over_all_cells() -> None:
    column = torch.tensor([[0, 1, 1], [1, 0, 0]])
    values = torch.tensor([[[5, 6], [7, 8]], [[1, 2], [3, 4]]])
    assert spread_out(values, column).tolist() == [[[5, 6, 6], [7, 8, 8]], [[2, 1, 1], [4, 3, 3]]]
    assert spread_out(values[:, 0], column).tolist() == [[5, 6, 6], [2, 1, 1]]


def test_the_recovery_is_that_of_all_cells(make_trainer: Callable[..., Trainer]) -> None:
    for method in ("disagreement", "credit_hypotheses"):
        found = []
        for saves in (True, False):
            trainer = make_trainer(method, (0, 1), "experiment=sepsis", "trainer.steps=400", "trainer.log_every=80")
            assert isinstance(trainer.assigner, Recovery)
            assert trainer.assigner._alike is not None
            assert trainer.assigner._alike.saves
            trainer.assigner._alike.saves = saves
            trainer.run(lambda step, values: None)
            found.append(trainer.assigner.belief())
        some, every = found
        assert some is not None
        assert every is not None
        assert some.draws[0].shape[-1] < every.draws[0].shape[-1] / 5
        for name in ("mean", "mse", "disagreement", "weights", "mixed", "plan", "best"):
            torch.testing.assert_close(getattr(some, name), getattr(every, name), atol=1e-9, rtol=0)
        assert some.column is not None
        for few, all_of_them in zip(some.draws, every.draws, strict=True):
            torch.testing.assert_close(spread_out(few, some.column), all_of_them, atol=1e-9, rtol=0)
