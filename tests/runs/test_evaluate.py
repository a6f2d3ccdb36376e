"""What kept policies are worth: exactly, in episodes of their own, and what cannot be judged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

import credit
from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.streams import generators
from credit.envs.advertiser.environment import Advertiser
from credit.envs.episodes import Grid
from credit.envs.feedback import BlockSum
from credit.runs.evaluate import changed, evaluate, labels_of, seeds_of

SHORT = ("replicas=2", "tracking=none")
CART = ("env=gymnasium", "env.id=CartPole-v1", "method=delayed", "trainer.steps=600", "trainer.steps_per_round=600")


def ran(output: Path, *words: str) -> Path:
    """The folder of all seeds of a finished run."""
    return credit.run([*words, *SHORT, f"output='{output}'"]).folders[0].parent


@pytest.fixture(scope="module")
def advertiser(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("advertiser"), "method=reference", "trainer.steps=140")


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("cart"), *CART, "env.evaluation_episodes=4", "agent.updates=1")


def test_the_average_reward_of_a_policy() -> None:
    mdp = Advertiser().mdp
    chances = torch.rand(2, mdp.states, mdp.actions, dtype=FLOAT, generator=torch.Generator().manual_seed(0))
    chances /= chances.sum(-1, keepdim=True)
    for own, found in zip(chances, mdp.gains(chances), strict=True):
        chain = torch.einsum("sa,sat->st", own, mdp.transition)
        long = torch.linalg.matrix_power(chain, 10_000)
        assert float(found) == pytest.approx(float(mdp.initial @ long @ (own * mdp.reward).sum(-1)))
    assert float(mdp.gains(mdp.optimal.policy[None])) == pytest.approx(float(mdp.optimal.gain))


def test_exactly_where_the_environment_knows(advertiser: Path) -> None:
    found = evaluate(advertiser)
    assert found.attrs["exact"]
    assert found.index.names == ["run", "seed"]
    run, mdp = credit.load(advertiser / "seed-1"), Advertiser().mdp
    assert run.recovery is not None
    worth = float(mdp.gains(torch.from_numpy(run.recovery["policy"])[None]))
    assert found.loc[(str(advertiser), 1), "reward"] == pytest.approx(worth)
    assert found["best"].tolist() == pytest.approx([float(mdp.optimal.gain)] * 2)


def test_in_an_environment_with_another_parameter(advertiser: Path) -> None:
    found = evaluate(advertiser, changes={"env.p_down": 0.05})
    assert found["best"].iloc[0] == pytest.approx(float(Advertiser(p_down=0.05).mdp.optimal.gain))
    assert found["best"].iloc[0] != pytest.approx(evaluate(advertiser)["best"].iloc[0])
    config = credit.load(advertiser / "seed-0").config
    assert config["env"] == changed(config, {})["env"]  # what was read stays as it was


def test_exactly_in_episodes(tmp_path: Path) -> None:
    words = (
        "env=gymnasium",
        "env.id=FrozenLake-v1",
        "method=random",
        "trainer.steps=400",
        "trainer.steps_per_round=200",
    )
    found = evaluate(ran(tmp_path, *words))
    assert found.attrs["exact"]
    assert found["return"].tolist() == pytest.approx(found["random"].tolist())  # uniform actions are
    assert (found["best"] > 0.7).all()


def test_in_episodes_of_its_own(cart: Path) -> None:
    found = evaluate(cart, 6)
    assert not found.attrs["exact"]
    assert found.index.names == ["run", "seed", "episode"]
    assert found.groupby("seed").size().tolist() == [6, 6]
    assert (found["return"] == found["length"]).all()  # CartPole pays 1 a step
    assert np.allclose(found["label"], found["return"], atol=1e-9)  # the label is the episode's sum
    pd.testing.assert_frame_equal(found, evaluate([cart / "seed-0", cart / "seed-1"], 6))
    assert (evaluate(cart, 6, seed=1)["return"].to_numpy() != found["return"].to_numpy()).any()
    first = evaluate(cart / "seed-0", 3)
    assert first["return"].tolist() == found["return"].iloc[:3].tolist()


def test_what_is_asked_is_checked_first(advertiser: Path, cart: Path) -> None:
    for changes, said in (
        ({"env.p_dwon": 0.1}, r"env\.p_dwon: unknown key .* did you mean 'p_down'"),
        ({"env.p_down": 2}, r"env\.p_down=2: .*≤ 1"),
        ({"mixer.alpha": 1}, r"mixer\.alpha=1: only the environment"),
        ({"env.states": 6}, r"observations Discrete\(10\), and the environment has Discrete\(6\)"),
    ):
        with pytest.raises(UserError, match=said):
            evaluate(advertiser, changes=changes)
    with pytest.raises(UserError, match="episodes=0"):
        evaluate(advertiser, 0)
    with pytest.raises(UserError, match="evaluate them apart"):
        evaluate([advertiser, cart], 1)
    with pytest.raises(UserError, match=r"no run lies here; below it there are .*trainer\.steps=140"):
        evaluate(advertiser.parent)


def test_the_folders_of_a_run(advertiser: Path, tmp_path: Path) -> None:
    assert [place.name for place in seeds_of(advertiser)] == ["seed-0", "seed-1"]
    for seed in (10, 9):
        (tmp_path / f"seed-{seed}").mkdir()
        (tmp_path / f"seed-{seed}" / "config.yaml").touch()
    assert [place.name for place in seeds_of(tmp_path)] == ["seed-9", "seed-10"]


def grid(lengths: list[int], longest: int) -> Grid:
    """Episodes of one seed with rewards 1, 2, 3, …"""
    active = torch.arange(longest) < torch.tensor(lengths).unsqueeze(-1)
    rewards = (torch.arange(1.0, longest + 1, dtype=FLOAT) * active).unsqueeze(0)
    blank = torch.zeros(1, len(lengths), longest)
    return Grid(blank, blank, blank, active.unsqueeze(0), rewards, rewards, blank.bool(), {})


@pytest.mark.parametrize(
    ("window", "cut", "labels"),
    [
        (2, "label", [(3 + 7 + 5) / 3, 3.0]),
        (2, "drop", [(3 + 7) / 2, 3.0]),
        ([1, 1], "label", [3.0, 1.5]),
        (4, "drop", [10.0, float("nan")]),
    ],
)
def test_labels_of_windows_inside_episodes(window: int | list[int], cut: str, labels: list[float]) -> None:
    feedback = BlockSum(window, noise=0.0, cut=cut)  # type: ignore[arg-type]
    most = window if isinstance(window, int) else window[1]
    problem = Problem.finite(2, 2, most, (0,), episodic=True)
    feedback.start(problem)
    found = labels_of(grid([5, 2], 6), feedback, problem, generators((0,), "windows")[0])
    assert found == pytest.approx(labels, nan_ok=True)
