"""Equations (9)–(19) put together, with two models whose predictions are given."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import pytest
import torch

from credit.bench import naive
from credit.core.belief import Belief, Estimate
from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.seams import Mixer, Places
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.windows import Windows
from credit.recovery.bonuses import Count, Disagreement, LocalMSE
from credit.recovery.features.tabular import Bilinear, Identity, Threshold
from credit.recovery.mixers import RelativeMSE, Stacking
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.ridge import RidgeModel
from credit.recovery.models.table import TableModel
from credit.recovery.proxies import spread
from credit.recovery.recovery import Recovery
from credit.recovery.scaler import Standard
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap

Make = Callable[..., Problem]
MakeWindows = Callable[..., Windows]


def tensor(values: Any) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


class Fixed(RidgeModel):
    """Predicts what it is told, whatever it sees."""

    def __init__(self, name: str, mean: list[float], draws: list[list[float]], uncertainty: Bootstrap) -> None:
        self.name, self.uncertainty = name, uncertainty
        told = tensor([draws])
        self._estimate = Estimate(tensor([mean]), spread(told), told)

    def start(self, problem: Problem, places: Places) -> None: ...

    def observe(self, store: Store) -> None: ...

    def estimate(self, at: torch.Tensor | None = None) -> Estimate:
        return self._estimate

    def believe(self, steps: Steps) -> Estimate:
        return self._estimate

    def leverage(self) -> torch.Tensor:
        raise NotImplementedError


def recover(problem: Problem, bonus: Any, **bootstrap: Any) -> Recovery:
    """One state, two actions; three visits to action 0."""
    shared = Bootstrap(2, **bootstrap)
    reference = Fixed("ridge", [2.5, 1.0], [[1.0, 0.0], [3.0, 2.0]], shared)
    surrogate = Fixed("linear", [1.5, 3.0], [[2.0, 0.0], [2.0, 1.0]], shared)
    recovery = Recovery(reference, {"linear": surrogate}, RelativeMSE(alpha=0.5), bonus)
    recovery.start(problem)
    store = Store(problem)
    store.append(Windows.of_grid(*(torch.zeros(1, 1, 3, dtype=torch.int64) for _ in range(3)), tensor([[1.0]])))
    recovery.observe(store)
    return recovery


def believed(recovery: Recovery) -> Belief:
    found = recovery.belief()
    assert found is not None
    return found


def observed(recovery: Recovery, problem: Problem, *pieces: Windows) -> Store:
    """The store of a recovery that has seen windows piece by piece."""
    store = Store(problem)
    recovery.start(problem)
    for piece in pieces:
        store.append(piece)
        recovery.observe(store)
    return store


def test_every_equation_by_hand(make_problem: Make) -> None:
    problem = make_problem((0,), states=1, actions=2, window=3)
    both = {"count": Count(0.35, 1.0), "local_mse": LocalMSE(1.0, 1.0), "disagreement": Disagreement(1.0, 1.0)}
    found = believed(recover(problem, both))
    # Pair 0: reference draws 1, 3: variance 1. Surrogate draws 2, 2: variance 0, Δ̂² = (1 + 1)/2 = 1, MSE 0 + 1 = 1.
    # Pair 1: reference draws 0, 2: variance 1. Surrogate draws 0, 1: variance .25, Δ̂² = (0 + 1)/2, MSE .25 + .5 = .75.
    torch.testing.assert_close(found.disagreement, tensor([[[1.0, 0.5]]]))
    torch.testing.assert_close(found.mse, tensor([[[1.0, 1.0], [1.0, 0.75]]]))
    # Pair 0 is a tie, which the reference wins (16), and the weights are equal. Pair 1: the surrogate is best;
    # scale (1 + .75)/2 = .875, δ = .25/.875 = 2/7, exponent (2/7)/.5 = 4/7.
    assert found.best.tolist() == [[0, 1]]
    weight = math.exp(-4 / 7) / (1 + math.exp(-4 / 7))
    torch.testing.assert_close(found.weights, tensor([[[0.5, weight], [0.5, 1 - weight]]]))
    mixed = [0.5 * 2.5 + 0.5 * 1.5, weight * 1.0 + (1 - weight) * 3.0]
    torch.testing.assert_close(found.mixed, tensor([mixed]))
    # N = (3, 0), λ = 1: decay 1/2, 1
    assert found.visits.tolist() == [[3, 0]]
    torch.testing.assert_close(found.bonus["count"], tensor([[0.175, 0.35]]))
    torch.testing.assert_close(found.bonus["local_mse"], tensor([[1 / 2, math.sqrt(0.75)]]))
    torch.testing.assert_close(found.bonus["disagreement"], tensor([[1 / 2, math.sqrt(0.5)]]))
    plan = [mixed[0] + 0.175 + 0.5 + 0.5, mixed[1] + 0.35 + math.sqrt(0.75) + math.sqrt(0.5)]
    torch.testing.assert_close(found.plan, tensor([plan]))
    assert found.models == ("ridge", "linear")


def test_without_bonuses_the_plan_is_the_mixed_reward(make_problem: Make) -> None:
    found = believed(recover(make_problem((0,), states=1, actions=2, window=3), {}))
    assert torch.equal(found.plan, found.mixed)
    assert found.bonus == {}


def test_the_prior_variance_is_the_references_alone(make_problem: Make) -> None:
    problem = make_problem((0,), states=1, actions=2, window=3)
    plain = believed(recover(problem, {}))
    prior = believed(recover(problem, {}, prior_variance=0.5, prior_count=1.0))
    torch.testing.assert_close(prior.mse[:, 0] - plain.mse[:, 0], tensor([[0.5 / 4, 0.5]]))
    assert torch.equal(prior.mse[:, 1], plain.mse[:, 1])


def test_rewards_are_the_plan_at_every_step(make_problem: Make) -> None:
    problem = make_problem((0,), states=1, actions=2, window=3)
    recovery = recover(problem, {"count": Count()})
    zeros = torch.zeros(1, 1, 3, dtype=torch.int64)
    rewards = recovery.rewards(Windows.of_grid(zeros, torch.tensor([[[1, 0, 1]]]), zeros, tensor([[0.0]])))
    plan = believed(recovery).plan[0].tolist()
    assert rewards.tolist() == [[plan[1], plan[0], plan[1]]]
    table = recovery.table()
    assert table is not None
    assert table[0] == problem.cells
    assert torch.equal(table[1], believed(recovery).plan)
    assert torch.equal(table[2], believed(recovery).mixed)


def test_what_is_believed_of_other_steps_is_what_is_believed_of_their_cells(
    make_problem: Make, make_windows: MakeWindows
) -> None:
    problem, at = make_problem((0, 1)), torch.tensor([29, 3, 3, 0])
    for recovery in mixtures():
        recovery.bonus |= {"count": Count(), "mse": LocalMSE()}
        windows = observed(recovery, problem, make_windows(problem, 8)).windows
        found = recovery.believe(Steps(at // 3, at % 3, at * 0, at * 0))
        whole = believed(recovery)
        for name in ("mean", "mse", "disagreement", "weights", "best", "mixed", "plan", "visits"):
            torch.testing.assert_close(getattr(found, name), getattr(whole, name)[..., at], msg=name)
        for name, bonus in whole.bonus.items():
            torch.testing.assert_close(found.bonus[name], bonus[:, at])
        assert found.cells is found.column is found.valid is None
        everywhere = problem.cells.steps(problem.device)
        torch.testing.assert_close(recovery.believe(everywhere).plan, whole.plan)
        assert torch.equal(recovery.rewards(windows), whole.plan.gather(1, problem.cells.index(windows)))


def test_models_of_one_name_are_refused() -> None:
    twice = [Fixed("ridge", [0.0], [[0.0]], Bootstrap(1)) for _ in range(2)]
    with pytest.raises(UserError, match=r"different names.*'ridge'.*'ridge'"):
        Recovery(twice[0], {"other": twice[1]}, RelativeMSE(), {})


def test_a_model_that_looks_at_the_step_needs_windows_that_start_anew(make_problem: Make) -> None:
    model = LinearModel("timed", Identity(("step", "state")), Bootstrap(1))
    with pytest.raises(UserError, match="looks at the step in the window, and windows follow each other here"):
        Recovery(model, {}, RelativeMSE(), {}).start(make_problem())


def two(first: Any, second: Any, mixer: Mixer) -> Recovery:
    """A reference and a surrogate with these uncertainties."""
    return Recovery(
        LinearModel("ridge", Identity(), first), {"linear": LinearModel("linear", Bilinear(), second)}, mixer, {}
    )


def test_uncertainties_that_do_not_go_together_are_refused(make_problem: Make) -> None:
    with pytest.raises(UserError, match=r"draw by draw.*ridge: 3, linear: 5.*same number"):
        two(Bootstrap(3), Bootstrap(5), RelativeMSE()).start(make_problem())
    shared = Bootstrap(3)
    two(shared, shared, Stacking()).start(make_problem())
    for first, second in ((shared, Analytic(0.1)), (Bootstrap(3), Bootstrap(3)), (Analytic(0.1), shared)):
        with pytest.raises(UserError, match=r"Stacking weighs models by labels that a common Bootstrap held out"):
            two(first, second, Stacking()).start(make_problem())


@pytest.mark.parametrize("drawn", ["reference", "surrogate"])
def test_where_one_of_two_has_no_draws_the_gap_is_that_of_the_fits(
    make_problem: Make, make_windows: MakeWindows, drawn: str
) -> None:
    problem, parts = make_problem((0, 1)), (Bootstrap(3), Analytic(0.1))
    recovery = two(*(parts if drawn == "reference" else parts[::-1]), RelativeMSE())
    observed(recovery, problem, make_windows(problem, 20))
    found = believed(recovery)
    torch.testing.assert_close(found.disagreement[:, 0], (found.mean[:, 0] - found.mean[:, 1]).square())
    assert (found.disagreement > 0).any()


def test_a_planner_is_given_the_scaled_rewards(make_problem: Make, make_windows: MakeWindows) -> None:
    problem, recovery = make_problem((0, 1)), full(3)
    recovery.scaler = Standard()
    windows = make_windows(problem, 20)
    observed(recovery, problem, windows)
    table, belief = recovery.table(), believed(recovery)
    assert table is not None
    cells, plan, mixed = table
    assert torch.equal(recovery.rewards(windows), plan.gather(1, cells.index(windows)))
    for replica in range(2):
        scaled, unit = Standard()(belief.mixed[replica])
        assert torch.equal(mixed[replica], scaled)
        torch.testing.assert_close(
            plan[replica], scaled + sum(bonus[replica] for bonus in belief.bonus.values()) / unit
        )


class Running(Standard):
    """Counts how often it was asked."""

    keeps: ClassVar = ("asked",)

    def __init__(self) -> None:
        super().__init__()
        self.asked = 0

    def __call__(self, rewards: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        self.asked += 1
        return super().__call__(rewards)


def test_a_scaler_with_a_state_goes_on_with_it(make_problem: Make, make_windows: MakeWindows) -> None:
    problem, recovery, other = make_problem((0, 1)), full(3), full(3)
    recovery.scaler, other.scaler = Running(), Running()
    observed(recovery, problem, make_windows(problem, 20))
    other.start(problem)
    other.load_state_dict(recovery.state_dict())
    assert other.scaler.asked == 2


def full(draws: int, shared: bool = True, **bootstrap: Any) -> Recovery:
    one = Bootstrap(draws, **bootstrap)

    def own() -> Bootstrap:
        return one if shared else Bootstrap(draws, **bootstrap)

    return Recovery(
        LinearModel("ridge", Identity(), own(), 0.1),
        {
            "linear": LinearModel("linear", Bilinear(), own(), 0.1),
            "threshold": LinearModel("threshold", Threshold(), own(), 0.1),
        },
        RelativeMSE(0.5),
        {"count": Count(), "disagreement": Disagreement()},
    )


def test_before_any_window_all_is_zero_but_the_count_bonus(make_problem: Make) -> None:
    recovery = full(4)
    recovery.start(make_problem((0, 1)))
    found = believed(recovery)
    assert (found.mse == 0).all()
    assert (found.best == 0).all()
    torch.testing.assert_close(found.weights, torch.full_like(found.weights, 1 / 3))
    torch.testing.assert_close(found.plan, torch.full_like(found.plan, 0.35))


def test_a_belief_stays_as_it_was(make_problem: Make, make_windows: MakeWindows) -> None:
    problem = make_problem((0,))
    recovery, store = full(3), Store(problem)
    recovery.start(problem)
    before = believed(recovery)
    store.append(make_windows(problem, 2))
    recovery.observe(store)
    assert (before.visits == 0).all()  # type: ignore[union-attr]
    assert (before.mixed == 0).all()
    assert believed(recovery).mixed.abs().max() > 0


def test_visits_count_every_step_once(make_problem: Make, make_windows: MakeWindows) -> None:
    problem, recovery = make_problem((0, 1)), full(2)
    store = observed(recovery, problem, *(make_windows(problem, 2, seed=seed) for seed in range(3)))
    expected = torch.stack([row.bincount(minlength=30) for row in store.windows.pairs(3)]).double()
    found = believed(recovery).visits
    assert found is not None
    assert torch.equal(found, expected)
    assert expected.sum() == 2 * 6 * 7


@pytest.mark.parametrize("resample", ["poisson", "exact"])
def test_an_uncertainty_of_their_own_gives_models_what_a_shared_one_does(
    make_problem: Make, make_windows: MakeWindows, resample: str
) -> None:
    problem, found = make_problem((0, 1)), []
    for shared in (True, False):
        recovery = full(5, shared, resample=resample)
        observed(recovery, problem, *(make_windows(problem, 3, seed=seed) for seed in range(4)))
        found.append(believed(recovery))
    for name in ("mean", "mse", "disagreement", "weights", "plan"):
        assert torch.equal(getattr(found[0], name), getattr(found[1], name)), name


def mixtures() -> list[Recovery]:
    """Recoveries of every kind of table model, uncertainty and mixer."""
    exact, shared, stacked = Bootstrap(4, resample="exact"), Bootstrap(4), Bootstrap(4)
    return [
        full(4),
        Recovery(TableModel(shared), {"l": LinearModel("linear", Bilinear(), shared)}, RelativeMSE(), {}),
        Recovery(TableModel(exact), {"l": LinearModel("linear", Bilinear(), exact)}, RelativeMSE(), {}),
        Recovery(LinearModel("r", Identity(), stacked), {"l": LinearModel("l", Bilinear(), stacked)}, Stacking(), {}),
        Recovery(LinearModel("ridge", Identity(), Analytic(None)), {}, RelativeMSE(), {"mse": LocalMSE()}),
    ]


@pytest.mark.parametrize("number", range(5))
@pytest.mark.parametrize("first", [True, False])
def test_a_round_without_windows_changes_nothing(
    make_problem: Make, make_windows: MakeWindows, number: int, first: bool
) -> None:
    problem, recovery = make_problem((0, 1)), mixtures()[number]
    windows, none = make_windows(problem, 8), make_windows(problem, 0)
    store = observed(recovery, problem, *([none] if first else [windows]))
    before = believed(recovery).plan
    store.append(none)
    recovery.observe(store)
    assert recovery.rewards(none).shape == (2, 0)
    if number != 2:  # which resamples all windows anew
        torch.testing.assert_close(believed(recovery).plan, before, atol=1e-6, rtol=0)
    if first:
        store.append(windows)
        recovery.observe(store)
        assert (believed(recovery).plan - before).abs().max() > 0.01
        alone = mixtures()[number]
        observed(alone, problem, windows)
        torch.testing.assert_close(believed(recovery).plan, believed(alone).plan, atol=1e-6, rtol=0)


def test_fits_and_weights_equal_the_second_implementation(make_problem: Make, make_windows: MakeWindows) -> None:
    problem, recovery = make_problem((0,)), full(20)
    windows = observed(recovery, problem, make_windows(problem, 60, seed=5)).windows
    found = believed(recovery)
    states, actions, labels = numpy(windows)
    fitted, _, _ = naive.proxies(states, actions, labels, 1, np.random.default_rng(0))
    for index, name in enumerate(found.models):
        np.testing.assert_allclose(found.mean[0, index].view(10, 3), fitted[name], atol=1e-9)
    weights = naive.weights({name: found.mse[0, j].numpy() for j, name in enumerate(found.models)})
    np.testing.assert_allclose(found.weights[0], np.stack(list(weights.values())), atol=1e-12)


def numpy(windows: Windows) -> tuple[np.ndarray, ...]:
    """States and actions [K, T] and labels [K] of the first replica."""
    return *(windows.grid(x)[0].numpy() for x in (windows.states, windows.actions)), windows.labels[0].numpy()


@pytest.mark.parametrize("resample", ["poisson", "exact"])
def test_proxies_agree_with_the_second_implementation(
    make_problem: Make, make_windows: MakeWindows, resample: str
) -> None:
    # 1,000 draws each: a ratio of variances has a standard error of √(4/1000) = 6.3% a pair. Poisson weights scatter a
    # little more, by O(1/K), K = 400. The 30 pairs share draws, so their median ratio is allowed the error of one pair.
    problem, recovery = make_problem((0,)), full(1000, resample=resample)
    windows = observed(recovery, problem, make_windows(problem, 400, seed=6)).windows
    found = believed(recovery)
    states, actions, labels = numpy(windows)
    _, mse, gaps = naive.proxies(states, actions, labels, 1000, np.random.default_rng(1), cache=True)
    for index, name in enumerate(found.models):
        ratio = found.mse[0, index].view(10, 3).numpy() / mse[name]
        assert abs(np.median(ratio) - 1) < 0.13, (name, np.median(ratio))
        assert abs(ratio - 1).max() < 0.4
        if index:
            ratio = found.disagreement[0, index - 1].view(10, 3).numpy() / gaps[name]
            assert abs(np.median(ratio) - 1) < 0.13, (name, np.median(ratio))


class Poles(Bilinear):
    """Is not finite in state 3."""

    def __call__(self, steps: Steps) -> torch.Tensor:
        return super().__call__(steps) / (steps.states != 3).unsqueeze(-1)


def test_a_table_with_features_that_are_not_finite_is_refused(make_problem: Make, make_windows: MakeWindows) -> None:
    problem, shared = make_problem((5, 6)), Bootstrap(3)
    models = {"mine": LinearModel("mine", Poles(), shared)}
    recovery = Recovery(LinearModel("ridge", Identity(), shared), models, RelativeMSE(), {})
    with pytest.raises(
        RunError, match=r"reward model 'mine' is nan at cell \d+ of \(state, action\) of seed 5.* features"
    ):
        observed(recovery, problem, make_windows(problem, 9))
