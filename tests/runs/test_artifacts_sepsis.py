"""recovery.npz of patients satisfies the equations when recomputed from its own windows, in NumPy alone.

The bootstrap's weights are not in the file; they follow from the seed, which makes every draw recomputable as well.
"""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.optimize import nnls

import credit
from credit.core.problem import Problem
from credit.core.windows import Windows
from credit.envs.sepsis.factored import FactoredMixture
from credit.planning.counts import ObservedCounts

Arrays = dict[str, np.ndarray]
STATES, ACTIONS, WINDOW, DRAWS, SEED, COUNT = 1296, 8, 5, 20, 8, 60
REFERENCE, SURROGATE, PRIOR, SCALE = 10.0, 1.0, 0.25, 0.1
RUNS = {
    "hypotheses of sums": ("credit_hypotheses", "block_sum", ()),
    "hypotheses of ends": ("credit_hypotheses", "terminal", ("uncertainty.ddof=1",)),
    "the last step": ("last_step", "terminal", ()),
    "pairs": ("disagreement", "block_sum", ()),
}
ROUNDS = ("trainer.first_windows=20", "trainer.random_windows=15", "trainer.windows_per_round=20")
BASES = np.array([2, 3, 3, 3, 3, 2, 2, 2])


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=pytest.mark.thorough if name != "pairs" else ()) for name in RUNS]
)
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Arrays]:
    method, feedback, more = RUNS[request.param]
    words = [
        "experiment=sepsis",
        f"method={method}",
        f"feedback={feedback}",
        f"trainer.steps={COUNT * WINDOW}",
        *ROUNDS,
    ]
    where = [f"output={tmp_path_factory.mktemp('outputs')}", "tracking=none", f"seed={SEED - 1}", "replicas=2"]
    arrays = credit.load(credit.run([*words, *more, *where]).folders[1]).recovery
    assert arrays is not None
    return request.param, arrays


def digits(states: np.ndarray) -> np.ndarray:
    """The digits [..., 8] of patients: diabetes, four vitals, three treatments."""
    return states[..., None] // (STATES // BASES.cumprod()) % BASES


def clinical(states: np.ndarray, given: np.ndarray | None) -> np.ndarray:
    """(1, A/4, U/3, intensity/3, diabetes); of s' (`given` is None) without the intensity."""
    told = digits(states)
    wrong, treated = (told[..., 1:5] != 1).sum(-1), told[..., 5:].sum(-1)
    parts = [np.ones(states.shape), wrong / 4, treated / 3, *([] if given is None else [given / 3]), told[..., 0]]
    return np.stack(parts, -1)


def health(states: np.ndarray, given: np.ndarray | None) -> np.ndarray:
    """One-hot of regime × intensity, where the intensity of s' is how many treatments it has."""
    told = digits(states)
    wrong, treated = (told[..., 1:5] != 1).sum(-1), told[..., 5:].sum(-1)
    regime = np.where(wrong >= 3, 2, np.where(wrong + treated == 0, 0, 1))
    return np.eye(9)[regime * 3 + np.minimum(treated if given is None else given, 2)]


def sizes(arrays: Arrays) -> tuple[int, ...]:
    return (STATES, ACTIONS) if list(arrays["cells"]) == ["state", "action"] else (WINDOW, STATES)


def index(arrays: Arrays) -> np.ndarray:
    """The cell of every step [K, T]."""
    if sizes(arrays) == (STATES, ACTIONS):
        pairs: np.ndarray = arrays["windows/states"] * ACTIONS + arrays["windows/actions"]
        return pairs
    return np.arange(WINDOW) * STATES + arrays["windows/next_states"]


def flat(arrays: Arrays, name: str) -> np.ndarray:
    """A table [..., ·, ·] as [..., N]."""
    array = arrays[name]
    assert array.shape[-2:] == sizes(arrays)
    return array.reshape(*array.shape[:-2], -1)


def table(run: tuple[str, Arrays], model: str) -> np.ndarray:
    """φ of every cell [N, d] of a surrogate."""
    what, _ = run
    features = {"linear": clinical, "health": health}[model.removesuffix("_last")]
    if what == "pairs":
        states, actions = np.divmod(np.arange(STATES * ACTIONS), ACTIONS)
        return features(states, (actions[:, None] >> np.arange(3) & 1).sum(-1))
    once = features(np.arange(STATES), None)
    last = model.endswith("_last") or what == "the last step"
    return np.concatenate([once * (not last or step == WINDOW - 1) for step in range(WINDOW)])


