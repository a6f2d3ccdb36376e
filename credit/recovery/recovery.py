"""Reference + surrogates → MSE proxies → mixture → optimism: the paper on one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any, ClassVar

import torch
from torch import Tensor

from credit.core.belief import Belief, Estimate
from credit.core.cells import Cells
from credit.core.errors import UserError
from credit.core.naming import is_name
from credit.core.problem import FLOAT, Problem
from credit.core.seams import Bonus, CreditAssigner, Mixer, Relabel, RewardModel, Scaler
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.windows import Windows
from credit.recovery.finite import require_finite
from credit.recovery.mixers import RelativeMSE, best_model, mix
from credit.recovery.places import Rows, Table
from credit.recovery.proxies import gap, mse_proxies
from credit.recovery.tables import Alike, spread_out

SPREAD_OUT = 10_000  # steps that stand for all of a replica, where not all are relabelled
SPREAD = ("mean", "mse", "disagreement", "weights", "best", "mixed")  # from the cells that stand for others


class Recovery(CreditAssigner):
    """Learn a pseudo-reward for every place from labels (sections 3.2–4.4, algorithms B.1 lines 3–16, B.2 lines 4–12).

    Places are the cells of a table where states and actions are numbers, else the steps that were taken.

    Args:
        reference: the flexible model.
        surrogates: name → structured model; None for no one.
        mixer: MSE proxies → weights; None for relative MSE (14) with its defaults.
        bonus: name → what optimism adds, or one; their sum is the bonus.
        scaler: how the mixed reward is scaled for the agent; optimism is added after it, in its unit.
        relabel: for which steps the reward is recovered after every refit, where places are the steps: all; the newest
            and a share of the others, those first whose reward is the oldest; or those that an agent samples. Where it
            is not all, the scaler's unit is that of at most 10,000 steps, evenly spread.

    Example:
        >>> recovery = Recovery(LinearModel("ridge", Identity(), Bootstrap())).fit(windows, problem)
        >>> recovery.belief().mixed, recovery.rewards(windows)
    """

    keeps: ClassVar = ("models", "_uncertainties", "mixer", "bonus", "scaler", "_places", "_learned")
    _belief: Belief | None = None
    _rewards: Tensor | None = None

    def __init__(
        self,
        reference: RewardModel,
        surrogates: Mapping[str, RewardModel] | None = None,
        mixer: Mixer | None = None,
        bonus: Mapping[str, Bonus] | Bonus | None = None,
        scaler: Scaler | None = None,
        relabel: Relabel = "all",
    ) -> None:
        self.reference, self.surrogates = reference, dict(surrogates or {})
        self.models = [reference, *self.surrogates.values()]
        self.mixer = RelativeMSE() if mixer is None else mixer
        self.bonus = {"bonus": bonus} if isinstance(bonus, Bonus) else dict(bonus or {})
        self.scaler, self.relabel = scaler, relabel
        self.names = names_of(self.models)
        owned = [model.uncertainty for model in self.models if model.uncertainty is not None]
        self._uncertainties = list({id(one): one for one in owned}.values())  # one may serve several models

    def start(self, problem: Problem) -> None:
        """Empty models, no visits.

        Raises:
            UserError: a model looks at the step of windows that follow each other; or uncertainties do not go together.
        """
        self._check_uncertainties()
        self._check_relabel(problem)
        self._places = places_of(self.models, problem)
        self._kind = FLOAT if problem.tabular else torch.float32  # single steps are many
        self._seeds, self._device = problem.seeds, problem.device
        count = len(self.models)
        self._errors = problem.zeros(count, count) if self.mixer.sees_label_errors else None
        for bonus in self.bonus.values():
            bonus.start(problem)
        for model in self.models:
            model.start(problem, self._places)
        self._alike: Alike | None = None
        if isinstance(self._places, Table):
            every = torch.arange(self._places.cells.count, device=problem.device)
            looks = [model.looks() for model in self.models]
            self._alike = Alike([every if own is None else own for own in looks])
        self._learned = False
        self._belief = self._believe(Store(problem)) if problem.tabular else self._nowhere(problem)
        self._rewards = self._mixed_rewards = self._belief.plan if problem.tabular else None

    def _check_uncertainties(self) -> None:
        """Gaps are over common draws (9), and labels are held out by one bootstrap for all."""
        counts = {model.name: getattr(model.uncertainty, "draws", 0) for model in self.models}
        if len({count for count in counts.values() if count}) > 1:
            found = ", ".join(f"{name}: {count}" for name, count in counts.items())
            raise UserError(
                f"reward models are compared draw by draw (9), and theirs are not equally many ({found}); give their "
                "uncertainties the same number of draws"
            )
        kinds = {model.name: model.likelihood for model in self.models}
        if len(set(kinds.values())) > 1:
            found = ", ".join(f"{name}: {kind}" for name, kind in kinds.items())
            raise UserError(
                f"reward models are mixed and compared (9), (15), and a reward and a contribution to log-odds have no "
                f"unit in common ({found}); give all models the same likelihood"
            )
        wanted = self.mixer.needs.get("uncertainty")
        if not self.mixer.sees_label_errors or wanted is None:
            return
        for model in self.models:
            if not isinstance(model.uncertainty, wanted) or model.uncertainty is not self.models[0].uncertainty:
                raise UserError(
                    f"mixer: {type(self.mixer).__name__} weighs models by labels that a common {wanted.__name__} held "
                    f"out, and {model.name!r} has none or another; let all models share one, or choose another mixer"
                )

    def _check_relabel(self, problem: Problem) -> None:
        """Some steps can stand alone only where nothing looks at all of them."""
        if self.relabel == "all":
            return
        key = f"assigner.relabel={self.relabel}"
        if problem.tabular:
            raise UserError(f"{key}: rewards are those of a table's cells here, and all are recovered; set it to all")
        if self.mixer.sees_label_errors:
            raise UserError(f"{key}: {type(self.mixer).__name__} predicts all labels; set it to all, or another mixer")
        for name, bonus in self.bonus.items():
            if not bonus.by_belief:
                raise UserError(f"{key}: the bonus {name!r} looks at all steps; set it to all, or leave the bonus out")
        if self.scaler is not None:
            self.scaler.like(torch.zeros(0))

    def fit(self, windows: Windows, problem: Problem) -> Recovery:
        """Learn from windows that are there, from the beginning; itself.

        Args:
            windows: labelled, K of each of R replicas. problem: in whose spaces they lie.

        Raises:
            UserError: they do not fit it.
        """
        store = Store(problem)
        store.append(windows)
        self.start(problem)
        self.observe(store)
        return self

    @property
    def learns(self) -> bool:
        """Every label may change the reward of every step."""
        return True

    def observe(self, store: Store) -> None:
        """Fit every model to the newest labels, and recover the reward of every place anew.

        Raises:
            RunError: a reward is not finite; it names the part that is to blame.
        """
        self._places.extend(store)
        for model in self.models:
            model.observe(store)
        self._learned = True
        self._recover(store)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from a state; what was believed follows from the models, without a look at a random number."""
        super().load_state_dict(state)
        if self._learned:
            self._recover(None)
            super().load_state_dict(state)  # bonuses and scalers may have drawn, or moved

    def _names(self) -> tuple[str, ...]:
        return (*super()._names(), *(() if self._errors is None else ("_errors",)))

    def _recover(self, store: Store | None) -> None:
        """What is believed of every place; without a store, label errors are as they were."""
        if self.relabel != "all":
            self._look_at_some()
            return
        self._belief = self._believe(store)
        self._rewards, self._mixed_rewards = self._belief.plan, self._belief.mixed
        if self.scaler is not None:
            self._rewards, self._mixed_rewards = self._scaled(self._belief, self.scaler)
        require_finite(self._rewards, self._belief, self._seeds)

    def at(self, rows: Tensor) -> Tensor:
        """r_plan of some steps, by the number of their row [R, m], with the models as they are; 0 behind the last."""
        if self.relabel == "all" and self._rewards is not None:
            return self._rewards.gather(1, rows)
        counts = torch.tensor(self._places.counts, device=rows.device).unsqueeze(1)
        real = rows < counts
        rows = torch.minimum(rows, counts - 1)
        belief = replace(self._of(rows), valid=None if bool(real.all()) else real)
        rewards = belief.plan
        if self.scaler is not None:
            pairs = zip(belief.mixed, self._scalings, strict=True)
            rewards = torch.stack([scaled(mixed) for mixed, (scaled, _) in pairs])
            units = torch.stack([unit for _, unit in self._scalings]).unsqueeze(1)
            rewards = reduce(torch.add, (bonus / units for bonus in belief.bonus.values()), rewards)
        rewards = torch.where(real, rewards, 0)
        require_finite(rewards, belief, self._seeds, rows)
        return rewards

    def belief(self) -> Belief | None:
        """What is believed since the last windows; of some steps, evenly spread, where not all are relabelled."""
        return self._belief

    def believe(self, steps: Steps) -> Belief:
        """What is believed of other steps [n], [R, n]: a grid to look at."""
        visits = self._places.visits
        if visits is not None and self._places.cells is not None:
            visits = visits.gather(1, self._places.cells.index(steps).expand(len(visits), -1))
        estimates = [model.believe(steps) for model in self.models]
        return self._with_bonuses(self._mixed(estimates, visits), steps)

    def rewards(self, windows: Windows) -> Tensor:
        """r_plan of every row [R, n] of the newest windows, or of all: the scaled mixed reward, and optimism.

        Raises:
            UserError: there were no windows yet; or these are others, where each row has a reward of its own.
        """
        if self.relabel != "all" and self._learned:
            return self.at(self._places.index(windows))
        if self._rewards is None:
            raise UserError("this recovery has seen no windows yet: `observe` a store of them, or `fit` to some, first")
        return self._rewards.gather(1, self._places.index(windows))

    def table(self) -> tuple[Cells, Tensor, Tensor] | None:
        """Cells, r_plan and the mixed reward [R, N], both scaled, where there is a table."""
        if self._belief is None or self._belief.cells is None:
            return None
        assert self._rewards is not None
        assert self._mixed_rewards is not None
        return self._belief.cells, self._rewards, self._mixed_rewards

    def _look_at_some(self) -> None:
        """What is believed of steps that stand for all, and how the mixed reward is scaled by them."""
        counts = self._places.counts or []
        most = min(SPREAD_OUT, max(counts))
        sizes = torch.tensor(counts, device=self._device).unsqueeze(1)
        taken, number = sizes.clamp(max=SPREAD_OUT), torch.arange(most, device=self._device)
        valid = number < taken
        rows = (number * sizes // taken.clamp(min=1)).where(valid, 0)
        self._belief = replace(self._of(rows), valid=None if bool(valid.all()) else valid)
        if self.scaler is not None:
            pairs = zip(self._belief.mixed, valid, strict=True)
            self._scalings = [self.scaler.like(mixed[own]) for mixed, own in pairs]

    def _of(self, rows: Tensor) -> Belief:
        """What is believed of some steps, by the number of their row [R, m]."""
        return self._with_bonuses(self._mixed([model.estimate(rows) for model in self.models], None), None)

    def _nowhere(self, problem: Problem) -> Belief:
        """What is believed of no place at all: models have names, and nothing more."""
        count = len(self.models)
        each, one = (torch.zeros(problem.replicas, *size, 0, device=problem.device) for size in ((count,), ()))
        draws = (None,) * count
        return Belief(self.names, each, draws, each, each[:, 1:], each, one.long(), one, {}, one)

    def _believe(self, store: Store | None) -> Belief:
        """What is believed of all places."""
        at, column, visits = None, None, self._places.visits
        if self._alike is not None and visits is not None and self._alike.saves and self._draws:
            at, column = self._alike.choose(visits)
        estimates = [model.estimate(at) for model in self.models]
        if self.mixer.sees_label_errors and store is not None:
            index = self._places.index(store.windows) if len(store) else None
            if index is not None and column is not None:
                index = column.gather(1, index)
            self._errors = self._label_errors(estimates, store, index)
        belief = self._mixed(estimates, visits if visits is None or at is None else visits.gather(1, at))
        if column is not None:
            parts: dict[str, Any] = {name: spread_out(getattr(belief, name), column) for name in SPREAD}
            belief = replace(belief, **parts, column=column)
        seen = None if visits is None else visits.clone()
        whole = replace(belief, visits=seen, cells=self._places.cells, valid=self._valid())
        return self._with_bonuses(whole, None)

    @property
    def _draws(self) -> int:
        return max((getattr(one, "draws", 0) for one in self._uncertainties), default=0)

    def _label_errors(self, estimates: list[Estimate], store: Store, index: Tensor | None) -> Tensor:
        """Products [R, M, M] of the errors with which models predict labels that they were not fitted to, summed."""
        return self.models[0].uncertainty.label_errors(estimates, store, index)  # type: ignore[union-attr]

    def _mixed(self, estimates: Sequence[Estimate], visits: Tensor | None) -> Belief:
        """Proxies, weights and the mixture (9)–(16) of what the models predict of places with N visits [R, n]."""
        reference, *surrogates = estimates = [_as(estimate, self._kind) for estimate in estimates]
        gaps = [gap(reference, surrogate) for surrogate in surrogates]
        variances = [reference.variance, *(surrogate.variance for surrogate in surrogates)]
        if visits is not None:
            variances[0] = variances[0] + self.models[0].prior(visits)
        variance = torch.stack(variances, dim=1)
        disagreement = torch.stack(gaps, dim=1) if gaps else variance[:, :0]
        mse = mse_proxies(variance, disagreement)
        weights = self.mixer.weights(mse, self._errors)
        mean = torch.stack([estimate.mean for estimate in estimates], dim=1)
        mixed = mix(weights, mean)
        draws = tuple(estimate.draws for estimate in estimates)
        best = best_model(mse)
        return Belief(self.names, mean, draws, mse, disagreement, weights, best, mixed, {}, mixed, visits)

    def _with_bonuses(self, belief: Belief, steps: Steps | None) -> Belief:
        """Optimism (17)–(19), (33), (34) of all places, or of other steps."""
        reference, kind = self.models[0], belief.mixed.dtype
        bonus = {name: term(belief, reference, steps).to(kind) for name, term in self.bonus.items()}
        return replace(belief, bonus=bonus, plan=reduce(torch.add, bonus.values(), belief.mixed))

    def _scaled(self, belief: Belief, scaler: Scaler) -> tuple[Tensor, Tensor]:
        """The scaled mixed reward with optimism on top, in its unit and never clipped; and without it [R, N]."""
        rewards, plain = torch.zeros_like(belief.mixed), torch.zeros_like(belief.mixed)
        for replica, mixed in enumerate(belief.mixed):
            own = slice(None) if belief.valid is None else belief.valid[replica]
            scaled, unit = scaler(mixed[own])
            optimism = [bonus[replica, own] / unit for bonus in belief.bonus.values()]
            plain[replica, own] = scaled
            rewards[replica, own] = reduce(torch.add, optimism, scaled)
        return rewards, plain

    def _valid(self) -> Tensor | None:
        """Which of all places count [R, N], where replicas have different numbers of them."""
        counts = self._places.counts
        if counts is None or len(set(counts)) == 1:
            return None
        rows = torch.tensor(counts, device=self._device)
        return torch.arange(max(counts), device=self._device) < rows.unsqueeze(1)


def _as(estimate: Estimate, kind: torch.dtype) -> Estimate:
    if all(part is None or part.dtype == kind for part in (estimate.mean, estimate.variance, estimate.draws)):
        return estimate
    draws = None if estimate.draws is None else estimate.draws.to(kind)
    return Estimate(estimate.mean.to(kind), estimate.variance.to(kind), draws)


def places_of(models: Sequence[RewardModel], problem: Problem) -> Table | Rows:
    """Where the pseudo-reward of several models is defined: the cells that one of them tells apart, or the steps taken.

    Raises:
        UserError: a model looks at the step of windows that follow each other; or the cells are too many.
    """
    if not problem.tabular:
        return Rows(problem)
    axes = {axis for model in models for axis in model.looks_at}
    if "step" in axes and not problem.episodic:
        raise UserError(
            "a reward model looks at the step in the window, and windows follow each other here: the step means "
            "nothing; use models that look at states and actions alone, or an environment with episodes"
        )
    return Table(problem, Cells.over(axes, problem.horizon, problem.states, problem.actions))


def names_of(models: Sequence[RewardModel]) -> tuple[str, ...]:
    """The names of reward models, which must differ.

    Raises:
        UserError: two have the same, or one is no name.
    """
    names = [model.name for model in models]
    if bad := [name for name in names if not is_name(name)]:
        raise UserError(f"a reward model is called {bad[0]!r}; allowed: {is_name.__doc__}")
    if len(set(names)) < len(names):
        raise UserError(f"reward models need different names: {names}; change one `name`")
    return tuple(names)
