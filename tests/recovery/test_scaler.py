"""The scale of a pseudo-reward, against NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from credit.config import files, schema
from credit.recovery.scaler import Standard


def recipe(name: str) -> Standard:
    path: Path = files.options("scaler")[name]
    built: Standard = schema.build({"scaler": yaml.safe_load(path.read_text(encoding="utf-8"))}, "scaler")
    return built


def rewards(dtype: torch.dtype = torch.float64) -> torch.Tensor:
    """A few large among many small ones."""
    drawn = torch.randn(999, dtype=dtype, generator=torch.Generator().manual_seed(0)) * 0.003 + 0.02
    drawn[:9] += 0.5
    return drawn


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(("name", "clip", "quantile"), [("stable", 1.0, 0.99), ("plain", 5.0, None)])
def test_recipes(name: str, clip: float, quantile: float | None, dtype: torch.dtype) -> None:
    values = rewards(dtype)
    before = values.clone()
    found, unit = recipe(name)(values)
    assert torch.equal(values, before)
    assert found.dtype == unit.dtype == dtype
    x = values.double().numpy()
    np.testing.assert_allclose(unit, x.std(), rtol=1e-4 if dtype == torch.float32 else 1e-12)
    x = x / x.std()
    x = np.clip(x, np.median(x) - clip, np.median(x) + clip)
    if quantile is not None:
        x = np.minimum(x - np.quantile(x, quantile), 0)
    np.testing.assert_allclose(found, x, atol=1e-4 if dtype == torch.float32 else 1e-12)


def test_the_best_steps_are_worth_zero_and_no_step_more() -> None:
    values = rewards()
    found, _ = Standard(clip=3.0, quantile=0.9)(values)
    assert found.max() == 0
    assert (found == 0).double().mean() == pytest.approx(0.1, abs=0.01)
    assert found.max() - found.min() <= 6
    ranks = values.argsort()
    assert (found[ranks].diff() >= 0).all()


@pytest.mark.parametrize("name", ["stable", "plain"])
@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_the_unit_of_the_reward_does_not_matter(name: str, scale: float) -> None:
    scaled, unit = recipe(name)(rewards() * scale)
    plain, one = recipe(name)(rewards())
    torch.testing.assert_close(scaled, plain)
    torch.testing.assert_close(unit, scale * one)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("value", [0.0, 0.1, -7.3])
def test_constant_rewards_are_not_divided(value: float, dtype: torch.dtype) -> None:
    constant = torch.full((1001,), value, dtype=dtype)
    stable, plain = recipe("stable")(constant), recipe("plain")(constant)
    assert torch.equal(stable[0], torch.zeros(1001, dtype=dtype))
    torch.testing.assert_close(plain[0], constant)
    assert stable[1] == plain[1] == 1


def test_no_rewards() -> None:
    found, unit = recipe("stable")(torch.zeros(0))
    assert found.shape == (0,)
    assert unit == 1


def test_the_rewards_of_several_replicas_are_not_scaled_together() -> None:
    with pytest.raises(ValueError, match=r"one replica.*\[2, 5\]"):
        recipe("stable")(torch.zeros(2, 5))
