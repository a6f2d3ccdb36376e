"""Recovery of steps with models that are known: equations (10)–(16), (33), (34) by hand and by loops over rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from statistics import median

import pytest
import torch
from credit.core.continuous import Scaler, StepModel
from credit.core.interfaces import Bonus, FeatureMap, Mixer
from credit.core.trajectories import ContinuousProblem, Moves, Trajectories, TrajectoryDataset
from credit.recovery.step_recovery import StepRecovery
from torch import Tensor

from credit.core.errors import UserError
from credit.recovery.bonuses import Disagreement, LocalMSE
from credit.recovery.mixers import ReferenceOnly, RelativeMSE
from credit.recovery.mixers import Uniform as EqualWeights

MakeProblem = Callable[..., ContinuousProblem]
Make = Callable[..., Trajectories]


class Looks(FeatureMap):
    """State and action of a step, and how many rows it was asked for at once."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def start(self, problem: ContinuousProblem) -> None: ...

    def __call__(self, steps: Moves) -> Tensor:  # type: ignore[override]
        self.asked.append(len(steps))
        return torch.cat([steps.states, steps.actions], -1)


class Fixed(StepModel):
    """Mean `slope`·x + `shift` times the mean label of the replica; variance `spread`·vx²."""

    def __init__(self, name: str, slope: float = 1.0, shift: float = 0.0, spread: float = 1.0) -> None:
        self.name, self.features = name, Looks()
        self._slope, self._shift, self._spread = slope, shift, spread
        self.fitted: list[Tensor] = []

    def start(self, problem: ContinuousProblem) -> None:
        self._level = problem.zeros().float()

    def fit(self, inputs: Tensor, trajectories: Trajectories) -> None:
        self.fitted.append(inputs)
        self._level = trajectories.labels.mean(1).float()

    def predict(self, inputs: Tensor, moves: Moves) -> tuple[Tensor, Tensor]:
        mean = self._slope * inputs[:, 0] + self._shift * self._level[moves.replica]
        return mean, self._spread * inputs[:, 2].square()


class Centred(Scaler):
    """Minus the mean, and what it was shown."""

    def __init__(self) -> None:
        self.shown: list[Tensor] = []

    def __call__(self, rewards: Tensor) -> Tensor:
        self.shown.append(rewards)
        return rewards - rewards.mean()


def models() -> list[Fixed]:
    """Each is best somewhere: their proxies are vx², .4·vx² + (.2·x − .3·level)² and .1·vx² + (1.5·x)²."""
    return [Fixed("reference"), Fixed("near", 0.8, 0.3, 0.4), Fixed("far", -0.5, 0.0, 0.1)]


def recovery_of(
    fixed: Sequence[Fixed], mixer: Mixer, bonus: Mapping[str, Bonus] = {}, scaler: Scaler | None = None
) -> StepRecovery:
    reference, *surrogates = fixed
    return StepRecovery(reference, {model.name: model for model in surrogates}, mixer, bonus, scaler)


def bonuses() -> dict[str, Bonus]:
    return {"mse": LocalMSE(0.5, None), "gap": Disagreement(2.0, None)}


def seen(
    make_continuous: MakeProblem, make: Make, assigner: StepRecovery, seeds: tuple[int, ...] = (0, 1)
) -> TrajectoryDataset:
    """Two rounds; what a seed has in them depends on the seed alone."""
    problem = make_continuous(seeds)
    dataset = TrajectoryDataset(problem)
    assigner.start(problem)
    for number, first in enumerate(([5, 9], [2, 8])):
        lengths = [[steps + seed for steps in first] for seed in seeds]
        labels = [[1.0, float(seed)] for seed in seeds]
        dataset.append(make(lengths, labels, seeds, first=10 * number))
        assigner.observe(dataset)
    return dataset