def bootstrap() -> np.ndarray:
    """The weights of the point fit and of all draws [K, 1+B]."""
    generator = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(zlib.crc32(b"bootstrap"),)))
    return np.concatenate([np.ones((COUNT, 1)), generator.poisson(1.0, (COUNT, DRAWS))], axis=1)


def ridge(x: np.ndarray, arrays: Arrays, penalty: float) -> np.ndarray:
    """θ [1+B, d] of all fits: (XᵀWX + λI)⁻¹ XᵀW Y = XᵀW (XXᵀW + λI)⁻¹ Y, the smaller system."""
    gram, eye = x @ x.T, penalty * np.eye(COUNT)
    return np.stack([(x.T * w) @ np.linalg.solve(gram * w + eye, arrays["windows/labels"]) for w in bootstrap().T])


def reference(run: tuple[str, Arrays]) -> tuple[np.ndarray, np.ndarray]:
    """The cells that the reference has unknowns for, and X of them [K, V]."""
    what, arrays = run
    cells = index(arrays)[:, -1:] if what == "the last step" else index(arrays)
    visited, column = np.unique(cells, return_inverse=True)
    x = np.zeros((COUNT, len(visited)))
    np.add.at(x, (np.arange(COUNT)[:, None], column.reshape(cells.shape)), 1)
    return visited, x


def test_shapes_and_names(run: tuple[str, Arrays]) -> None:
    what, arrays = run
    doubled = ["linear_last", "health_last"] if what.startswith("hypotheses") else []
    models = list(arrays["models"])
    assert sorted(models) == sorted(["ridge", "linear", "health", *doubled])
    assert models[0] == "ridge"
    assert list(arrays["cells"]) == (["state", "action"] if what == "pairs" else ["step", "next_state"])
    for name in ("reward/true", "reward/mixed", "reward/plan", "best", "visits", *(f"mse/{name}" for name in models)):
        assert arrays[name].shape == sizes(arrays), name
    for name in models:
        assert arrays[f"draws/{name}"].shape == (DRAWS, *sizes(arrays))
    assert arrays["windows/next_states"].shape == (COUNT, WINDOW)
    assert arrays["policy"].shape == (WINDOW, STATES)
    mine = {"count", "disagreement"} if what == "pairs" else {"elliptical", "disagreement"}
    assert {name for name in arrays if name.startswith("bonus/")} == {f"bonus/{name}" for name in mine}


def test_the_reference(run: tuple[str, Arrays]) -> None:
    _, arrays = run
    visited, x = reference(run)
    theta = ridge(x, arrays, REFERENCE)  # (4)
    found = np.concatenate([flat(arrays, "reward/ridge")[None], flat(arrays, "draws/ridge")])
    error = np.abs(found[:, visited] - theta).max(1)
    assert (error <= 1e-4 * np.abs(theta).max(1)).all()  # as exact as the solver's tolerance says
    unvisited = np.setdiff1d(np.arange(found.shape[1]), visited)
    assert (found[:, unvisited] == 0).all()
    assert theta[1:].std(0).max() > 0


def test_the_surrogates(run: tuple[str, Arrays]) -> None:
    _, arrays = run
    for model in arrays["models"][1:]:
        features = table(run, model)
        theta = ridge(features[index(arrays)].sum(1), arrays, SURROGATE)  # (6)
        found = np.concatenate([flat(arrays, f"reward/{model}")[None], flat(arrays, f"draws/{model}")])
        np.testing.assert_allclose(found, theta @ features.T, atol=1e-8, rtol=0)
        assert np.abs(theta).max() > 0.05


def proxies(run: tuple[str, Arrays]) -> tuple[np.ndarray, np.ndarray]:
    """MSE proxies [M, N] and disagreements [M−1, N] from the draws in the file."""
    what, arrays = run
    mse, gaps, known = [], [], flat(arrays, "draws/ridge")
    for model in arrays["models"]:
        draws = flat(arrays, f"draws/{model}")
        variance = ((draws - draws.mean(0)) ** 2).sum(0) / (DRAWS - (what == "hypotheses of ends"))  # (10)
        if model == "ridge":
            mse.append(variance + PRIOR / (1 + np.bincount(index(arrays).ravel(), minlength=draws.shape[1])))
        else:
            gaps.append(((known - draws) ** 2).mean(0))  # (9)
            mse.append(variance + gaps[-1])  # (11)
    return np.stack(mse), np.stack(gaps)


