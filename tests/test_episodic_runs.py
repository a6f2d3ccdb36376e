"""Whole runs on sepsis: no leak, replicas apart, and a recovery.npz that satisfies the equations in NumPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

import credit
from credit.config import files
from credit.core.errors import UserError
from credit.trainer import Trainer

Make = Callable[..., Trainer]
Arrays = dict[str, np.ndarray]
ROUNDS = ("trainer.windows_per_round=10", "trainer.random_windows=10")
SHORT = ("experiment=sepsis", "trainer.steps=200", "trainer.log_every=20", *ROUNDS)
MAIN = {"credit_hypotheses", "delayed", "disagreement"}  # the others are their parts in other combinations
LEARNERS = sorted(files.options("method").keys() - {"oracle"})
STATES, ACTIONS, WINDOW = 1296, 8, 5
PENALTY, PRIOR, COUNT, SCALE = 10.0, 0.25, 0.03, 0.1


def started(make_trainer: Make, method: str, seeds: tuple[int, ...], *overrides: str) -> Trainer:
    """A started trainer; skips methods whose parts do not go with episodes."""
    try:
        return make_trainer(method, seeds, *overrides)
    except UserError as error:
        if " needs a" in str(error):
            pytest.skip(str(error))
        raise


def run(trainer: Trainer) -> list[tuple[int, dict[str, torch.Tensor]]]:
    journal: list[tuple[int, dict[str, torch.Tensor]]] = []
    trainer.run(lambda step, values: journal.append((step, values)))
    return journal


def experience(trainer: Trainer) -> tuple[torch.Tensor, ...]:
    windows = trainer.store.windows
    return windows.states, windows.actions, windows.next_states, windows.labels


@pytest.mark.parametrize(
    ("method", "more"),
    [
        *(pytest.param(method, (), marks=() if method in MAIN else pytest.mark.slow) for method in LEARNERS),
        ("disagreement", ("feedback=terminal", "uncertainty.resample=exact")),
        ("disagreement", ("transition=mixture",)),
    ],
)
def test_a_replica_goes_alone_as_in_a_batch(make_trainer: Make, method: str, more: tuple[str, ...]) -> None:
    seeds = (40, 41, 42)
    batch = started(make_trainer, method, seeds, *SHORT, *more)
    together = run(batch)
    alone = make_trainer(method, seeds[1:2], *SHORT, *more)
    journal = run(alone)
    for mine, theirs in zip(experience(alone), experience(batch), strict=True):
        assert torch.equal(mine[0], theirs[1])
    for (_, mine), (_, theirs) in zip(journal, together, strict=True):
        for name in mine:
            # fits are solved to 1e-5 of the residual, so that rounding may end one an iteration sooner
            torch.testing.assert_close(mine[name][0], theirs[name][1], rtol=1e-5, atol=1e-8)
    assert not torch.equal(batch.store.windows.actions[0], batch.store.windows.actions[1])


def test_episodes_start_anew_and_keep_their_labels(make_trainer: Make) -> None:
    for feedback, shown in (("block_sum", lambda r: r.sum(-1)), ("terminal", lambda r: r[..., -1])):
        trainer = make_trainer("reference", (0, 1), *SHORT, f"feedback={feedback}")
        run(trainer)
        windows, mdp = trainer.store.windows, trainer.env.mdp  # type: ignore[attr-defined]
        assert (mdp.initial[windows.grid(windows.states)[..., 0]] > 0).all()
        assert torch.equal(windows.labels, shown(mdp.reward_next[windows.grid(windows.next_states)]))


@pytest.fixture(
    scope="module",
    params=[("reference", "terminal"), ("adaptive_mse", "terminal"), ("disagreement", "block_sum")],
    ids="-".join,
)
def arrays(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Arrays:
    method, feedback = request.param
    where = [f"output={tmp_path_factory.mktemp('outputs')}", "tracking=none", "seed=7", "replicas=2"]
    result = credit.run(["experiment=sepsis", f"method={method}", f"feedback={feedback}", "trainer.steps=1003", *where])
    found = credit.load(result.folders[1]).recovery
    assert found is not None
    return found


def features(model: str) -> np.ndarray:
    """Features of all pairs [S·A, d], from the digits of the states."""
    states, actions = np.divmod(np.arange(STATES * ACTIONS), ACTIONS)
    bases = np.array([2, 3, 3, 3, 3, 2, 2, 2])
    places = STATES // bases.cumprod()
    digits = states[:, None] // places % bases
    wrong, treated = (digits[:, 1:5] != 1).sum(1), digits[:, 5:].sum(1)
    given = actions // 4 + actions // 2 % 2 + actions % 2
    if model == "linear":
        return np.stack([np.ones(len(states)), wrong / 4, treated / 3, given / 3, digits[:, 0]], axis=-1)
    regime = np.where(wrong >= 3, 2, np.where(wrong + treated == 0, 0, 1))
    return np.eye(9)[regime * 3 + np.minimum(given, 2)]


def flat(arrays: Arrays, name: str) -> np.ndarray:
    """A table [..., S, A] as [..., S·A]."""
    return arrays[name].reshape(*arrays[name].shape[:-2], STATES * ACTIONS)


def pairs(arrays: Arrays) -> np.ndarray:
    """The pairs of every window [K, T]."""
    index: np.ndarray = arrays["windows/states"] * ACTIONS + arrays["windows/actions"]
    return index


def test_shapes_and_names(arrays: Arrays) -> None:
    assert list(arrays["models"]) in (["ridge"], ["ridge", "linear", "health"])
    assert arrays["windows/states"].shape == arrays["windows/next_states"].shape == (200, WINDOW)
    assert arrays["policy"].shape == (WINDOW, STATES)
    for name in ("reward/true", "reward/mixed", "reward/plan", "best", "visits", "mse/ridge"):
        assert arrays[name].shape == (STATES, ACTIONS), name
    for name in arrays["models"]:
        assert arrays[f"draws/{name}"].shape == (20, STATES, ACTIONS)


def test_the_reference_is_the_ridge_solution_on_visited_pairs(arrays: Arrays) -> None:
    index = pairs(arrays)
    visited, inverse = np.unique(index, return_inverse=True)
    x = np.zeros((len(index), len(visited)))
    np.add.at(x, (np.arange(len(index))[:, None], inverse.reshape(index.shape)), 1)
    theta = np.linalg.solve(x.T @ x + PENALTY * np.eye(len(visited)), x.T @ arrays["windows/labels"])  # (4)
    found = flat(arrays, "reward/ridge")
    assert np.linalg.norm(found[visited] - theta) < 1e-3 * np.linalg.norm(theta)  # as the solver's tolerance has it
    unvisited = np.setdiff1d(np.arange(STATES * ACTIONS), visited)
    assert (found[unvisited] == 0).all()
    assert (flat(arrays, "draws/ridge")[:, unvisited] == 0).all()
    assert flat(arrays, "draws/ridge").std(0)[visited].max() > 0


@pytest.mark.parametrize("model", ["linear", "health"])
def test_surrogates_are_ridge_solutions_too(arrays: Arrays, model: str) -> None:
    if model not in arrays["models"]:
        pytest.skip("this method has no surrogates")
    table = features(model)
    x = table[pairs(arrays)].sum(1)
    theta = np.linalg.solve(x.T @ x + np.eye(x.shape[1]), x.T @ arrays["windows/labels"])  # (6)
    np.testing.assert_allclose(flat(arrays, f"reward/{model}"), table @ theta, atol=1e-8, rtol=0)
    draws = flat(arrays, f"draws/{model}")
    projected = table @ np.linalg.lstsq(table, draws.T, rcond=None)[0]
    np.testing.assert_allclose(projected.T, draws, atol=1e-8)
    assert draws.std(0).max() > 0


def test_proxies_weights_mixture_and_bonuses(arrays: Arrays) -> None:
    models = list(arrays["models"])
    visits = np.bincount(pairs(arrays).ravel(), minlength=STATES * ACTIONS)
    np.testing.assert_array_equal(flat(arrays, "visits"), visits)
    assert visits.sum() == 1000  # the three last steps have no label
    proxies, gaps = [], {}
    for model in models:
        draws = flat(arrays, f"draws/{model}")
        mse = ((draws - draws.mean(0)) ** 2).mean(0)  # (10)
        if model == "ridge":
            mse = mse + PRIOR / (1 + visits)
        else:
            gaps[model] = ((flat(arrays, "draws/ridge") - draws) ** 2).mean(0)  # (9)
            np.testing.assert_allclose(flat(arrays, f"disagreement/{model}"), gaps[model], atol=1e-8, rtol=0)
            mse = mse + gaps[model]  # (11)
        np.testing.assert_allclose(flat(arrays, f"mse/{model}"), mse, atol=1e-8, rtol=0)
        proxies.append(mse)
    stacked = np.stack(proxies)
    raw = np.exp(-(stacked - stacked.min(0)) / np.maximum(np.median(stacked, axis=0), 1e-12))  # (12), (13), α = 1
    weights = raw / raw.sum(0)  # (14)
    for model, weight in zip(models, weights, strict=True):
        np.testing.assert_allclose(flat(arrays, f"weight/{model}"), weight, atol=1e-8, rtol=0)
    mixed = sum(w * flat(arrays, f"reward/{m}") for w, m in zip(weights, models, strict=True))  # (15)
    np.testing.assert_allclose(flat(arrays, "reward/mixed"), mixed, atol=1e-8, rtol=0)
    best = stacked.argmin(0)  # (16)
    np.testing.assert_array_equal(flat(arrays, "best"), best)
    disagrees = "bonus/disagreement" in arrays
    if disagrees:
        assert set(best) == {0, 1, 2}  # else the case distinction of (18) is not tested
    signals = [proxies[0], *gaps.values()] if disagrees else proxies  # (18); (17), (30), (31)
    decay = 1 / np.sqrt(1 + visits)
    bonus = SCALE * np.sqrt(np.choose(best, signals)) * decay
    name = "bonus/disagreement" if disagrees else "bonus/local_mse"
    np.testing.assert_allclose(flat(arrays, "bonus/count"), COUNT * decay, atol=1e-8, rtol=0)
    np.testing.assert_allclose(flat(arrays, name), bonus, atol=1e-8, rtol=0)
    np.testing.assert_allclose(flat(arrays, "reward/plan"), mixed + COUNT * decay + bonus, atol=1e-8, rtol=0)  # (19)


def test_the_policy_is_optimal_for_the_plan(arrays: Arrays) -> None:
    index, plan = pairs(arrays).ravel(), flat(arrays, "reward/plan")
    visits = np.maximum(np.bincount(index, minlength=STATES * ACTIONS), 1)
    value = np.zeros(STATES)
    for policy in arrays["policy"][::-1]:
        arrivals = value[arrays["windows/next_states"].ravel()]
        backup = np.bincount(index, arrivals, minlength=STATES * ACTIONS) / visits
        ahead = (plan + backup).reshape(STATES, ACTIONS)
        value = ahead.max(1)
        assert (value - ahead[np.arange(STATES), policy]).max() < 1e-8
