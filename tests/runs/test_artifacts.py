"""recovery.npz satisfies the paper's equations when recomputed from its own windows, in NumPy alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import credit
from credit.runs.artifacts import write_arrays

PENALTY, ALPHA, COUNT, LAMBDA = 0.1, 0.5, 0.35, 1.0
Arrays = dict[str, np.ndarray]


@pytest.fixture(scope="module", params=["reference", "adaptive_mse", "disagreement"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Arrays]:
    output = tmp_path_factory.mktemp("outputs")
    result = credit.run(
        [f"method={request.param}", "tracking=none", f"output={output}", "seed=7", "replicas=2", "trainer.steps=1403"]
    )
    arrays = credit.load(result.folders[1]).recovery
    assert arrays is not None
    return request.param, arrays


def design(arrays: Arrays, model: str) -> tuple[np.ndarray, np.ndarray]:
    """Summed features of the windows [K, d] and features of all pairs [S, A, d]."""
    s, a = np.meshgrid(np.arange(10), np.arange(3), indexing="ij")
    if model == "ridge":
        table = np.eye(30)[s * 3 + a]
    elif model == "linear":
        table = np.stack([np.ones(s.shape), s, a, s * a], axis=-1)
    else:
        table = np.eye(6)[(s > 4) * 3 + a]
    return table[arrays["windows/states"], arrays["windows/actions"]].sum(1), table


def test_shapes_and_names(run: tuple[str, Arrays]) -> None:
    method, arrays = run
    models = list(arrays["models"])
    assert models == (["ridge"] if method == "reference" else ["ridge", "linear", "threshold"])
    assert arrays["windows/states"].shape == arrays["windows/actions"].shape == (200, 7)
    assert arrays["windows/labels"].shape == (200,)
    assert arrays["policy"].shape == (10,)
    tables = ["reward/true", "reward/mixed", "reward/plan", "best", "visits", "bonus/count"]
    tables += [f"{kind}/{name}" for name in models for kind in ("reward", "mse", "weight")]
    tables += [f"disagreement/{name}" for name in models[1:]]
    for name in tables:
        assert arrays[name].shape == (10, 3), name
    for name in models:
        assert arrays[f"draws/{name}"].shape == (20, 10, 3)
    bonuses = {name for name in arrays if name.startswith("bonus/")}
    assert bonuses == {"bonus/count", "bonus/disagreement" if method == "disagreement" else "bonus/local_mse"}


def test_fits(run: tuple[str, Arrays]) -> None:
    _, arrays = run
    for model in arrays["models"]:
        x, table = design(arrays, model)
        theta = np.linalg.solve(x.T @ x + PENALTY * np.eye(x.shape[1]), x.T @ arrays["windows/labels"])  # (4), (6)
        np.testing.assert_allclose(arrays[f"reward/{model}"], table @ theta, atol=1e-8, rtol=0)


def test_draws_are_ridge_fits_too(run: tuple[str, Arrays]) -> None:
    # A draw of the linear model has four coefficients: it lies in the span of its features, as that of the cells does.
    _, arrays = run
    for model in arrays["models"][1:]:
        _, table = design(arrays, model)
        flat, draws = table.reshape(30, -1), arrays[f"draws/{model}"].reshape(20, 30)
        projected = flat @ np.linalg.lstsq(flat, draws.T, rcond=None)[0]
        np.testing.assert_allclose(projected.T, draws, atol=1e-8)
        assert draws.std(0).max() > 0


def test_proxies_weights_and_mixture(run: tuple[str, Arrays]) -> None:
    method, arrays = run
    models = list(arrays["models"])
    reference = arrays["draws/ridge"]
    proxies = []
    for model in models:
        draws = arrays[f"draws/{model}"]
        mse = ((draws - draws.mean(0)) ** 2).mean(0)  # (10)
        if model != "ridge":
            gap = ((reference - draws) ** 2).mean(0)  # (9)
            np.testing.assert_allclose(arrays[f"disagreement/{model}"], gap, atol=1e-8, rtol=0)
            mse = mse + gap  # (11)
        np.testing.assert_allclose(arrays[f"mse/{model}"], mse, atol=1e-8, rtol=0)
        proxies.append(mse)
    stacked = np.stack(proxies)
    scale = np.maximum(np.median(stacked, axis=0), 1e-12)  # (12)
    raw = np.exp(-(stacked - stacked.min(0)) / scale / ALPHA)  # (13)
    weights = raw / raw.sum(0)  # (14)
    for model, weight in zip(models, weights, strict=True):
        np.testing.assert_allclose(arrays[f"weight/{model}"], weight, atol=1e-8, rtol=0)
    mixed = sum(w * arrays[f"reward/{m}"] for w, m in zip(weights, models, strict=True))  # (15)
    np.testing.assert_allclose(arrays["reward/mixed"], mixed, atol=1e-8, rtol=0)
    np.testing.assert_array_equal(arrays["best"], stacked.argmin(0))  # (16)
    if method != "reference":
        assert len(np.unique(arrays["best"])) > 1  # else the case distinction of (18) is not tested


def test_visits_and_bonuses(run: tuple[str, Arrays]) -> None:
    method, arrays = run
    visits = np.zeros((10, 3))
    np.add.at(visits, (arrays["windows/states"].ravel(), arrays["windows/actions"].ravel()), 1)
    np.testing.assert_array_equal(arrays["visits"], visits)
    assert visits.sum() == 1400  # the three last steps have no label
    decay = 1 / np.sqrt(LAMBDA + visits)
    models = list(arrays["models"])
    best = arrays["best"]
    if method == "disagreement":
        signals = [arrays["mse/ridge"], *(arrays[f"disagreement/{m}"] for m in models[1:])]  # (18)
        name = "disagreement"
    else:
        signals = [arrays[f"mse/{m}"] for m in models]  # (17), (30), (31)
        name = "local_mse"
    bonus = np.sqrt(np.choose(best, signals)) * decay
    np.testing.assert_allclose(arrays["bonus/count"], COUNT * decay, atol=1e-8, rtol=0)
    np.testing.assert_allclose(arrays[f"bonus/{name}"], bonus, atol=1e-8, rtol=0)
    plan = arrays["reward/mixed"] + COUNT * decay + bonus  # (19)
    np.testing.assert_allclose(arrays["reward/plan"], plan, atol=1e-8, rtol=0)


def test_truth(run: tuple[str, Arrays]) -> None:
    _, arrays = run
    s, a = np.meshgrid(np.arange(10), np.arange(3), indexing="ij")
    truth = 0.05 * s - 0.005 * s**2 - 0.05 * a - 0.12 * a**2 + np.array([0, 0.02, 0.05])[a] * s  # (23)
    np.testing.assert_allclose(arrays["reward/true"], truth, atol=1e-12)


def test_the_policy_is_optimal_for_the_plan(run: tuple[str, Arrays]) -> None:
    # Where the very last step led is not in the windows (the next window would tell), so one of the three possible
    # states must explain the policy.
    _, arrays = run
    states, actions = arrays["windows/states"].ravel(), arrays["windows/actions"].ravel()
    possible = {int(np.clip(states[-1] + move, 0, 9)) for move in (-1, 0, 1)}
    gaps = [gap(arrays, states, actions, np.append(states[1:], last)) for last in possible]
    assert min(gaps) < 1e-5, gaps


def gap(arrays: Arrays, states: np.ndarray, actions: np.ndarray, arrivals: np.ndarray) -> float:
    """By how much the policy misses the best action value (42), with P̂ from counts and one neighbourly pseudo-count."""
    counts = np.zeros((10, 3, 10))
    for move in (-1, 0, 1):
        counts[np.arange(10), :, np.clip(np.arange(10) + move, 0, 9)] += 1 / 3
    np.add.at(counts, (states, actions, arrivals), 1)
    transition = counts / counts.sum(-1, keepdims=True)
    policy, rows = arrays["policy"], np.arange(10)
    system = np.eye(10) - transition[rows, policy]
    system[:, 0] = 1  # unknowns: g, h(1), …, h(9)
    solution = np.linalg.solve(system, arrays["reward/plan"][rows, policy])
    bias = np.append(0, solution[1:])
    values = arrays["reward/plan"] + transition @ bias
    return float((values.max(1) - values[rows, policy]).max())


@pytest.mark.parametrize(("method", "expected"), [("delayed", False), ("random", False), ("elliptical", True)])
def test_only_methods_that_recover_write_it(tmp_path: Path, method: str, expected: bool) -> None:
    result = credit.run([f"method={method}", "tracking=none", f"output={tmp_path}", "replicas=1", "trainer.steps=70"])
    assert (result.folders[0] / "recovery.npz").exists() == expected
    assert (credit.load(result.folders[0]).recovery is not None) == expected


def test_files_are_replaced_as_a_whole(tmp_path: Path) -> None:
    for value in (1.0, 2.0):
        write_arrays(tmp_path / "recovery.npz", {"a/b": np.array([value])})
    assert [path.name for path in tmp_path.iterdir()] == ["recovery.npz"]
    with np.load(tmp_path / "recovery.npz") as arrays:
        assert arrays["a/b"].tolist() == [2.0]