def test_proxies_and_visits(run: tuple[str, Arrays]) -> None:
    _, arrays = run
    mse, gaps = proxies(run)
    models = list(arrays["models"])
    for name, expected in zip(models, mse, strict=True):
        np.testing.assert_allclose(flat(arrays, f"mse/{name}"), expected, atol=1e-10, rtol=0)
    for name, expected in zip(models[1:], gaps, strict=True):
        np.testing.assert_allclose(flat(arrays, f"disagreement/{name}"), expected, atol=1e-10, rtol=0)
    np.testing.assert_array_equal(flat(arrays, "best"), mse.argmin(0))  # (16)
    visits = np.bincount(index(arrays).ravel(), minlength=mse.shape[1])
    np.testing.assert_array_equal(flat(arrays, "visits"), visits)
    assert visits.sum() == COUNT * WINDOW


def stacked(run: tuple[str, Arrays]) -> np.ndarray:
    """min ‖Y − Σ w Ŷ‖²/Var(Y) + ‖w‖² over w ≥ 0, Σ w = 1, by least squares with a heavy row for the sum; [M]."""
    _, arrays = run
    unseen = bootstrap()[:, 1:] == 0  # [K, B]
    out = unseen.any(1)
    predictions = []
    for model in arrays["models"]:
        each = flat(arrays, f"draws/{model}")[:, index(arrays)].sum(-1).T  # [K, B]
        predictions.append((each * unseen).sum(1)[out] / unseen.sum(1)[out])
    errors = (np.stack(predictions, 1) - arrays["windows/labels"][out, None]) / arrays["windows/labels"].std()
    count = errors.shape[1]
    rows = np.concatenate([errors, np.eye(count), 1e5 * np.ones((1, count))])
    target = np.concatenate([np.zeros(len(rows) - 1), [1e5]])
    return nnls(rows, target)[0]


def test_weights_and_mixture(run: tuple[str, Arrays]) -> None:
    what, arrays = run
    models = list(arrays["models"])
    if what == "pairs":
        mse, _ = proxies(run)
        raw = np.exp(-(mse - mse.min(0)) / np.maximum(np.median(mse, 0), 1e-12))  # (12), (13), α = 1
        weights = raw / raw.sum(0)  # (14)
        tolerance = 1e-8
    else:
        weights = np.repeat(stacked(run)[:, None], WINDOW * STATES, 1)
        tolerance = 1e-6
        if what == "hypotheses of ends":  # the labels of the others are explained by one model
            assert (weights[:, 0] > 0.05).sum() > 1
    for name, weight in zip(models, weights, strict=True):
        np.testing.assert_allclose(flat(arrays, f"weight/{name}"), weight, atol=tolerance, rtol=0)
    mixed = sum(flat(arrays, f"weight/{name}") * flat(arrays, f"reward/{name}") for name in models)  # (15)
    np.testing.assert_allclose(flat(arrays, "reward/mixed"), mixed, atol=1e-12, rtol=0)
    assert np.abs(mixed).max() > 0.01


def test_bonuses_and_plan(run: tuple[str, Arrays]) -> None:
    what, arrays = run
    mse, gaps = proxies(run)
    visits = flat(arrays, "visits")
    signal = np.choose(mse.argmin(0), [mse[0], *gaps])  # (18)
    disagreement = SCALE * np.sqrt(signal / (1 + visits))
    np.testing.assert_allclose(flat(arrays, "bonus/disagreement"), disagreement, atol=1e-8, rtol=0)
    if what == "pairs":
        first = 0.03 / np.sqrt(1 + visits)
        np.testing.assert_allclose(flat(arrays, "bonus/count"), first, atol=1e-12, rtol=0)
    else:
        visited, x = reference(run)
        width = np.full(WINDOW * STATES, 1 / REFERENCE)
        width[visited] = 1 / (REFERENCE + (x**2).sum(0))
        exact = np.linalg.inv(x.T @ x + REFERENCE * np.eye(len(visited))).diagonal()
        assert (width[visited] <= exact + 1e-12).all()
        if what == "the last step":
            width[:-STATES] = 0
        first = 0.1 * 0.5 * np.sqrt(width)
        np.testing.assert_allclose(flat(arrays, "bonus/elliptical"), first, atol=1e-12, rtol=0)
    plan = flat(arrays, "reward/mixed") + first + disagreement  # (19)
    np.testing.assert_allclose(flat(arrays, "reward/plan"), plan, atol=1e-8, rtol=0)


