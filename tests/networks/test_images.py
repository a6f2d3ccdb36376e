"""A convolution on a part of a vector, against PyTorch's own layers and on MiniGrid; modules by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

from credit.agents.dqn import DQN
from credit.config import registry, schema
from credit.core.errors import UserError
from credit.networks.images import Convolution
from credit.networks.modules import Module
from credit.testing.runs import goes_on

CPU = torch.device("cpu")
GRID = (
    *("env=gymnasium", "env.id=MiniGrid-Empty-5x5-v0", "env.wrappers=[minigrid.wrappers:ImgObsWrapper]"),
    *("method=delayed", "tracking=none"),
    *("+network@agent.network=convolution", "agent.network.shape=[7,7,3]"),
    *("agent.network.channels=[4,4]", "agent.network.hidden=[8]"),
)
AGENTS = {"ppo": ("agent=ppo", "agent.epochs=1"), "dqn": ("agent=dqn", "agent.batch=8")}


def config(name: str) -> dict[str, Any]:
    found = registry.compose([*GRID, *AGENTS[name]])
    found["trainer"] |= {"steps": 60, "steps_per_round": 20, "random_steps": 0, "log_every": 1}
    return found | {"env": found["env"] | {"max_steps": 10, "evaluation_episodes": 1}}


@pytest.mark.parametrize("first", [0, 2])
def test_it_sees_the_image_and_what_is_beside_it(first: int) -> None:
    network = Convolution((4, 5, 3), first, divide=10.0, channels=(2, 6), kernel=2, hidden=(7,)).make(60 + 4, 3, CPU)
    values = torch.randint(11, (8, 64), generator=torch.Generator().manual_seed(0)).float()
    convolutions = [layer for layer in network.modules() if isinstance(layer, nn.Conv2d)]
    image = values[:, first : first + 60].reshape(8, 4, 5, 3).permute(0, 3, 1, 2) / 10
    for layer in convolutions:
        image = nn.functional.conv2d(image, layer.weight, layer.bias).relu()
    assert image.shape == (8, 6, 2, 3)
    linear = [layer for layer in network.modules() if isinstance(layer, nn.Linear)]
    beside = torch.cat([image.flatten(1), values[:, :first], values[:, first + 60 :]], -1)
    expected = linear[1](linear[0](beside).relu())
    torch.testing.assert_close(network(values), expected)
    torch.testing.assert_close(network(values.view(2, 4, 64)), expected.view(2, 4, 3))
    torch.testing.assert_close(network(values[0]), expected[0])


def test_images_that_do_not_fit_are_refused() -> None:
    with pytest.raises(UserError, match=r"an image of 147 numbers from number 0 on, and networks see 100"):
        Convolution((7, 7, 3)).make(100, 2, CPU)
    with pytest.raises(UserError, match=r"kernel=3: convolution 2 of 2 sees an image of 2×2"):
        Convolution((4, 4, 1)).make(16, 2, CPU)
    with pytest.raises(UserError, match=r"height, width, channels"):
        Convolution((4, 4))


def test_a_module_by_its_name() -> None:
    made = Module("torchrl.modules:MLP", {"num_cells": [5]}).make(4, 3, CPU)
    assert made(torch.zeros(2, 4)).shape == (2, 3)
    for name, words in {
        "torch.nn:Nothing": "give package.module:Class",
        "torch:Tensor": "no class of torch.nn",
    }.items():
        with pytest.raises(UserError, match=words):
            Module(name)
    with pytest.raises(UserError, match="cannot be made for 4 numbers and 3 outputs"):
        Module("torch.nn:Linear", {"width": 3}).make(4, 3, CPU)
    with pytest.raises(UserError, match=r"makes \[2, 4\] of \[2, 4\], and it must be \[2, 3\]"):
        Module("torch.nn:Threshold").make(4, 3, CPU)


def test_a_network_and_dueling_are_refused() -> None:
    with pytest.raises(UserError, match="leave one out"):
        DQN(dueling=True, network=Module("torch.nn:Linear"))


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.thorough) for name in AGENTS])
def test_agents_see_a_grid_as_an_image(name: str) -> None:
    trainer = schema.build(config(name), "trainer")
    trainer.start((3, 4))
    rows = list[float]()
    trainer.run(lambda step, values: rows.append(step))
    assert trainer.rounds >= 2
    modules = trainer.agent._online._frame[0] if name == "dqn" else trainer.agent._learners[0]._network
    assert sum(isinstance(layer, nn.Conv2d) for layer in modules.modules()) == 2
    assert name == "ppo" or not trainer.agent._online.loops


@pytest.mark.slow
@pytest.mark.parametrize("name", AGENTS)
def test_a_run_goes_on_to_the_bit(name: str, tmp_path: Path) -> None:
    goes_on(config(name), tmp_path, (3, 4), slice(0, 1))


class Looks(nn.Sequential):
    """Looks at batches, while it is in training mode."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(nn.BatchNorm1d(inputs), nn.Dropout(0.5), nn.Linear(inputs, outputs))


def test_trying_a_module_leaves_no_trace() -> None:
    made = Module(f"{Looks.__module__}:Looks").make(4, 2, CPU)
    assert not made.training
    assert torch.equal(made.get_buffer("0.running_var"), torch.ones(4))
