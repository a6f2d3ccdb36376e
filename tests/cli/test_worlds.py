"""Other people's environments through two short rounds of the command line: TorchRL's, packages', wrapped ones."""

from __future__ import annotations

import csv
import sys

import gymnasium
import pytest

SHORT = ("replicas=2", "tracking=none", "env.evaluation_episodes=1", "trainer.log_every=1")
ROUNDS = ("trainer.steps=60", "trainer.steps_per_round=30")
PENDULUM = ("env=torchrl", "env.target=torchrl.envs.PendulumEnv", "env.keys=[th,thdot]")
ENDLESS = ("env=gymnasium", "env.id=CartPole-v1", "env.horizon=9", "feedback=block_sum", "feedback.window=5")
SAC = ("agent.width=8", "agent.update_ratio=.1", "agent.batch=8", "trainer.random_steps=30")
LAKE = ("env=torchrl", "env.target=torchrl.envs.GymEnv", "env.kwargs={env_name: FrozenLake-v1}", "env.max_steps=9")
PACKAGE = '''"""Registers an environment, and has a wrapper."""
import gymnasium

class Twice(gymnasium.RewardWrapper):
    def reward(self, reward):
        return 2 * reward

class Five(gymnasium.Env):
    observation_space = gymnasium.spaces.Discrete(2)
    action_space = gymnasium.spaces.Discrete(2)
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return 0, {}
    def step(self, action):
        return 1, 5.0, False, False, {}

gymnasium.register("Five-v0", entry_point=Five, max_episode_steps=4)
'''


def journal(folder):
    (path,) = folder.rglob("seed-1/metrics.csv")
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("words", "name", "method"),
    [
        pytest.param((*LAKE, *ROUNDS), "torchrl.envs.GymEnv", "disagreement", id="finite"),
        pytest.param((*PENDULUM, "env.max_steps=6", *ROUNDS, *SAC), "torchrl.envs.PendulumEnv", "delayed", id="box"),
        pytest.param(
            (*PENDULUM, "env.horizon=6", "feedback=block_sum", "feedback.window=5", *ROUNDS, *SAC),
            *("torchrl.envs.PendulumEnv", "delayed"),
            id="box-endless",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore")  # TorchRL looks for the old gym, which warns
def test_two_rounds_of_a_torchrl_environment(credit, folder, words, name, method):
    ended = credit("train", *words, f"method={method}", *SHORT)
    assert ended.code == 0, ended.err
    assert (folder / "outputs" / name / method).is_dir()
    rows = journal(folder)
    assert [int(row["step"]) for row in rows] == [30, 60]
    assert 50 < float(rows[-1]["collect/steps"]) <= 60  # of windows that are over


@pytest.mark.thorough
def test_an_id_of_a_package_in_wrappers_by_name(credit, folder, monkeypatch):
    """The package is imported by `package:id`; the innermost wrapper stands first."""
    (folder / "fives_of_mine.py").write_text(PACKAGE)
    monkeypatch.syspath_prepend(folder)
    wrappers = "env.wrappers=[fives_of_mine:Twice,TimeAwareObservation]"
    words = ("env=gymnasium", "env.id=fives_of_mine:Five-v0", "method=random", *SHORT, *ROUNDS)
    try:
        ended = credit("train", *words, wrappers)
        assert ended.code == 0, ended.err
    finally:
        sys.modules.pop("fives_of_mine", None)
    row = journal(folder)[-1]
    assert float(row["eval/return"]) == 4 * 2 * 5
    assert (folder / "outputs/fives_of_mine-Five-v0/random").is_dir()


EXITS = PACKAGE.replace("return 1, 5.0", "raise SystemExit(3)\n        return 1, 5.0").replace("Five-v0", "Exits-v0")


@pytest.mark.parametrize("workers", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_an_environment_that_ends_python_ends_a_run(credit, folder, monkeypatch, workers):
    """The run has failed, and says why."""
    (folder / "exits_of_mine.py").write_text(EXITS)
    monkeypatch.syspath_prepend(folder)
    words = ("env=gymnasium", "env.id=exits_of_mine:Exits-v0", "method=random", *SHORT, *ROUNDS)
    try:
        ended = credit("train", *words, f"env.workers={workers}")
    finally:
        sys.modules.pop("exits_of_mine", None)
        gymnasium.registry.pop("Exits-v0", None)
    assert ended.code == 1
    assert "raised in step, seed 0, copy 0 for environment, episode 1, step 0: SystemExit: 3" in ended.err + ended.out
    (run,) = folder.rglob("seed-0/summary.json")
    assert "FAILED" in run.read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("env=torchrl", "env.target=GymEnv"), "env.target='GymEnv' is no dotted path"),
        ((*PENDULUM, "env.max_steps=6", "env.horizon=6"), "give one of the two"),
        (PENDULUM, "comes without a time limit"),
        (("env=gymnasium", "env.id=Pendulum-v1", "env.horizon=50"), "goes on for ever: no label would ever come"),
        (
            (*ENDLESS, "agent.timed=true"),
            "DQN needs a task that is episodic",
        ),
        (("env=gymnasium", "env.id=CartPole-v1", "env.wrappers=[nowhere:Wrapper]"), "there is no 'nowhere:Wrapper'"),
    ],
)
def test_misuse_is_told_before_anything_starts(credit, folder, words, said):
    ended = credit("train", *words, "method=reference", *SHORT)
    assert ended.code == 2
    assert said in ended.err
    assert not (folder / "outputs").exists()
