"""What a run has for others, by the ending of the file: its policy as ONNX, for where there is no credit and no Python
(a phone, a browser, a controller), or the windows that it learned from as a table."""

from __future__ import annotations

import importlib.util
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from credit.core.errors import RAISED, UserError
from credit.core.version import __version__
from credit.runs import steps
from credit.runs.evaluate import seeds_of
from credit.runs.policies import POLICY, Kept, read

SUFFIX, TABLES = ".onnx", (".csv", ".parquet")
ENDINGS = f"{SUFFIX} (its policy), or in {' or '.join(TABLES)} (the windows that it learned from)"
INPUTS, OUTPUTS = ("observation", "step"), ("action",)
BEHAVIOUR = "behaviour"
TRIED = 16  # observations on which the file must do as the policy does
ALIKE = 1e-4  # of actions that are numbers: other libraries add in another order


def export(run: str | Path, file: str | Path, policy: str = BEHAVIOUR) -> Path:
    """Write a run's policy as an ONNX file, or the windows that it learned from as a table, as the file's ending says.

    A policy's file does what the policy does: that is tried before it is written. Its inputs are `observation`, [1, O]
    float32 (what the environment shows, as `gymnasium.spaces.flatten` has it) or [1] int64 where that is a number, and
    `step` [1] int64, that of the episode. Its output is `action` [1, ...], in the environment's own space. A table has
    a row a step, and the label in the last row of its window (`runs/steps.py`): what `credit recover` reads.

    Args:
        run: the folder of a seed, or of all seeds of a run: then the first one's policy, or the windows of all.
        file: ends in .onnx, .csv or .parquet; its folder is there.
        policy: which, where a run has several: `greedy` without bonus, `averaged`, …

    Returns:
        The file.

    Raises:
        UserError: what is asked for cannot be written, or ONNX cannot say what the policy does; nothing was written.

    Example:
        >>> credit.export("outputs/CartPole-v1/reference/default/seed-0", "cartpole.onnx", policy="greedy")
        PosixPath('cartpole.onnx')
    """
    target = Path(file)
    if target.suffix not in (SUFFIX, *TABLES):
        raise UserError(f"{target}: what is written follows from the ending; give a file that ends in {ENDINGS}")
    if not target.parent.is_dir():
        raise UserError(f"{target}: there is no folder {target.parent}; make it first")
    if target.suffix in TABLES:
        if policy != BEHAVIOUR:
            raise UserError(
                f"policy={policy} has no effect: {target} is a table of windows; leave it out, or write .onnx"
            )
        return steps.write(run, target)
    if not importlib.util.find_spec("onnxscript"):
        raise UserError("PyTorch writes ONNX by onnxscript, which is not installed; pip install 'credit-rl[onnx]'")
    folder = seeds_of(Path(run))[0]
    kept = Kept(read(folder), folder / POLICY)
    model = _model(kept, policy)
    partial = target.with_name(f".{target.name}.partial")
    try:
        partial.write_bytes(model.SerializeToString())
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)
    return target


class _Acting(torch.nn.Module):
    """A policy, and what its environment makes of an action, as one function of tensors."""

    def __init__(self, kept: Kept, name: str) -> None:
        super().__init__()
        self._policy, self._env = kept.named(name), kept.env

    def forward(self, observation: Tensor, step: Tensor) -> Tensor:
        """The action [1, ...] for one observation [1, ...] at one step [1]."""
        return self._env.recorded(self._policy.act(observation[None], step[None])[0])


def _model(kept: Kept, name: str) -> Any:
    """The policy in ONNX.

    Raises:
        UserError: that cannot be, or it does something else.
    """
    acting, examples = _Acting(kept, name), _examples(kept)
    what = f"{kept.source}: policy={name}"
    with torch.no_grad():
        wanted, again = ([acting(*example) for example in examples] for _ in range(2))
    if not all(map(torch.equal, wanted, again)):
        raise UserError(f"{what} draws its actions at random, which a file cannot; take another of the run's policies")
    try:
        with torch.no_grad(), _quiet():
            program = torch.onnx.export(
                acting, examples[0], dynamo=True, input_names=INPUTS, output_names=OUTPUTS, verbose=False
            )
    except RAISED as error:  # of the exporter, which knows many ways to fail
        reason = str(error.__cause__ or error).strip().partition("\n")[0]
        raise UserError(f"{what} cannot be said in ONNX: {reason}") from error
    assert program is not None
    program.model.metadata_props.update(
        {
            "credit": __version__,
            "experiment": str(kept.config["experiment"]),
            "method": str(kept.config["method"]),
            "seed": str(kept.seed),
            "policy": name,
            "observation_space": str(kept.problem.observation_space),
            "action_space": str(kept.problem.action_space),
        }
    )
    model = program.model_proto
    _try(model, examples, wanted, what)
    return model


def _examples(kept: Kept) -> list[tuple[Tensor, Tensor]]:
    """Observations to try it on, at the steps of episodes, one after the other."""
    problem, numbers = kept.problem, torch.Generator().manual_seed(0)
    if problem.finite_states:
        seen = torch.randint(problem.states, (TRIED, 1), generator=numbers)
    else:
        seen = torch.randn(TRIED, 1, problem.observations, generator=numbers)
    steps = torch.arange(TRIED).unsqueeze(1) % problem.horizon
    return [*zip(seen, steps, strict=True)]


def _try(model: Any, examples: list[tuple[Tensor, Tensor]], wanted: list[Tensor], what: str) -> None:
    """Refuse a file that does something else.

    Raises:
        UserError: it does.
    """
    from onnx.reference import ReferenceEvaluator

    run = ReferenceEvaluator(model)
    for example, action in zip(examples, wanted, strict=True):
        (found,) = run.run(None, {name: part.numpy() for name, part in zip(INPUTS, example, strict=True)})
        if not np.allclose(found, action.numpy(), rtol=0, atol=ALIKE):
            raise UserError(f"{what} would not be followed by its file ({found.tolist()} for {action.tolist()})")


@contextmanager
def _quiet() -> Iterator[None]:
    """The exporter tells of packages that nobody needs here."""
    log = logging.getLogger("torch.onnx")
    before = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(before)
