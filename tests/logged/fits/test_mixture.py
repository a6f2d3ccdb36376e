"""The mixture of rows against the paper's equations, written out row by row and draw by draw."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from credit.core.belief import Estimate
from credit.logged.fits.mixture import mixed, of_tensors
from credit.recovery.mixers import ReferenceOnly, RelativeMSE
from credit.recovery.proxies import gap, mse_proxies


def made(models: int = 3, rows: int = 17, draws: int = 9) -> tuple[list[np.ndarray], list[np.ndarray]]:
    random = np.random.default_rng(0)
    sizes = [4, 2, 3, 5][:models]
    return (
        [random.normal(size=(rows, size)) for size in sizes],
        [random.normal(size=(1 + draws, size)) for size in sizes],
    )


def test_the_point_is_the_papers_mixture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("credit.logged.fits.mixture.CACHED", 100)  # three rows at a time
    designs, thetas = made()
    found = mixed(designs, thetas, RelativeMSE())
    every = [torch.from_numpy(theta @ design.T) for design, theta in zip(designs, thetas, strict=True)]
    estimates = [Estimate(p[:1], p[1:].var(0, correction=0)[None], p[None, 1:]) for p in every]
    gaps = torch.stack([gap(estimates[0], other) for other in estimates[1:]], 1)
    mse = mse_proxies(torch.stack([one.variance for one in estimates], 1), gaps)
    weights = RelativeMSE().weights(mse)[0].numpy()
    np.testing.assert_allclose(found.weights, weights, rtol=1e-9)
    np.testing.assert_allclose(found.each, [p[0].numpy() for p in every], rtol=1e-12)
    np.testing.assert_allclose(found.credit, (weights * found.each).sum(0), rtol=1e-9)


def test_a_draw_is_the_mixture_of_its_own_fits() -> None:
    designs, thetas = made()
    found = mixed(designs, thetas, RelativeMSE(), keep=True)
    assert found.draws is not None
    every = np.stack([design @ theta[1:].T for design, theta in zip(designs, thetas, strict=True)])  # [M, n, B]
    for row, draw in ((0, 0), (5, 3), (16, 8)):
        own = every[:, row]
        mse = [own[0].var()]
        mse += [own[j].var() + (own[0] - own[j])[draw] ** 2 + (own[0] - own[j]).var() for j in (1, 2)]
        weights = RelativeMSE().weights(torch.tensor(mse).unsqueeze(-1)).numpy()[:, 0]
        np.testing.assert_allclose(found.draws[draw, row], weights @ own[:, draw], rtol=1e-9)
    np.testing.assert_allclose(found.deviation, found.draws.std(0), rtol=1e-9)


def test_one_model_is_itself() -> None:
    designs, thetas = made(models=1)
    found = mixed(designs, thetas, RelativeMSE(), keep=True)
    np.testing.assert_allclose(found.credit, designs[0] @ thetas[0][0])
    np.testing.assert_allclose(found.deviation, (designs[0] @ thetas[0][1:].T).std(1))
    assert (found.weights == 1).all()


def test_all_weight_on_the_reference_is_the_reference() -> None:
    designs, thetas = made()
    found, alone = mixed(designs, thetas, ReferenceOnly()), mixed(designs[:1], thetas[:1], ReferenceOnly())
    np.testing.assert_allclose(found.credit, alone.credit)
    np.testing.assert_allclose(found.deviation, alone.deviation)


@pytest.mark.parametrize("models", [2, 3, 4])
@pytest.mark.parametrize("alpha", [0.01, 0.5, 30.0])
def test_the_loop_does_what_the_tensors_do(models: int, alpha: float) -> None:
    designs, thetas = made(models)
    mixer = RelativeMSE(alpha=alpha)
    loop = mixed(designs, thetas, mixer, keep=True)
    tensors = of_tensors(np.stack([d @ t.T for d, t in zip(designs, thetas, strict=True)]), mixer)
    for name in ("credit", "deviation", "each", "weights", "disagreement", "draws"):
        np.testing.assert_allclose(getattr(loop, name), getattr(tensors, name), rtol=1e-9, atol=1e-12)


def test_no_row_is_no_credit() -> None:
    designs, thetas = made()
    assert len(mixed([design[:0] for design in designs], thetas, RelativeMSE()).credit) == 0
