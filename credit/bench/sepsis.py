"""`credit bench sepsis`: whole runs with thousands of unknown rewards, and one refit against a dense solve."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from credit.bench.measure import Row, cpu_seconds, tensor_megabytes
from credit.config import schema
from credit.core.problem import FLOAT, Problem
from credit.core.windows import Windows
from credit.recovery.models.table import TableModel
from credit.recovery.places import Table
from credit.runs.composing import compose
from credit.trainer import Trainer

REPLICAS = 4
EPISODES = 5_000
VISITED = 2_000
DRAWS = 20
ROUND = 10  # episodes between two refits


def run(say: Callable[[str], None] = lambda line: None) -> list[Row]:
    """Measure everything in this process, on one thread; about two minutes."""
    torch.set_num_threads(1)
    fast(100)  # warm-up
    say(f"disagreement, {EPISODES} episodes, {REPLICAS} replicas")
    ours = cpu_seconds(lambda: fast(EPISODES)) / REPLICAS
    hypotheses = cpu_seconds(lambda: fast(EPISODES, "credit_hypotheses")) / REPLICAS
    say(f"{4 * EPISODES} episodes")
    growth = cpu_seconds(lambda: fast(4 * EPISODES)) / REPLICAS / ours
    say(f"one refit at {VISITED} visited pairs, against a dense solve")
    return [
        Row("CPU seconds a seed, 5,000 episodes, 20 draws, refit every 10", f"{ours:.2f}", "≤ 4", ours <= 4),
        Row("CPU seconds a seed, credit_hypotheses", f"{hypotheses:.2f}"),
        Row("time of 20,000 episodes over that of 5,000", f"{growth:.2f}", "≤ 6", growth <= 6),
        *refits(),
    ]


def fast(episodes: int, method: str = "disagreement") -> Trainer:
    """Run a method on the sepsis simulator; the finished trainer."""
    options = [f"trainer.steps={5 * episodes}", f"uncertainty.draws={DRAWS}"]
    options += [f"trainer.windows_per_round={ROUND}"] if method == "disagreement" else []
    trainer: Trainer = schema.build(compose(["experiment=sepsis", f"method={method}", *options]), "trainer")
    trainer.start(tuple(range(REPLICAS)))
    trainer.run(lambda step, values: None)
    return trainer


def refits() -> list[Row]:
    """The next refit after 2,000 pairs were visited: conjugate gradient from the last solution, and a dense solve."""
    problem, windows, weights = experience()
    model: TableModel = schema.build(compose(["experiment=sepsis"]), "reference")
    model.start(problem, Table(problem, problem.cells))
    count, ours = windows.labels.shape[1], list[float]()
    for start in range(0, count, ROUND):
        rows = slice(start, start + ROUND)
        ours.append(cpu_seconds(partial(model.fit, part_of(windows, rows), weights[:, rows])))
    last = sum(ours[-5:]) / 5
    held = tensor_megabytes()
    solutions: list[Tensor] = []
    dense = cpu_seconds(lambda: solutions.extend(dense_fits(problem, windows, weights, model.regularization)))
    estimate = model.estimate()
    assert estimate.draws is not None
    fits = torch.cat([estimate.mean, estimate.draws[0]])
    exact = torch.stack(solutions)
    error = float(((fits - exact).abs().amax(1) / exact.abs().amax(1)).max())
    visited = len(windows.pairs(problem.actions).unique())
    return [
        Row(f"milliseconds a refit of {1 + DRAWS} fits, {visited} pairs, {count} episodes", f"{1e3 * last:.1f}"),
        Row("milliseconds a refit, dense solves", f"{1e3 * dense:.0f}"),
        Row("ratio to the dense solve", f"{dense / last:.0f}", "≥ 100", dense / last >= 100),
        Row("largest relative difference to it", f"{error:.1e}", "≤ 1e-4", error <= 1e-4),
        Row("tensors held, windows and weights included", f"{held:.1f} MiB"),
    ]


def experience() -> tuple[Problem, Windows, Tensor]:
    """Random episodes until 2,000 pairs were visited, with the bootstrap's weights."""
    trainer: Trainer = schema.build(compose(["experiment=sepsis", "method=random"]), "trainer")
    trainer.start((0,))
    trainer.run(lambda step, values: None)
    windows = trainer.store.windows
    pairs = windows.grid(windows.pairs(trainer.problem.actions))[0]
    seen = torch.zeros(trainer.problem.pairs, dtype=torch.bool)
    count = 0
    while seen.sum() < VISITED:
        seen[pairs[count]] = True
        count += 1
    drawn = torch.poisson(torch.ones(1, count, DRAWS, dtype=FLOAT), torch.Generator().manual_seed(0))
    weights = torch.cat([torch.ones(1, count, 1, dtype=FLOAT), drawn], dim=-1)
    return trainer.problem, part_of(windows, slice(0, count)), weights


def part_of(windows: Windows, rows: slice) -> Windows:
    """Some of the windows."""
    steps = (windows.states, windows.actions, windows.next_states)
    states, actions, arrivals = (windows.grid(part)[:, rows] for part in steps)
    return Windows.of_grid(states, actions, arrivals, windows.labels[:, rows])


def dense_fits(problem: Problem, windows: Windows, weights: Tensor, regularization: float) -> list[Tensor]:
    """Every fit by the normal equations of the visited pairs, written out; θ [S·A] each."""
    pairs = windows.grid(windows.pairs(problem.actions))[0]
    visited, columns = pairs.unique(return_inverse=True)
    x = torch.zeros(len(pairs), len(visited), dtype=FLOAT)
    x.scatter_add_(1, columns.view(pairs.shape), torch.ones_like(pairs, dtype=FLOAT))
    fits = []
    for weight in weights[0].T:
        weighted = x * weight.unsqueeze(1)
        system = weighted.T @ x + regularization * torch.eye(len(visited), dtype=FLOAT)
        table = torch.zeros(problem.pairs, dtype=FLOAT)
        table[visited] = torch.linalg.solve(system, weighted.T @ windows.labels[0])
        fits.append(table)
    return fits
