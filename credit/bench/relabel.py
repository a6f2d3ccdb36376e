"""`credit bench relabel`: what it costs to relabel all rows, a share, or what is sampled, and how old rewards are."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import torch

from credit.bench.measure import Row
from credit.core.problem import Problem
from credit.core.seams import Relabel
from credit.core.store import Store
from credit.core.windows import Windows
from credit.data.replay import Replay
from credit.recovery.features.flat import Flat
from credit.recovery.models.neural import NeuralModel
from credit.recovery.recovery import Recovery
from credit.recovery.scaler import RootMeanSquare
from credit.recovery.uncertainty.networks import LastLayer

ROUNDS, STEPS, HORIZON, OBSERVATIONS, ACTIONS = 200, 500, 250, 17, 6  # those of HalfCheetah, 100,000 steps
BATCH, BLOCK = 128, 25  # so many batches are drawn at once
UPDATES = (500, 50)  # a round: one a step, and one in ten
KEYS: tuple[Relabel, ...] = ("all", 0.1, "sampled")


def run(say: Callable[[str], None]) -> Sequence[Row]:
    """CPU seconds of a whole run's relabelling and sampling, over that of `all`; ages of sampled rewards in refits."""
    rows = list[Row]()
    for updates in UPDATES:
        least = 0.0
        for key in KEYS:
            say(f"relabel={key}, {updates} updates a round")
            seconds, last, mean, most = measured(key, updates)
            least = least or seconds
            what = f"relabel={key}, {updates} updates for {STEPS} steps: CPU of {ROUNDS * STEPS:,} steps, of the last "
            what += "refit; age of sampled rewards in refits, mean and most"
            figure = f"{seconds:.1f} s, {last * 1e3:.0f} ms; {mean:.1f}, {most}"
            rows.append(Row(what, f"{figure}; {seconds / least:.2f} of all"))
    return rows


class Timed(NeuralModel):
    """A model that knows how long its fits took."""

    spent = 0.0

    def observe(self, store: Store) -> None:
        """Fit, by the clock."""
        start = time.process_time()
        super().observe(store)
        self.spent += time.process_time() - start


def measured(key: Relabel, updates: int) -> tuple[float, float, float, int]:
    """CPU seconds of all refits and of the last, without the fit; ages of rewards in refits, mean and largest.

    Batches are drawn uniformly, so that the ages of what is sampled are those of all rows.
    """
    model = Timed("dnn", Flat(), LastLayer(), first_steps=5, steps=1, stride=None, balance="none", standardise=True)
    recovery = Recovery(model, scaler=RootMeanSquare(), relabel=key)
    problem = Problem.vectors(OBSERVATIONS, ACTIONS, HORIZON, (0,))
    recovery.start(problem)
    store, replay, taken, ages, most = Store(problem), Replay(problem), list[float](), list[float](), 0
    for number in range(ROUNDS):
        store.append(windows(number))
        before, start = model.spent, time.process_time()
        recovery.observe(store)
        replay.update(store, recovery)
        for _ in range(0, updates, BLOCK):
            replay.sample(BATCH, BLOCK)
        taken.append(time.process_time() - start - (model.spent - before))
        old = replay.ages.double()
        ages.append(float(old.mean()))
        most = max(most, int(old.max()))
    return sum(taken), taken[-1], sum(ages) / len(ages), most


def windows(seed: int, steps: int = STEPS) -> Windows:
    """A round of steps in windows of the horizon."""
    generator = torch.Generator().manual_seed(seed)
    shape = (1, steps // HORIZON, HORIZON)
    states = torch.randn(*shape, OBSERVATIONS, generator=generator)
    actions = torch.rand(*shape, ACTIONS, generator=generator) * 2 - 1
    return Windows.of_grid(states, actions, states, torch.randn(shape[:2], generator=generator).double())
