"""Recovery of steps with models that are known: equations (10)–(16), (33), (34) by hand and by loops over rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from statistics import median
from typing import Any

import pytest
import torch
from torch import Tensor

from credit.core.belief import Belief, Estimate
from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Bonus, FeatureMap, Look, Mixer, Places, Relabel, RewardModel, Scaler
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.windows import Windows
from credit.recovery.bonuses import Disagreement, Elliptical, LocalMSE, Thompson
from credit.recovery.features.motion import Motion
from credit.recovery.mixers import ReferenceOnly, RelativeMSE, Stacking
from credit.recovery.mixers import Uniform as EqualWeights
from credit.recovery.models.linear import LinearModel
from credit.recovery.models.neural import NeuralModel
from credit.recovery.models.primitive import PrimitiveReward
from credit.recovery.recovery import Recovery
from credit.recovery.scaler import RootMeanSquare, Standard
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap
from credit.recovery.uncertainty.networks import LastLayer

from .fits import first

LENGTHS = [[[5, 3, 4], [2, 4, 6]], [[1, 2, 3], [2, 2, 3]], [[6, 1], [2, 4]]]
MakeProblem = Callable[..., Problem]
Make = Callable[..., Windows]


def blocks(packed: Any, where: str = "") -> Iterator[tuple[str, Tensor]]:
    """Every tensor of a state, and where it is."""
    if isinstance(packed, Tensor):
        yield where, packed
    elif isinstance(packed, (Mapping, list)):
        pairs = packed.items() if isinstance(packed, Mapping) else enumerate(packed)
        for key, inner in pairs:
            yield from blocks(inner, f"{where}.{key}")


class Looks(FeatureMap):
    """State and action of a step, and how many rows it was asked for at once."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def start(self, problem: Problem) -> None: ...

    def __call__(self, steps: Steps) -> Tensor:
        self.asked.append(steps.states.shape[-2])
        return torch.cat([steps.states, steps.actions], -1)


class Fixed(RewardModel):
    """Mean `slope`·x + `shift` times the mean label of the replica; variance `spread`·vx²."""

    def __init__(self, name: str, slope: float = 1.0, shift: float = 0.0, spread: float = 1.0) -> None:
        self.name, self.features = name, Looks()
        self._slope, self._shift, self._spread = slope, shift, spread
        self.fitted: list[Tensor] = []

    def start(self, problem: Problem, places: Places) -> None:
        self._level = problem.zeros().float()
        self._look: Look = places.look(self.features)

    def observe(self, store: Store) -> None:
        self.fitted.append(self._look.rows(store.windows, newest=False).clone())
        self._level = store.windows.labels.mean(1).float()

    def estimate(self, at: Tensor | None = None) -> Estimate:
        return self._predict(self._look.places(at))

    def believe(self, steps: Steps) -> Estimate:
        return self._predict(self.features(steps).expand(len(self._level), -1, -1))

    def _predict(self, phi: Tensor) -> Estimate:
        mean = self._slope * phi[..., 0] + self._shift * self._level.unsqueeze(1)
        return Estimate(mean, self._spread * phi[..., 2].square())


class Centred(Scaler):
    """Minus the mean, in a unit of a quarter, and what it was shown."""

    def __init__(self) -> None:
        self.shown: list[Tensor] = []

    def __call__(self, rewards: Tensor) -> tuple[Tensor, Tensor]:
        self.shown.append(rewards)
        return (rewards - rewards.mean()) / 0.25, torch.tensor(0.25)


def models() -> list[Fixed]:
    """Each is best somewhere: their proxies are vx², .4·vx² + (.2·x − .3·level)² and .1·vx² + (1.5·x)²."""
    return [Fixed("reference"), Fixed("near", 0.8, 0.3, 0.4), Fixed("far", -0.5, 0.0, 0.1)]


def recovery_of(
    fixed: Sequence[RewardModel], mixer: Mixer, bonus: Mapping[str, Bonus] = {}, scaler: Scaler | None = None
) -> Recovery:
    reference, *surrogates = fixed
    return Recovery(reference, {model.name: model for model in surrogates}, mixer, bonus, scaler)


def bonuses() -> dict[str, Bonus]:
    return {"mse": LocalMSE(0.5, None), "gap": Disagreement(2.0, None)}


