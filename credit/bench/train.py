"""`credit bench train`: whole runs of SAC on HalfCheetah with recovered rewards against Stable-Baselines3's `learn`."""

from __future__ import annotations

import importlib.util
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

import torch

import credit
from credit.bench.measure import Row, cpu_seconds, peak_megabytes
from credit.bench.relabel import ACTIONS, HORIZON, OBSERVATIONS, windows
from credit.core.problem import Problem
from credit.core.store import Store
from credit.data.replay import Replay
from credit.envs.collect import Collector
from credit.recovery.features.flat import Flat
from credit.recovery.models.neural import NeuralModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.networks import LastLayer
from credit.runs.composing import compose

STEPS, EPISODE = 10_000, 1_000
FEW = 3_000
ROWS, ROUND = 1_000_000, 10_000
WORDS = (
    *("env=gymnasium", "env.id=HalfCheetah-v5", "feedback=episode_sum", "method=reference"),
    *(f"trainer.steps_per_round={EPISODE}", "trainer.random_steps=1000", "trainer.log_every=1000", "tracking=none"),
    "env.evaluation_episodes=1",  # learn() has none
)
LARGE = ("agent.width=256", "agent.batch=256")
CLOCKED = {  # what is timed: name → class and method
    "collection": (Collector, "roll"),
    "refits": (Recovery, "observe"),
    "fits": (NeuralModel, "observe"),
    "replay": (Replay, "update"),
}


def run(say: Callable[[str], None] = lambda line: None) -> list[Row]:
    """Measure everything on one thread; about ten minutes."""
    torch.set_num_threads(1)
    say(f"{STEPS:,} steps with 256×256 networks")
    rows, ours = parts()
    rows += against(ours, say)
    say("seeds side by side")
    rows += side_by_side()
    say(f"memory of {ROWS:,} steps")
    peak, empty = (peak_megabytes(f"from credit.bench.train import filled\nfilled({n})") for n in (ROWS, ROUND))
    what = (
        f"{ROWS:,} steps of one seed (store, replay, rewards and what the model sees): peak memory of a fresh process"
    )
    return [*rows, Row(what, f"{peak:.0f} MiB, of which {empty:.0f} MiB with {ROUND:,} steps")]


def trained(steps: int, seeds: int, *words: str) -> None:
    """A whole run, from words to its folder.

    Raises:
        RuntimeError: it failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        more = (f"trainer.steps={steps}", "seed=0", f"replicas={seeds}", f"output={folder}")
        result = credit.run([*WORDS, *words, *more], threads=1)
    if result.error:
        raise RuntimeError(result.error)


def parts() -> tuple[list[Row], float]:
    """Where the time of a run goes; and all of it, CPU seconds."""
    with clocked() as spent:
        total = cpu_seconds(partial(trained, STEPS, 1, *LARGE))
    relabelling = spent["refits"] - spent["fits"] + spent["replay"]
    share = (spent["collection"] + relabelling) / total
    what = "SAC 256×256 on HalfCheetah, refit and relabelling after each episode: CPU ms a step"
    return [
        Row(what, f"{total / STEPS * 1e3:.2f}"),
        Row("of which fits of the reward model", f"{spent['fits'] / total:.1%}"),
        Row("of which collection, and relabelling", f"{spent['collection'] / total:.1%}, {relabelling / total:.1%}"),
        Row("of which both", f"{share:.1%}", "≤ 15%", share <= 0.15),
    ], total


def against(ours: float, say: Callable[[str], None]) -> list[Row]:
    """Stable-Baselines3's `learn` on true rewards with the same settings, steps and updates."""
    what = "speed over Stable-Baselines3's learn(), the same steps and updates"
    if importlib.util.find_spec("stable_baselines3") is None:
        return [Row(what, "not installed: pip install 'credit-rl[bench]'", "≥ 1.25")]
    import gymnasium

    from credit.bench.returns import peer

    say("Stable-Baselines3")
    config: Mapping[str, Any] = compose([*WORDS, *LARGE, f"trainer.steps={STEPS}"])
    model = peer(config, gymnasium.make("HalfCheetah-v5"), 0)
    theirs = cpu_seconds(lambda: model.learn(STEPS))
    return [Row(what, f"{theirs / ours:.2f}", "≥ 1.25", theirs >= 1.25 * ours)]


def side_by_side() -> list[Row]:
    """Eight seeds with small networks over one."""
    small = ("agent.width=64", "agent.batch=256")
    one, eight = (cpu_seconds(partial(trained, FEW, seeds, *small)) for seeds in (1, 8))
    what = "64×64: CPU ms a step of 1 and of 8 seeds, a whole run; ratio"
    figure = f"{one / FEW * 1e3:.2f}, {eight / FEW * 1e3:.2f}; {eight / one:.1f}"
    return [Row(what, figure, "≤ 4.5", eight <= 4.5 * one)]


@contextmanager
def clocked() -> Iterator[dict[str, float]]:
    """CPU seconds spent in each part meanwhile."""
    spent, before = dict.fromkeys(CLOCKED, 0.0), dict[str, Any]()
    for name, (cls, method) in CLOCKED.items():
        before[name] = getattr(cls, method)

        def timed(*args: Any, _name: str = name, **keys: Any) -> Any:
            start = time.process_time()
            try:
                return before[_name](*args, **keys)
            finally:
                spent[_name] += time.process_time() - start

        setattr(cls, method, timed)
    try:
        yield spent
    finally:
        for name, (cls, method) in CLOCKED.items():
            setattr(cls, method, before[name])


def filled(steps: int) -> None:
    """A store, a replay and a recovery that have seen so many steps of HalfCheetah's size."""
    model = NeuralModel("dnn", Flat(), LastLayer(), first_steps=1, steps=1, stride=None, standardise=True)
    recovery, problem = Recovery(model, relabel=0.01), Problem.vectors(OBSERVATIONS, ACTIONS, HORIZON, (0,))
    recovery.start(problem)
    store, replay = Store(problem), Replay(problem)
    for number in range(steps // ROUND):
        store.append(windows(number, ROUND))
        recovery.observe(store)
        replay.update(store, recovery)