def test_the_truth(run: tuple[str, Arrays]) -> None:
    what, arrays = run
    told = digits(np.arange(STATES))
    wrong, treated = (told[:, 1:5] != 1).sum(-1), told[:, 5:].sum(-1)
    reward = ((wrong == 0) & (treated == 0)) * 1.0 - (wrong >= 3)  # (26)
    if what == "pairs":
        # Diabetes, all vitals high, all treatments, and then the ventilator alone: blood pressure falls with .05 and
        # glucose with .3, else nothing does. Less than three are abnormal if both do.
        assert arrays["reward/true"][161 * 8 + 7, 1] == pytest.approx(-(1 - 0.05 * 0.3))
        # No diabetes, blood pressure high, no treatments, and then none: .1 each way, off the scale stays. Well is who
        # falls (.1) and whose other three do not move (.8 each); ill is who has two that move (three, if it falls).
        moved = [0.8**3, 3 * 0.2 * 0.8**2, 3 * 0.2**2 * 0.8, 0.2**3]
        expected = 0.1 * moved[0] - 0.9 * (moved[2] + moved[3]) - 0.1 * moved[3]
        assert arrays["reward/true"][(27 + 18 + 3 + 1) * 8, 0] == pytest.approx(expected)
        return
    counts = np.ones(WINDOW) if what == "hypotheses of sums" else np.arange(WINDOW) == WINDOW - 1
    np.testing.assert_array_equal(arrays["reward/true"], counts[:, None] * reward)
    shown = counts * reward[arrays["windows/next_states"]]
    np.testing.assert_array_equal(shown.sum(1), arrays["windows/labels"])  # without noise the label is the truth


def test_axes_to_show_it_over(run: tuple[str, Arrays]) -> None:
    what, arrays = run
    names = {name.removeprefix("axis/") for name in arrays if name.startswith("axis/")}
    assert names == {"abnormal vitals", "treatments"}
    wrong, given = arrays["axis/abnormal vitals"], arrays["axis/treatments"]
    assert wrong.shape == given.shape == sizes(arrays)
    # 40 · 8 + 5: no diabetes, all normal, antibiotics and ventilator; 81 · 8 + 2: diabetes, all low, vasopressors
    well, ill = 40 * 8 + 5, 81 * 8 + 2
    if what == "pairs":  # the vitals of s, the treatments of the action
        assert [int(wrong[well, a]) for a in (0, 7)] == [0, 0]
        assert [int(wrong[ill, a]) for a in (0, 7)] == [4, 4]
        assert [int(given[well, a]) for a in range(8)] == [0, 1, 1, 2, 1, 2, 2, 3]
        assert [int(given[ill, a]) for a in range(8)] == [0, 1, 1, 2, 1, 2, 2, 3]
    else:  # those of s', at every step
        assert [int(wrong[step, well]) for step in range(WINDOW)] == [0] * WINDOW
        assert [int(given[step, well]) for step in range(WINDOW)] == [2] * WINDOW
        assert (wrong[3, ill], given[0, ill]) == (4, 1)
        assert (wrong[1, ill + 8], given[1, ill + 8]) == (3, 1)  # normal glucose


def test_the_policy_is_optimal_for_the_plan(run: tuple[str, Arrays]) -> None:
    what, arrays = run
    problem = Problem.finite(STATES, ACTIONS, WINDOW, (SEED,), episodic=True)
    steps = (torch.from_numpy(arrays[f"windows/{part}"]).long() for part in ("states", "actions", "next_states"))
    model = ObservedCounts() if what == "pairs" else FactoredMixture(pseudo_counts=50.0)
    model.start(problem)
    model.observe(Windows.of_grid(*(part.unsqueeze(0) for part in steps), torch.zeros(1, COUNT)))
    value, plan = np.zeros(STATES), arrays["reward/plan"]
    for step in reversed(range(WINDOW)):
        later = value if what == "pairs" else value + plan[step]
        ahead = model.backup(torch.from_numpy(later)[None])[0].numpy() + (plan if what == "pairs" else 0)
        value = ahead.max(1)
        assert (value - ahead[np.arange(STATES), arrays["policy"][step]]).max() < 1e-8


def test_a_continuing_problem_says_its_cells_and_has_no_axes(tmp_path: Path) -> None:
    result = credit.run(["method=reference", "tracking=none", f"output={tmp_path}", "replicas=1", "trainer.steps=70"])
    arrays = credit.load(result.folders[0]).recovery
    assert arrays is not None
    assert list(arrays["cells"]) == ["state", "action"]
    assert not [name for name in arrays if name.startswith("axis/")]
    np.testing.assert_array_equal(arrays["windows/states"][:, 1:], arrays["windows/next_states"][:, :-1])