def test_every_row_by_hand(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    alpha = 0.3
    assigner = recovery_of(models(), RelativeMSE(alpha), bonuses())
    windows = seen(make_continuous, make_trajectories, assigner).windows
    belief, level = assigner.recovery(), windows.labels.mean(1)
    assert belief.models == ("reference", "near", "far")
    assert belief.mean.shape == belief.mse.shape == belief.weights.shape == (1, 3, len(windows))
    assert belief.disagreement.shape == (1, 2, len(windows))
    chosen = set()
    for row in range(len(windows)):
        x, _, v, _ = windows.states[row].tolist()
        means = [x, 0.8 * x + 0.3 * float(level[windows.replica[row]]), -0.5 * x]
        gaps = [(means[0] - mean) ** 2 for mean in means[1:]]
        mse = [v * v, 0.4 * v * v + gaps[0], 0.1 * v * v + gaps[1]]
        scale, least = max(median(mse), 1e-12), min(mse)
        raw = [torch.tensor(-(value - least) / (alpha * scale)).exp().item() for value in mse]
        weights = [value / sum(raw) for value in raw]
        best = mse.index(least)
        local, signal = least**0.5, ([mse[0], *gaps][best]) ** 0.5
        mixed = sum(weight * mean for weight, mean in zip(weights, means, strict=True))
        expected = {
            "mean": means,
            "mse": mse,
            "disagreement": gaps,
            "weights": weights,
            "best": best,
            "mixed": mixed,
            "plan": mixed + 0.5 * local + 2 * signal,
        }
        for name, value in expected.items():
            assert getattr(belief, name)[0, ..., row].tolist() == pytest.approx(value, rel=1e-4, abs=1e-5), name
        assert belief.bonus["mse"][0, row].item() == pytest.approx(0.5 * local, rel=1e-4)  # (33)
        assert belief.bonus["gap"][0, row].item() == pytest.approx(2 * signal, rel=1e-4, abs=1e-5)  # (34)
        chosen.add(best)
    assert chosen == {0, 1, 2}
    assert torch.equal(belief.replica, windows.replica)
    assert torch.equal(assigner.rewards(windows), belief.plan[0])  # without a scaler


def test_the_reference_alone(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    assigner = recovery_of([Fixed("alone")], ReferenceOnly(), {"gap": Disagreement(1.0, None)})
    windows = seen(make_continuous, make_trajectories, assigner).windows
    belief = assigner.recovery()
    assert belief.disagreement.shape == (1, 0, len(windows))
    assert (belief.weights == 1).all()
    torch.testing.assert_close(belief.plan[0], windows.states[:, 0] + windows.states[:, 2].abs())


def test_features_are_computed_once_a_row(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    fixed = models()
    assigner = recovery_of(fixed, EqualWeights())
    windows = seen(make_continuous, make_trajectories, assigner).windows
    rows = torch.cat([windows.states, windows.actions], -1)
    for model in fixed:
        assert model.features.asked == [30, 22]  # type: ignore[attr-defined]  # the rows of either round
        assert [len(inputs) for inputs in model.fitted] == [30, 52]
        assert torch.equal(model.fitted[-1], rows)


def test_a_scaler_sees_one_replica_at_a_time(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    scaler = Centred()
    assigner = recovery_of(models(), EqualWeights(), bonuses(), scaler)
    windows = seen(make_continuous, make_trajectories, assigner).windows
    plan = assigner.recovery().plan[0]
    for r, shown in enumerate(scaler.shown[-2:]):
        own = windows.replica == r
        assert torch.equal(shown, plan[own])
        assert torch.equal(assigner.rewards(windows)[own], plan[own] - plan[own].mean())


def test_a_replica_is_recovered_alone_as_in_a_batch(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    def made(*seeds: int) -> tuple[StepRecovery, Trajectories]:
        assigner = recovery_of(models(), RelativeMSE(0.3), bonuses(), Centred())
        return assigner, seen(make_continuous, make_trajectories, assigner, seeds).windows

    batch, together = made(2, 0, 3)
    for r, seed in enumerate((2, 0, 3)):
        alone, single = made(seed)
        mine = together.replica == r
        assert torch.equal(single.states, together.states[mine])
        torch.testing.assert_close(alone.rewards(single), batch.rewards(together)[mine], rtol=0, atol=1e-5)
        for name in ("mean", "mse", "disagreement", "weights", "best", "mixed", "plan"):
            torch.testing.assert_close(getattr(alone.recovery(), name), getattr(batch.recovery().of(r), name), msg=name)
        assert batch.recovery().of(r).bonus.keys() == {"mse", "gap"}
        torch.testing.assert_close(alone.recovery().bonus["gap"], batch.recovery().of(r).bonus["gap"])


def test_what_is_believed_of_other_steps(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    assigner = recovery_of(models(), RelativeMSE(0.3), bonuses(), Centred())
    windows = seen(make_continuous, make_trajectories, assigner).windows
    order = torch.randperm(len(windows), generator=torch.Generator().manual_seed(0))
    states, actions, arrivals = (part[order] for part in (windows.states, windows.actions, windows.next_states))
    grid = assigner.believe(Moves(states, actions, arrivals, windows.replica[order]))
    assert torch.equal(grid.plan, assigner.recovery().plan[:, order])
    assert torch.equal(grid.replica, windows.replica[order])
    swapped = assigner.believe(Moves(states, actions, arrivals, 1 - windows.replica[order]))
    assert torch.equal(swapped.mean[0, 0], grid.mean[0, 0])
    assert (swapped.mean[0, 1] != grid.mean[0, 1]).all()  # by the fit of the other replica
    assert len(assigner.rewards(windows)) == len(windows)  # nothing was kept of them


def test_rewards_of_unseen_steps_are_refused(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    assigner = recovery_of(models(), EqualWeights())
    dataset = seen(make_continuous, make_trajectories, assigner)
    dataset.append(make_trajectories([[3], [4]], [[0.0], [1.0]]))
    with pytest.raises(ValueError, match="rewards of 59 steps are asked for, and 52 were seen"):
        assigner.rewards(dataset.windows)


def test_rows_that_were_seen_stay(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    fixed = Fixed("reference")
    assigner, problem = recovery_of([fixed], ReferenceOnly()), make_continuous((0,))
    dataset = TrajectoryDataset(problem)
    assigner.start(problem)
    for number in range(6):
        dataset.append(make_trajectories([[1 + 3 * number]], [[1.0]], first=number))
        assigner.observe(dataset)
    for before, after in pairwise(fixed.fitted):
        assert torch.equal(after[: len(before)], before)


def test_names_must_differ() -> None:
    with pytest.raises(UserError, match="reward models need different names"):
        StepRecovery(Fixed("same"), {"other": Fixed("same")}, EqualWeights(), {})
