"""What parts of a recovery owe: mixers, bonuses, reward models, feature maps, uncertainties, scalers."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from credit.config import schema
from credit.core.seams import Bonus, FeatureMap, Mixer, RewardModel, Scaler
from credit.testing.cases import Case
from credit.testing.expect import close, expect, finite, shaped

MODELS = (1, 2, 3, 4)


def mixer(case: Case) -> None:
    """Weights are shares, for any number of models and any size of errors."""
    for models in MODELS:
        weighs(schema.build(case.config, "mixer"), models)


def weighs(part: Mixer, models: int) -> None:
    """What a mixer makes of random, vanishing and huge proxies of M models."""
    expect(isinstance(part, Mixer), f"{type(part).__name__} is no Mixer")
    random = torch.rand(2, models, 30, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    sizes = {"random": random, "zero": torch.zeros_like(random), "tiny": random * 1e-30, "huge": random * 1e30}
    for name, mse in sizes.items():
        what = f"weights of M = {models} with {name} proxies"
        before = mse.clone()
        weights = part.weights(mse, torch.eye(models, dtype=torch.float64).repeat(2, 1, 1))
        shaped(weights, mse.shape, what)
        finite(weights, what)
        expect((weights >= 0).all(), f"{what} must not be negative")
        close(weights.sum(-2), torch.ones(2, 30, dtype=torch.float64), f"{what} must sum to one")
        expect(torch.equal(mse, before), f"{what}: the proxies that it was given were changed in place")


def bonus(case: Case) -> None:
    """A bonus has a finite number for every place."""
    for value in bonuses(case).values():
        finite(value, "the bonus")


def bonuses(case: Case) -> dict[str, Tensor]:
    """Name → [R, N] of every bonus of a run."""
    assigner, _, _ = case.assigned()
    belief = assigner.belief()
    expect(belief is not None, "nothing is believed")
    expect(belief.bonus or case.name == "none", "there is no bonus")
    for name, value in belief.bonus.items():
        expect(isinstance(assigner.bonus[name], Bonus), f"{type(assigner.bonus[name]).__name__} is no Bonus")
        shaped(value, belief.mixed.shape, "the bonus")
    found: dict[str, Tensor] = belief.bonus
    return found


def reward(case: Case) -> None:
    """A reward model says of every place what it predicts and how sure it is, before and after further windows."""
    assigner, problem, store = case.assigned()
    model = assigner.models[0]
    expect(isinstance(model, RewardModel), f"{type(model).__name__} is no RewardModel")
    expect(isinstance(model.name, str), f"name={model.name!r}: a reward model has a name, which is a str")
    for _ in range(2):
        estimate = model.estimate()
        shaped(estimate.mean, assigner.belief().mixed.shape, "the mean")
        shaped(estimate.variance, estimate.mean.shape, "the variance")
        expect(len(estimate.mean) == problem.replicas, f"{len(estimate.mean)} replicas, not {problem.replicas}")
        finite(estimate.mean, "the mean")
        finite(estimate.variance, "the variance")
        expect((estimate.variance >= 0).all(), "the variance is negative somewhere")
        if estimate.draws is not None:
            draws = estimate.draws
            shaped(draws, (len(estimate.mean), draws.shape[1], estimate.mean.shape[1]), "the draws [R, B, N]")
        model.observe(store)
    expect(model.sees_primitive or estimate.mean.abs().max() > 0, "all steps are worth 0 after labels that are not")


def features(case: Case) -> None:
    """A feature map says of a step what it says of it in any other place among others."""
    model, problem, store = case.built("reference")
    part = model.features
    expect(isinstance(part, FeatureMap), f"{type(part).__name__} is no FeatureMap")
    part.start(problem)
    windows = store.windows
    values = part(windows)
    shaped(values, (*windows.states.shape[:2], values.shape[-1]), "the features [R, n, d]")
    finite(values, "the features")
    size = part(problem.blank()).shape[-1]
    expect(size == values.shape[-1], f"{size} features of one step, and {values.shape[-1]} of windows")
    order = torch.randperm(len(windows), generator=torch.Generator().manual_seed(0))
    moved = {name: getattr(windows, name)[:, order] for name in ("states", "actions", "next_states")}
    shuffled = replace(windows, **moved, step=windows.times[:, order])
    close(part(shuffled), values[:, order], "a step's features depend on the steps beside it")


def uncertainty(case: Case) -> None:
    """Somewhere the fit is not certain, and nowhere less than that."""
    assigner, _, _ = case.assigned()
    variance = assigner.models[0].estimate().variance
    expect((variance >= 0).all(), "the variance is negative somewhere")
    expect(variance.max() > 0, "the variance is 0 everywhere, after a few noisy labels")


def scaler(case: Case) -> None:
    """Rewards of any size become finite ones in the same order."""
    scales(schema.build(case.config, "scaler"))


def scales(part: Scaler) -> None:
    """What a scaler makes of random, equal, tiny and huge rewards, and of a single one."""
    expect(isinstance(part, Scaler), f"{type(part).__name__} is no Scaler")
    random = torch.randn(500, generator=torch.Generator().manual_seed(0)) * 3 - 1
    same = {"zero": torch.zeros(7), "equal": torch.full((7,), 2.5), "single": random[:1]}
    for name, rewards in {"random": random, **same, "tiny": random * 1e-20, "huge": random * 1e20}.items():
        what = f"scaled {name} rewards"
        before = rewards.clone()
        scaled, unit = part(rewards)
        shaped(scaled, rewards.shape, what)
        expect(unit > 0, f"{what}: the unit is {float(unit)}, and it must be positive")
        finite(scaled, what)
        expect(torch.equal(rewards, before), f"{what}: what it was given was changed in place")
        expect((scaled[rewards.argsort()].diff() >= 0).all(), f"{what}: two steps changed their order")