def seen(make_continuous: MakeProblem, make: Make, assigner: Recovery, seeds: tuple[int, ...] = (0, 1)) -> Store:
    """Two rounds; what a seed has in them depends on the seed alone: 24 rows of seed 0, 28 of seed 1."""
    problem = make_continuous(seeds, window=150)
    store = Store(problem)
    assigner.start(problem)
    for number, shortest in enumerate(([5, 9], [2, 8])):
        lengths = [[steps + seed for steps in shortest] for seed in seeds]
        labels = [[1.0, float(seed)] for seed in seeds]
        store.append(make(lengths, labels, seeds, first=10 * number))
        assigner.observe(store)
    return store


def believed(assigner: Recovery) -> Belief:
    found = assigner.belief()
    assert found is not None
    return found


def rows_of(windows: Windows, replica: int) -> int:
    return len(windows) if windows.count is None else int(windows.count[replica])


def test_every_row_by_hand(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    alpha = 0.3
    assigner = recovery_of(models(), RelativeMSE(alpha), bonuses())
    windows = seen(make_continuous, make_trajectories, assigner).windows
    belief, level = believed(assigner), windows.labels.mean(1)
    assert belief.models == ("reference", "near", "far")
    assert belief.mean.shape == belief.mse.shape == belief.weights.shape == (2, 3, len(windows))
    assert belief.disagreement.shape == (2, 2, len(windows))
    assert belief.cells is belief.visits is belief.column is None
    assert assigner.table() is None
    rewards, chosen = assigner.rewards(windows), set()
    for replica in range(2):
        for row in range(rows_of(windows, replica)):
            x, _, v, _ = windows.states[replica, row].tolist()
            means = [x, 0.8 * x + 0.3 * float(level[replica]), -0.5 * x]
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
                found = getattr(belief, name)[replica, ..., row].tolist()
                assert found == pytest.approx(value, rel=1e-4, abs=1e-5), name
            assert belief.bonus["mse"][replica, row].item() == pytest.approx(0.5 * local, rel=1e-4)  # (33)
            assert belief.bonus["gap"][replica, row].item() == pytest.approx(2 * signal, rel=1e-4, abs=1e-5)  # (34)
            assert rewards[replica, row] == belief.plan[replica, row]  # without a scaler
            chosen.add(best)
    assert chosen == {0, 1, 2}
    assert belief.valid is not None
    assert belief.valid.sum(1).tolist() == [rows_of(windows, replica) for replica in range(2)] == [24, 28]


def test_the_reference_alone(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    assigner = recovery_of([Fixed("alone")], ReferenceOnly(), {"gap": Disagreement(1.0, None)})
    windows = seen(make_continuous, make_trajectories, assigner).windows
    belief = believed(assigner)
    assert belief.disagreement.shape == (2, 0, len(windows))
    assert (belief.weights == 1).all()
    torch.testing.assert_close(belief.plan, windows.states[..., 0] + windows.states[..., 2].abs())


def test_features_are_computed_once_a_row(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    fixed = models()
    assigner = recovery_of(fixed, EqualWeights())
    windows = seen(make_continuous, make_trajectories, assigner).windows
    rows = torch.cat([windows.states, windows.actions], -1)
    for model in fixed:
        assert model.features.asked == [16, 12]  # the rows of either round
        assert [inputs.shape[1] for inputs in model.fitted] == [16, 28]
        assert torch.equal(model.fitted[-1], rows)


def test_a_scaler_sees_one_replica_at_a_time_and_no_bonus(
    make_continuous: MakeProblem, make_trajectories: Make
) -> None:
    scaler = Centred()
    assigner = recovery_of(models(), EqualWeights(), bonuses(), scaler)
    windows = seen(make_continuous, make_trajectories, assigner).windows
    belief, rewards = believed(assigner), assigner.rewards(windows)
    for r, shown in enumerate(scaler.shown[-2:]):
        own = slice(rows_of(windows, r))
        assert torch.equal(shown, belief.mixed[r, own])
        optimism = belief.bonus["mse"][r, own] + belief.bonus["gap"][r, own]
        torch.testing.assert_close(rewards[r, own], (shown - shown.mean() + optimism) / 0.25)
    assert (rewards[0, 24:] == 0).all()


@pytest.mark.parametrize("clip", [0.1, 1.0])
@pytest.mark.parametrize("quantile", [0.99, 0.5, None])
def test_a_clip_never_touches_optimism(
    make_continuous: MakeProblem, make_trajectories: Make, clip: float, quantile: float | None
) -> None:
    problem = make_continuous((0, 1), window=150)
    found = {}
    for name, bonus in (("with", bonuses()), ("without", {})):
        assigner, store = recovery_of(models(), RelativeMSE(0.3), bonus, Standard(clip, quantile)), Store(problem)
        assigner.start(problem)
        for number in range(4):
            store.append(make_trajectories([[150, 100], [120, 130]], [[1.0, 0.0], [0.0, 1.0]], first=10 * number))
            assigner.observe(store)
        found[name] = assigner.rewards(store.windows), believed(assigner)
    belief = found["with"][1]
    optimism = torch.stack(list(belief.bonus.values())).sum(0)
    survived = found["with"][0] - found["without"][0]
    for replica in range(2):
        unit = belief.mixed[replica].std(correction=0)
        largest = optimism[replica].topk(10).indices  # 1% of a thousand rows
        torch.testing.assert_close(survived[replica, largest] * unit, optimism[replica, largest])
        torch.testing.assert_close(survived[replica] * unit, optimism[replica], rtol=1e-4, atol=1e-5)
        assert optimism[replica, largest].min() > 2 * clip * unit  # they would not have fitted under a clip


def test_a_replica_is_recovered_alone_as_in_a_batch(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    def made(*seeds: int) -> tuple[Recovery, Windows]:
        assigner = recovery_of(models(), RelativeMSE(0.3), bonuses(), Centred())
        return assigner, seen(make_continuous, make_trajectories, assigner, seeds).windows

    batch, together = made(2, 0, 3)
    whole = believed(batch)
    for r, seed in enumerate((2, 0, 3)):
        alone, single = made(seed)
        own, rows = believed(alone), len(single)
        assert rows == rows_of(together, r)
        assert torch.equal(single.states[0], together.states[r, :rows])
        torch.testing.assert_close(alone.rewards(single)[0], batch.rewards(together)[r, :rows], rtol=0, atol=1e-5)
        for name in ("mean", "mse", "disagreement", "weights", "best", "mixed", "plan"):
            torch.testing.assert_close(getattr(own, name)[0], getattr(whole, name)[r, ..., :rows], msg=name)
        assert whole.bonus.keys() == {"mse", "gap"}
        torch.testing.assert_close(own.bonus["gap"][0], whole.bonus["gap"][r, :rows])


def test_what_is_believed_of_other_steps(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    assigner = recovery_of(models(), RelativeMSE(0.3), bonuses(), Centred())
    windows = seen(make_continuous, make_trajectories, assigner).windows
    before = assigner.rewards(windows)
    order = torch.randperm(len(windows), generator=torch.Generator().manual_seed(0))
    states, actions, arrivals = (x[1, order] for x in (windows.states, windows.actions, windows.next_states))
    grid = assigner.believe(Steps(states, actions, arrivals))
    torch.testing.assert_close(grid.plan[1], believed(assigner).plan[1, order])
    assert torch.equal(grid.mean[0, 0], grid.mean[1, 0])
    assert (grid.mean[0, 1] != grid.mean[1, 1]).all()  # by the fit of the other replica
    assert grid.valid is None
    assert torch.equal(assigner.rewards(windows), before)  # nothing was kept of them


def test_rewards_of_the_newest_windows_are_those_of_all(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    assigner = recovery_of(models(), EqualWeights(), bonuses())
    store = seen(make_continuous, make_trajectories, assigner)
    whole, new = assigner.rewards(store.windows), assigner.rewards(store.new)
    for replica, before in enumerate(store.before.tolist()):
        rows = rows_of(store.new, replica)
        assert torch.equal(new[replica, :rows], whole[replica, before : before + rows])


def test_rewards_of_unseen_steps_are_refused(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    assigner = recovery_of(models(), EqualWeights())
    store = seen(make_continuous, make_trajectories, assigner)
    store.append(make_trajectories([[3], [4]], [[0.0], [1.0]]))
    with pytest.raises(ValueError, match=r"these 32 rows are neither all 28 .* nor the newest 12"):
        assigner.rewards(store.windows)


def test_rows_that_were_seen_stay(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    fixed = Fixed("reference")
    assigner, problem = recovery_of([fixed], ReferenceOnly()), make_continuous((0,), window=150)
    store = Store(problem)
    assigner.start(problem)
    for number in range(6):
        store.append(make_trajectories([[1 + 3 * number]], [[1.0]], first=number))
        assigner.observe(store)
    for before, after in pairwise(fixed.fitted):
        assert torch.equal(after[:, : before.shape[1]], before)


@pytest.mark.parametrize("bonus", [Elliptical(2.0, 0.3), Thompson(0.5)])
def test_what_the_confidence_set_adds_to_steps(
    make_continuous: MakeProblem, make_trajectories: Make, bonus: Bonus
) -> None:
    model = LinearModel("box", Motion(), Analytic(None), unit=3.0)
    assigner = recovery_of([model], ReferenceOnly(), {"set": bonus})
    windows = seen(make_continuous, make_trajectories, assigner).windows
    added = believed(assigner).bonus["set"]
    assert added.dtype == believed(assigner).plan.dtype == torch.float32
    if isinstance(bonus, Elliptical):
        torch.testing.assert_close(added, (0.6 * model.leverage().sqrt()).float())
    some = Steps(windows.states[1, 5:9], windows.actions[1, 5:9], windows.next_states[1, 5:9])
    for _ in range(2):  # who looks draws nothing
        torch.testing.assert_close(assigner.believe(some).bonus["set"][1], added[1, 5:9])


def test_the_weights_of_labels_are_those_of_other_steps(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    assigner = learning()[2]
    windows = seen(make_continuous, make_trajectories, assigner).windows
    some = Steps(windows.states[1, 5:9], windows.actions[1, 5:9], windows.next_states[1, 5:9])
    found, whole = assigner.believe(some), believed(assigner)
    assert torch.equal(found.weights[..., 0], whole.weights[..., 0])
    torch.testing.assert_close(found.plan[1], whole.plan[1, 5:9])


def test_names_must_differ() -> None:
    with pytest.raises(UserError, match="reward models need different names"):
        recovery_of([Fixed("same"), Fixed("same")], EqualWeights())
    with pytest.raises(UserError, match="reward models need different names"):
        Recovery(Fixed("same"), {"other": Fixed("same")}, EqualWeights(), {})


def learning() -> list[Recovery]:
    """Recoveries of every kind of model of steps."""
    bootstrap = Bootstrap(3)
    small = {"width": 8, "first_steps": 5, "steps": 2, "batch": 4}
    box = [LinearModel(name, Motion(), bootstrap) for name in ("ridge", "box")]
    network = NeuralModel("dnn", Motion(), LastLayer(), **small)  # type: ignore[arg-type]
    return [
        recovery_of(models()[:2], RelativeMSE(0.3), bonuses(), Standard()),
        recovery_of([network, LinearModel("box", Motion(), Analytic(None))], RelativeMSE(), bonuses(), Standard()),
        recovery_of(box, Stacking(), bonuses()),
    ]


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("at_first", [True, False])
def test_a_round_without_windows_is_taken(
    make_continuous: MakeProblem, make_trajectories: Make, number: int, at_first: bool
) -> None:
    problem, assigner = make_continuous((0, 1), window=150), learning()[number]
    windows = make_trajectories([[3, 5, 4], [2, 4, 9]], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    none, store = first(windows, 0), Store(problem)
    assigner.start(problem)
    for piece in (none, windows) if at_first else (windows, none):
        store.append(piece)
        assigner.observe(store)
        assert assigner.rewards(piece).shape == piece.states.shape[:2]
    assert believed(assigner).mixed.isfinite().all()
    rewards = assigner.rewards(store.windows)
    assert rewards.shape == (2, 15)
    assert rewards.isfinite().all()
    alone, other = learning()[number], Store(problem)
    alone.start(problem)
    other.append(windows)
    alone.observe(other)
    if at_first or number != 1:  # a network goes on learning from what it has
        torch.testing.assert_close(rewards, alone.rewards(windows))


def test_stacking_of_steps_holds_labels_out(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    bootstrap = Bootstrap(3)
    made = [LinearModel(name, Motion(), bootstrap, penalty) for name, penalty in (("r", 0.1), ("l", 5.0))]
    assigner = recovery_of(made, Stacking(0.2))
    store = seen(make_continuous, make_trajectories, assigner)
    belief, windows = believed(assigner), store.windows
    errors = torch.zeros(2, 2, 4, dtype=FLOAT)
    out = bootstrap._outside[:, :4]
    for replica in range(2):
        for k in range(4):
            own = windows.number[replica] == k
            blind = out[replica, k].nonzero().flatten().tolist()
            for j, model in enumerate(made):
                draws = model.estimate().draws
                assert draws is not None
                sums = [float(draws[replica, b][own].sum()) for b in blind]
                if sums:
                    errors[replica, j, k] = sum(sums) / len(sums) - windows.labels[replica, k]
        scale = windows.labels[replica].std(correction=0) or torch.tensor(1.0)
        products = (errors[replica] / scale) @ (errors[replica] / scale).mT
        expected = Stacking(0.2).weights(torch.zeros(2, 1, dtype=FLOAT), products)[:, 0]
        torch.testing.assert_close(belief.weights[replica, :, 0].double(), expected, rtol=1e-4, atol=1e-5)
    assert out.any()
    assert not out.all()


def test_a_state_has_no_room_for_more_and_goes_on_to_the_bit(
    make_continuous: MakeProblem, make_trajectories: Make
) -> None:
    problem = make_continuous((0, 1))
    rounds = [make_trajectories(own, [[1.0] * len(own[0])] * 2, first=10 * i) for i, own in enumerate(LENGTHS)]

    def made() -> Recovery:
        bootstrap = Bootstrap(3)
        linear = LinearModel("linear", Looks(), bootstrap)
        found = Recovery(PrimitiveReward(uncertainty=bootstrap), {"linear": linear}, RelativeMSE(), {})
        found.start(problem)
        return found

    def see(recovery: Recovery, store: Store, which: slice) -> Recovery:
        for windows in rounds[which]:
            store.append(replace(windows, primitive=windows.states[..., 0].double()))
            recovery.observe(store)
        return recovery

    store, again = Store(problem), Store(problem)
    state = see(made(), store, slice(2)).state_dict()
    rows = len(store.windows)
    wide = {where: part.shape[1] for where, part in blocks(state) if part.dim() > 1 and part.shape[1] > 4}
    assert sorted(wide.values()) == [len(store)] + [rows] * 3  # what was left out; φ, and the oracle's two sums
    whole, resumed = see(made(), again, slice(3)), made()
    resumed.load_state_dict(state)
    see(resumed, store, slice(2, 3))
    for name in ("mean", "mse", "weights", "mixed"):
        assert torch.equal(getattr(resumed.belief(), name), getattr(whole.belief(), name)), name


class Spoiled(Fixed):
    """Is not finite in one row of one seed, and where a replica has no rows."""

    def __init__(self, name: str, part: str) -> None:
        super().__init__(name)
        self._part = part

    def estimate(self, at: Tensor | None = None) -> Estimate:
        found = super().estimate(at)
        values = getattr(found, self._part).clone()
        values[0, 24:] = torch.nan  # seed 0 has 24 rows in the end, seed 1 has 28
        if values.shape[1] > 24 and self.name == "far":
            values[1, 26] = torch.nan
        return replace(found, **{self._part: values})


class Broken(LocalMSE):
    def __call__(self, belief: Belief, reference: RewardModel, steps: Steps | None = None) -> Tensor:
        return super().__call__(belief, reference, steps) / 0.0


class Overflowing(Centred):
    def __call__(self, rewards: Tensor) -> tuple[Tensor, Tensor]:
        return rewards * torch.inf, torch.ones(())


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"part": "mean"}, r"the prediction of reward model 'far' is nan at row 26 of seed 1"),
        ({"part": "variance"}, r"the MSE proxy of reward model 'far' is nan at row 26 of seed 1"),
        (
            {"bonus": {"mse": LocalMSE(0.5, None), "mine": Broken(0.5, None)}},
            r"the bonus 'mine' is inf at row 0 of seed 0",
        ),
        ({"scaler": Overflowing()}, r"what the scaler makes of .* is -?inf at row 0 of seed 0"),
    ],
    ids=["mean", "variance", "bonus", "scaler"],
)
def test_a_reward_that_is_not_finite_names_its_part(
    make_continuous: MakeProblem, make_trajectories: Make, changed: dict[str, Any], message: str
) -> None:
    part = changed.pop("part", None)
    surrogates = [Spoiled("far", part)] if part else []
    assigner = recovery_of([Fixed("reference"), *surrogates], RelativeMSE(), **changed)
    with pytest.raises(RunError, match=message):
        seen(make_continuous, make_trajectories, assigner)


def test_what_is_behind_the_rows_of_a_replica_need_not_be_finite(
    make_continuous: MakeProblem, make_trajectories: Make
) -> None:
    assigner = recovery_of([Fixed("reference"), Spoiled("near", "mean")], RelativeMSE())
    store = seen(make_continuous, make_trajectories, assigner)
    rewards, valid = assigner.rewards(store.windows), store.windows.valid
    assert valid is not None
    assert rewards[valid].isfinite().all()
    assert rewards[~valid].isnan().all()


def test_a_proxy_may_be_infinite(make_continuous: MakeProblem, make_trajectories: Make) -> None:
    assigner = recovery_of([Fixed("reference"), Fixed("far", spread=float("inf"))], RelativeMSE())
    seen(make_continuous, make_trajectories, assigner)
    assert believed(assigner).mse[:, 1].isinf().any()


@pytest.mark.parametrize("scaler", [None, Standard(1.0, 0.9), RootMeanSquare()])
@pytest.mark.parametrize("relabel", ["sampled", 0.2])
def test_some_rows_are_worth_what_they_are_among_all(
    make_continuous: MakeProblem, make_trajectories: Make, scaler: Scaler | None, relabel: Relabel
) -> None:
    every, some = (
        Recovery(*models()[:1], {model.name: model for model in models()[1:]}, None, bonuses(), scaler, chosen)
        for chosen in ("all", relabel)
    )
    stores = [seen(make_continuous, make_trajectories, one) for one in (every, some)]
    wanted = every.rewards(stores[0].windows)
    rows = torch.tensor([[4, 0, 2], [3, 3, 1]])
    torch.testing.assert_close(some.at(rows), wanted.gather(1, rows), rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(every.at(rows), wanted.gather(1, rows))
    found = some.rewards(stores[1].windows)
    for replica in range(2):
        count = rows_of(stores[1].windows, replica)
        torch.testing.assert_close(found[replica, :count], wanted[replica, :count], rtol=1e-6, atol=1e-6)
    behind = torch.full_like(rows, 10**6)
    assert not some.at(behind).any()
    one, other = believed(every), believed(some)
    valid = one.mixed != 0 if one.valid is None else one.valid
    torch.testing.assert_close(other.mixed[valid], one.mixed[valid])


def test_rows_that_stand_for_all_are_spread_evenly(
    make_continuous: MakeProblem, make_trajectories: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("credit.recovery.recovery.SPREAD_OUT", 4)
    every, some = (Recovery(models()[0], scaler=RootMeanSquare(), relabel=chosen) for chosen in ("all", "sampled"))
    store = seen(make_continuous, make_trajectories, every)
    seen(make_continuous, make_trajectories, some)
    for replica in range(2):
        count = rows_of(store.windows, replica)
        spread = torch.arange(4) * count // 4
        mixed = believed(every).mixed[replica]
        assert torch.equal(believed(some).mixed[replica], mixed[spread])
        unit = mixed[spread].square().mean().sqrt()
        rows = torch.arange(count).expand(2, -1)
        torch.testing.assert_close(some.at(rows)[replica], mixed[:count] / unit)


def test_what_needs_all_rows_is_refused_for_some(make_continuous: MakeProblem, make_problem: MakeProblem) -> None:
    reference = models()[0]
    for part, said in (
        ({"bonus": Thompson()}, "bonus 'bonus' looks at all steps"),
        ({"scaler": Centred()}, "Centred does not say how some rewards are scaled"),
        ({"mixer": Stacking()}, "Stacking predicts all labels"),
    ):
        recovery = Recovery(reference, relabel="sampled", **part)  # type: ignore[arg-type]
        with pytest.raises(UserError, match=said):
            recovery._check_relabel(make_continuous())
    with pytest.raises(UserError, match="a table's cells"):
        Recovery(reference, relabel=0.5)._check_relabel(make_problem())
