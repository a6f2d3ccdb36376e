"""The same code on a GPU, where there is one."""

from __future__ import annotations

import pytest
import torch

from credit.config import files, registry, schema
from credit.runs.job import check, checked

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")


@pytest.mark.parametrize("method", files.options("method"))
def test_every_method_runs_on_cuda(method):
    short = ["tracking=none", f"method={method}", "device=cuda", "trainer.steps=150", "replicas=2"]
    configs = (
        registry.compose([f"experiment={name}", *short])
        for name in sorted(files.options("experiment"))
        if not name.startswith("generic")
    )
    config = next(config for config in configs if not check(config).problems)
    trainer = schema.build(checked(config), "trainer")
    trainer.start((0, 1), torch.device("cuda"))
    rows = []
    trainer.run(lambda step, values: rows.append(values))
    assert torch.isfinite(rows[-1]["regret/cumulative"]).all()
    assert rows[-1]["regret/cumulative"].device.type == "cuda"


@pytest.mark.parametrize("uncertainty", ["last_layer", "dropout", "ensemble"])
def test_a_maze_runs_on_cuda(uncertainty):
    short = ["agent.first_updates=20", "agent.updates=20", "trainer.steps=600", "trainer.windows_per_round=1"]
    options = [
        "tracking=none",
        "experiment=pointmaze",
        "device=cuda",
        "replicas=2",
        f"uncertainty={uncertainty}",
        *short,
    ]
    trainer = schema.build(checked(registry.compose(options)), "trainer")
    trainer.start((0, 1), torch.device("cuda"))
    rows = []
    trainer.run(lambda step, values: rows.append(values))
    assert rows[-1]["eval/success"].shape == (2,)
    assert trainer.agent.memory.rows["next", "reward"].device.type == "cuda"
