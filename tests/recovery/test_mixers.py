"""Equations (12)–(16)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from credit.bench import naive
from credit.recovery.mixers import (
    Best,
    ReferenceOnly,
    RelativeMSE,
    Uniform,
    best_model,
    best_weights,
    median,
    mix,
    relative_mse_weights,
)

Proxies = arrays(np.float64, st.tuples(st.integers(1, 6), st.integers(1, 5)), elements=st.floats(1e-6, 1e3))


def tensor(values: Any) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def test_weights_of_three_models_by_hand() -> None:
    # min .01, median .02: δ = (.03, 0, .01)/.02 = (1.5, 0, .5); α = .5: exponents (−3, 0, −1)
    total = math.exp(-3) + 1 + math.exp(-1)
    expected = tensor([[math.exp(-3) / total], [1 / total], [math.exp(-1) / total]])
    torch.testing.assert_close(relative_mse_weights(tensor([[0.04], [0.01], [0.02]]), 0.5), expected)


def test_weights_of_two_models_take_the_mean_of_both_as_scale() -> None:
    # median of (.03, .01) is .02: δ = (1, 0); α = .25: exponents (−4, 0)
    weight = math.exp(-4) / (1 + math.exp(-4))
    expected = tensor([[weight], [1 - weight]])
    torch.testing.assert_close(relative_mse_weights(tensor([[0.03], [0.01]]), 0.25), expected)


def test_a_single_model_has_all_the_weight() -> None:
    assert torch.equal(relative_mse_weights(tensor([[0.0, 2.5]]), 0.5), torch.ones(1, 2, dtype=torch.float64))


@pytest.mark.parametrize("models", [1, 2, 3, 4])
def test_without_data_all_weights_are_equal(models: int) -> None:
    weights = relative_mse_weights(torch.zeros(models, 7, dtype=torch.float64), 0.5)
    torch.testing.assert_close(weights, torch.full_like(weights, 1 / models))


def test_a_zero_median_falls_back_to_epsilon() -> None:
    # two of three proxies are 0: scale = ε, so δ of the third is .1/ε and its weight vanishes
    assert relative_mse_weights(tensor([[0.0], [0.0], [0.1]]), 0.5).flatten().tolist() == [0.5, 0.5, 0.0]
    softer = relative_mse_weights(tensor([[0.0], [0.0], [0.1]]), 1.0, epsilon=0.1).flatten()
    torch.testing.assert_close(softer, tensor([1, 1, math.exp(-1)]) / (2 + math.exp(-1)))


def test_median_of_odd_and_even_numbers() -> None:
    assert median(tensor([[3.0], [1.0], [2.0]])).tolist() == [2.0]
    assert median(tensor([[4.0], [1.0], [3.0], [2.0]])).tolist() == [2.5]


@given(Proxies, st.randoms(use_true_random=False))
def test_a_median_is_of_what_is_finite(values: np.ndarray, random: Any) -> None:
    for column in values.T:
        column[[random.random() < 0.4 for _ in column]] = np.inf
    finite = [column[np.isfinite(column)] for column in values.T]
    expected = [np.median(own) if len(own) else np.inf for own in finite]
    assert median(torch.from_numpy(values)).tolist() == expected


def test_weights_do_not_look_at_values_to_decide_what_to_do() -> None:
    nowhere = torch.empty(2, 3, 5, device="meta")  # tensors without values: who asks for one has to wait for a GPU
    for alpha in (0.0, 0.5):
        assert relative_mse_weights(nowhere, alpha).shape == (2, 3, 5)


@given(Proxies)
def test_weights_are_a_distribution_that_falls_with_the_proxy(mse: np.ndarray) -> None:
    weights = relative_mse_weights(torch.from_numpy(mse), 0.5).numpy()
    np.testing.assert_allclose(weights.sum(0), 1, rtol=1e-12)
    assert (weights >= 0).all()
    order = mse.argsort(0)
    assert (np.diff(np.take_along_axis(weights, order, 0), axis=0) <= 1e-15).all()


@given(Proxies, st.randoms(use_true_random=False))
def test_weights_follow_a_permutation_of_the_models(mse: np.ndarray, random: Any) -> None:
    order = list(range(len(mse)))
    random.shuffle(order)
    weights = relative_mse_weights(torch.from_numpy(mse), 0.5)
    torch.testing.assert_close(relative_mse_weights(torch.from_numpy(mse[order]), 0.5), weights[order])


@given(Proxies, st.floats(1e-3, 1e3))
def test_weights_do_not_depend_on_the_unit(mse: np.ndarray, unit: float) -> None:
    scaled = relative_mse_weights(torch.from_numpy(mse * unit), 0.5)
    torch.testing.assert_close(scaled, relative_mse_weights(torch.from_numpy(mse), 0.5), rtol=1e-9, atol=1e-12)


@given(Proxies)
def test_weights_equal_the_second_implementation(mse: np.ndarray) -> None:
    expected = naive.weights({str(j): row for j, row in enumerate(mse)}, alpha=0.7)
    np.testing.assert_allclose(relative_mse_weights(torch.from_numpy(mse), 0.7), np.stack(list(expected.values())))


def test_at_alpha_zero_the_best_model_has_all_the_weight() -> None:
    mse = tensor([[0.04, 0.01, 0.02, 0.0], [0.01, 0.02, 0.02, 0.0], [0.02, 0.04, 0.05, 0.0]])
    assert torch.equal(relative_mse_weights(mse, 0.0), best_weights(mse))
    assert best_weights(mse).tolist() == [[0, 1, 1, 1], [1, 0, 0, 0], [0, 0, 0, 0]]  # on ties the reference
    with pytest.raises(ValueError, match=r"alpha=-0\.5: must be at least 0"):
        relative_mse_weights(mse, -0.5)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("alpha", [1e-30, 1e-45, 1e-320, 5e-324])
def test_however_small_alpha_is_weights_are_numbers(alpha: float, dtype: torch.dtype) -> None:
    mse = tensor([[0.04, 0.01, 0.0], [0.01, 0.02, 1e-9], [0.02, 0.04, 0.0]]).to(dtype)
    expected = tensor([[0, 1, 0.5], [1, 0, 0], [0, 0, 0.5]]).to(dtype)  # the limit where two are the best
    torch.testing.assert_close(relative_mse_weights(mse, alpha), expected)


def test_a_model_of_infinite_error_has_no_weight() -> None:
    inf = math.inf
    mse = tensor([[0.04, inf, inf, inf], [0.01, 0.03, inf, 5.0], [0.02, 0.01, inf, inf]])
    found = relative_mse_weights(mse, 0.25)
    assert torch.equal(found[:, 0], relative_mse_weights(mse[:, :1], 0.25)[:, 0])  # where none is
    torch.testing.assert_close(found[1:, 1:2], relative_mse_weights(mse[1:, 1:2], 0.25))  # as if it were not there
    assert found[0, 1] == 0
    torch.testing.assert_close(found[:, 2], torch.full((3,), 1 / 3, dtype=torch.float64))
    assert found[:, 3].tolist() == [0, 1, 0]
    assert relative_mse_weights(mse, 0.0)[:, 3].tolist() == [0, 1, 0]


@given(Proxies, st.integers(0, 5), st.sampled_from([0.01, 0.5, 1e300]))
def test_a_model_of_infinite_error_changes_nothing_among_the_others(mse: np.ndarray, place: int, alpha: float) -> None:
    place = min(place, len(mse))
    more = np.insert(mse, place, np.inf, axis=0)
    found = relative_mse_weights(torch.from_numpy(more), alpha).numpy()
    assert (found[place] == 0).all()
    expected = relative_mse_weights(torch.from_numpy(mse), alpha)
    np.testing.assert_allclose(np.delete(found, place, 0), expected, rtol=1e-9, atol=1e-15)


def test_shapes_that_do_not_fit_are_refused() -> None:
    mse = tensor([[0.04, 0.01], [0.01, 0.02], [0.02, 0.04]])
    for equation in (best_model, median, best_weights, lambda x: relative_mse_weights(x, 0.5)):
        with pytest.raises(ValueError, match=r"\[2\]; they must be \w+ \[..., M, N\]"):
            equation(mse[0])
    with pytest.raises(ValueError, match=r"weights \[3, 1\], predictions \[3, 2\]"):
        mix(mse[:, :1], mse)


def test_leading_dimensions_are_independent_problems() -> None:
    mse = torch.rand(4, 3, 5, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    together = relative_mse_weights(mse, 0.5)
    for i in range(4):
        for j in range(3):
            assert torch.equal(together[i, j], relative_mse_weights(mse[i, j], 0.5))
            assert torch.equal(best_model(mse)[i, j], best_model(mse[i, j]))


@pytest.mark.parametrize("shape", [(3, 1), (3, 30), (2, 3, 30), (5, 7, 100), (64, 2, 33)])
def test_the_reference_wins_every_tie(shape: tuple[int, ...]) -> None:
    assert (best_model(torch.zeros(shape, dtype=torch.float64)) == 0).all()
    tied = torch.ones(shape, dtype=torch.float64)
    tied[..., -1, :] = 1.5
    assert (best_model(tied) == 0).all()


def test_the_first_of_tied_surrogates_is_best() -> None:
    assert best_model(tensor([[2.0, 1.0], [1.0, 3.0], [1.0, 1.0]])).tolist() == [1, 0]


def test_mixed_reward_by_hand() -> None:
    # (15): .25·2 + .75·(−2) = −1 and .5·4 + .5·1 = 2.5
    weights, means = tensor([[0.25, 0.5], [0.75, 0.5]]), tensor([[2.0, 4.0], [-2.0, 1.0]])
    assert mix(weights, means).tolist() == [-1.0, 2.5]


def test_the_classes_are_the_equations() -> None:
    mse = tensor([[[0.04, 0.01], [0.01, 0.02], [0.02, 0.04]]])
    torch.testing.assert_close(RelativeMSE(alpha=0.3).weights(mse), relative_mse_weights(mse, 0.3))
    assert ReferenceOnly().weights(mse).tolist() == [[[1, 1], [0, 0], [0, 0]]]
    assert Best().weights(mse).tolist() == [[[0, 1], [1, 0], [0, 0]]]
    torch.testing.assert_close(Uniform().weights(mse), torch.full_like(mse, 1 / 3))


def test_small_alpha_tends_to_the_best_model_and_large_alpha_to_equal_weights() -> None:
    mse = tensor([[0.04, 0.01], [0.01, 0.02], [0.02, 0.04]])
    torch.testing.assert_close(RelativeMSE(alpha=1e-3).weights(mse), Best().weights(mse))
    torch.testing.assert_close(RelativeMSE(alpha=1e9).weights(mse), Uniform().weights(mse), rtol=1e-6, atol=0)
