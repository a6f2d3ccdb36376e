"""`credit bench tabular`: the tabular core against the naive way, its growth in blocks, its memory."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from scipy import stats

from credit.bench import naive
from credit.bench.measure import Row, cpu_seconds, peak_megabytes, tensor_megabytes
from credit.config import schema
from credit.core.compiled import usable
from credit.core.windows import Windows
from credit.runs.composing import compose
from credit.trainer import Trainer

REPLICAS, MANY = 20, 100
BLOCKS = 2000
RUN = """
import torch
torch.set_num_threads(1)
from credit.bench.tabular import fast
fast(500, replicas={replicas})
"""


def run(say: Callable[[str], None] = lambda line: None) -> list[Row]:
    """Measure everything in this process, on one thread; about two minutes."""
    torch.set_num_threads(1)
    loops = "compiled by Numba" if usable(torch.zeros(0)) else "none: NUMBA_DISABLE_JIT"
    fast(50, REPLICAS)  # warm-up
    say(f"disagreement, {REPLICAS} replicas, {BLOCKS} blocks")
    ours = cpu_seconds(lambda: fast(BLOCKS, REPLICAS), repeat=2) / REPLICAS
    say(f"{MANY} replicas")
    many = cpu_seconds(lambda: fast(BLOCKS, MANY)) / MANY
    arrays = arrays_of(fast(BLOCKS, 1, first_seed=7).store.windows)
    say("the naive way, and the naive way with design matrices kept, at 6 lengths of history")
    first, kept = naive_seconds(arrays, cache=False), naive_seconds(arrays, cache=True)
    say(f"{4 * BLOCKS} blocks")
    longer = cpu_seconds(lambda: fast(4 * BLOCKS, REPLICAS)) / REPLICAS
    growth = longer / ours
    rows = [
        Row("loops over replicas", loops),
        Row(f"CPU seconds a seed, {REPLICAS} replicas side by side", f"{ours:.3f}"),
        Row(f"CPU seconds a seed, {MANY} replicas side by side", f"{many:.3f}"),
        Row("CPU seconds a seed, the naive way (extrapolated)", f"{first:.1f}"),
        Row("ratio to the naive way", f"{first / ours:.0f}", "≥ 100", first / ours >= 100),
        Row(f"ratio to the naive way, {MANY} replicas", f"{first / many:.0f}"),
        Row("ratio to the naive way with design matrices kept", f"{kept / ours:.0f}"),
        Row("time of 8,000 blocks over 2,000", f"{growth:.2f}", "4 ± 1", 3 <= growth <= 5),
    ]
    say("memory")
    rows += memory()
    say("statistical agreement with the naive way")
    return rows + agreement(arrays)


def fast(blocks: int, replicas: int, draws: int = 20, first_seed: int = 0) -> Trainer:
    """Run Disagreement-UCB on the advertiser; the finished trainer."""
    config = compose(["method=disagreement", f"trainer.steps={7 * blocks}", f"uncertainty.draws={draws}"])
    trainer: Trainer = schema.build(config, "trainer")
    trainer.start(tuple(range(first_seed, first_seed + replicas)))
    trainer.run(lambda step, values: None)
    return trainer


def naive_seconds(arrays: list[np.ndarray], cache: bool) -> float:
    """CPU seconds of a whole naive run: blocks are timed at several lengths of a real history and integrated."""
    lengths = [len(arrays[0]) * part // 5 for part in range(1, 6)]
    lengths = [20, *lengths]
    learner = naive.NaiveDisagreement(np.random.default_rng(0), cache=cache)
    seconds = [cpu_seconds(partial(learner.decide, *(part[:n] for part in arrays)), repeat=5) for n in lengths]
    return float(np.trapezoid([seconds[0], *seconds], [0, *lengths]))


def memory(few: int = 500, many: int = 2000) -> list[Row]:
    """Live tensors after few and many blocks with few and many draws: what blocks add must not depend on the draws."""
    live = {}
    for blocks in (few, many):
        for draws in (20, 80):
            trainer = fast(blocks, REPLICAS, draws)
            live[blocks, draws] = tensor_megabytes()
            del trainer
    added = {draws: live[many, draws] - live[few, draws] for draws in (20, 80)}
    product = 60 * REPLICAS * (many - few) * 8 / 2**20  # if one number a draw, replica and block were kept
    return [
        Row(f"tensors, 20 replicas, {many} blocks, 20 draws", f"{live[many, 20]:.1f} MiB"),
        Row(f"tensors, 20 replicas, {many} blocks, 80 draws", f"{live[many, 80]:.1f} MiB"),
        Row(f"what {many - few} more blocks add, 20 draws", f"{added[20]:.2f} MiB"),
        Row(
            f"what {many - few} more blocks add, 80 draws",
            f"{added[80]:.2f} MiB",
            "the same",
            abs(added[80] - added[20]) < product / 20,
        ),
        Row("peak memory of a fresh process, 20 replicas", f"{peak_megabytes(RUN.format(replicas=REPLICAS)):.0f} MiB"),
    ]


def agreement(arrays: list[np.ndarray], seeds: int = 12, blocks: int = 150) -> list[Row]:
    """Equal fits on equal windows; the same bootstrap variance; the same regret within its interval."""
    states, actions, _, labels = arrays
    trainer = fast(len(labels), 1, first_seed=7)
    belief = trainer.belief()
    assert belief is not None
    fitted, mse, _ = naive.proxies(states, actions, labels, 400, np.random.default_rng(1))
    gap = max(float(np.abs(belief.mean[0, j].numpy() - table.ravel()).max()) for j, table in enumerate(fitted.values()))
    ratio = float(np.exp(np.log(belief.mse[0, 0].numpy() / mse["ridge"].ravel()).mean()))
    ours = fast(blocks, seeds)
    theirs = np.array([naive_regret(seed, blocks) for seed in range(seeds)])
    difference = ours.judge.measure({}, None)["regret/cumulative"].numpy() - theirs
    low, high = stats.t.interval(0.95, seeds - 1, loc=difference.mean(), scale=stats.sem(difference))
    return [
        Row("largest difference of point fits on the same 2,000 windows", f"{gap:.1e}", "≤ 1e-8", gap <= 1e-8),
        Row(
            "bootstrap variance over the naive one (20 and 400 draws)",
            f"{ratio:.2f}",
            "1 ± .3",
            abs(ratio - 1) < 0.3,
        ),
        Row(
            f"regret less the naive one, {blocks} blocks, {seeds} seeds [95%]",
            f"{difference.mean():+.1f} [{low:+.1f}, {high:+.1f}]",
            "includes 0",
            bool(low <= 0 <= high),
        ),
    ]


def naive_regret(seed: int, blocks: int) -> float:
    """Final regret of a naive run in the same environment with the same random numbers."""
    trainer: Trainer = schema.build(compose(["method=disagreement", f"trainer.steps={7 * blocks}"]), "trainer")
    trainer.start((seed,))
    learner = naive.NaiveDisagreement(np.random.default_rng(seed))
    for _ in range(blocks):
        windows, primitive = trainer.collector.collect(Follower(learner), 1)
        trainer.judge.update(windows, primitive, trainer.agent)
        trainer.store.append(windows)
        learner.decide(*arrays_of(trainer.store.windows))
    return float(trainer.judge.measure({}, None)["regret/cumulative"][0])


class Follower:
    """Acts as the naive learner does.

    Args:
        learner: which.
    """

    def __init__(self, learner: naive.NaiveDisagreement) -> None:
        self._learner = learner

    def act(self, states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
        """The naive learner's actions."""
        return torch.from_numpy(self._learner.policy)[states]


def arrays_of(windows: Windows) -> list[np.ndarray]:
    """States, actions, next states [K, T] and labels [K] of the first replica."""
    rows = (windows.grid(part)[0].numpy() for part in (windows.states, windows.actions, windows.next_states))
    return [*rows, windows.labels[0].numpy()]
