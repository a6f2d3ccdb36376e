"""What was logged becomes windows: against a walk along the rows in plain Python, and refused by column and row."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pandas as pd
import pytest
import torch

from credit.core.checks import check_windows
from credit.core.errors import UserError
from credit.core.problem import Problem
from credit.core.seams import Environment, Feedback
from credit.data.logged import Logged
from credit.envs.advertiser.environment import Advertiser
from credit.envs.feedback import BlockSum, EpisodeSum, Mean, Success
from credit.envs.gymnasium.environment import Gymnasium
from credit.envs.playback import windows_of
from credit.envs.recorded import read
from credit.rounds import problem_of

from ..minari_datasets import written as minari_written

SEEDS = (3, 8)
LENGTHS = (5, 1, 7, 4)  # of episodes; the second is over, the others were cut short
Columns = dict[str, Any]


def walk(lengths: tuple[int, ...] = LENGTHS, states: int = 16) -> Columns:
    """Steps of a finite environment, and rewards that tell which row they are of."""
    count, numbers = sum(lengths), np.random.default_rng(0)
    episode = np.repeat(np.arange(len(lengths)), lengths)
    seen = numbers.integers(0, states, count)
    arrivals = np.append(seen[1:], 0)
    arrivals[np.cumsum(lengths) - 1] = states - 1
    over = (episode == 1) & (np.diff(episode, append=-1) != 0)
    rewards = 2.0 ** -np.arange(count)
    columns = {"episode": episode, "observation": seen, "action": seen % 2, "next_observation": arrivals}
    return {**columns, "reward": rewards, "terminated": over.astype(int)}


def saved(folder: Path, columns: Columns, **changed: Any) -> Path:
    kept = {name: column for name, column in {**columns, **changed}.items() if column is not None}
    pd.DataFrame(kept).to_csv(folder / "log.csv", index=False)
    return folder / "log.csv"


def lake(feedback: Feedback) -> tuple[Environment, Problem]:
    env = Gymnasium("FrozenLake-v1")
    return env, problem_of(env, feedback, SEEDS, "cpu", rolling=True)


@pytest.mark.parametrize("feedback", [EpisodeSum(), BlockSum(3, noise=0), Mean(3), BlockSum(3, noise=0, cut="drop")])
def test_the_feedback_cuts_and_labels_inside_episodes(tmp_path: Path, feedback: Feedback) -> None:
    columns = walk()
    env, problem = lake(feedback)
    windows, primitive = windows_of(read(saved(tmp_path, columns), env, problem), feedback, problem)
    check_windows(windows, problem)
    labels, last, begins = list[float | None](), list[int](), 0
    for row, episode in enumerate(columns["episode"]):
        ends = row + 1 == sum(LENGTHS) or columns["episode"][row + 1] != episode
        if not (ends or row + 1 - begins == feedback.window):
            continue
        mine = columns["reward"][begins : row + 1]
        short = feedback.window is not None and len(mine) < feedback.window
        label = mine.mean() if isinstance(feedback, Mean) else mine.sum()
        labels.append(None if short and feedback.cut == "drop" else float(label))
        last.append(row)
        begins = row + 1
    assert primitive is not None
    for replica in range(len(SEEDS)):
        assert windows.ends[replica].tolist() == last
        known = [True] * len(labels) if windows.labelled is None else windows.labelled[replica].tolist()
        assert [x if there else None for x, there in zip(windows.labels[replica].tolist(), known, strict=True)] == (
            pytest.approx(labels)
        )
        assert windows.states[replica].tolist() == columns["observation"].tolist()
        assert windows.next_states[replica].tolist() == columns["next_observation"].tolist()
        assert primitive[replica].tolist() == columns["reward"].tolist()
        assert windows.times[replica].tolist() == [t for length in LENGTHS for t in range(length)]
        assert windows.terminated is not None
        assert windows.terminated[replica].tolist() == columns["terminated"].astype(bool).tolist()


def test_noise_is_the_same_for_all_replicas_and_never_the_runs_own(tmp_path: Path) -> None:
    feedback = BlockSum(3, noise=0.5, delay=7, missing=0.4)
    env, problem = lake(feedback)
    feedback.start(problem)
    before = feedback.state_dict()
    logged = read(saved(tmp_path, walk()), env, problem)
    windows, _ = windows_of(logged, feedback, problem)
    again, _ = windows_of(logged, feedback, replace(problem, seeds=(5,)))
    assert torch.equal(windows.labels[0], windows.labels[1])
    assert torch.equal(windows.labels[0], again.labels[0])
    assert str(feedback.state_dict()) == str(before)
    assert (feedback.delay, len(windows.labels[0])) == (7, 8)  # a label that would be late has come


def test_lengths_are_drawn_by_the_rule(tmp_path: Path) -> None:
    feedback = BlockSum([2, 4], noise=0)
    env, problem = lake(feedback)
    windows, _ = windows_of(read(saved(tmp_path, walk((40, 60))), env, problem), feedback, problem)
    lengths = windows.lengths[0].tolist()
    assert {2, 3, 4} <= set(lengths) <= {1, 2, 3, 4}
    assert windows.lengths[0].sum() == 100


def test_labels_of_the_file_stay(tmp_path: Path) -> None:
    feedback = BlockSum(5, noise=9.0)
    env, problem = lake(feedback)
    label = [np.nan, 1.5, np.nan, np.nan, np.nan, 0.5, *[np.nan] * 4, -2.0, np.nan, np.nan, *[np.nan] * 3, 4.0]
    windows, primitive = windows_of(
        read(saved(tmp_path, walk(), label=label, reward=None), env, problem), feedback, problem
    )
    assert primitive is None
    assert windows.ends[1].tolist() == [1, 4, 5, 10, 12, 16]
    assert windows.labels[1].tolist() == [1.5, 0, 0.5, -2, 0, 4]
    assert windows.labelled is not None
    assert windows.labelled[1].tolist() == [True, False, True, True, False, True]


def test_windows_of_a_grid_have_all_their_steps(tmp_path: Path) -> None:
    env, feedback = Advertiser(), BlockSum(3, noise=0)
    problem = problem_of(env, feedback, SEEDS, "cpu", rolling=False)
    columns = walk((8, 2, 4), states=10)
    windows, primitive = windows_of(read(saved(tmp_path, columns), env, problem), feedback, problem)
    rows = [0, 1, 2, 3, 4, 5, 10, 11, 12]
    assert (windows.length, windows.step, windows.last) == (3, None, None)
    assert windows.states[0].tolist() == columns["observation"][rows].tolist()
    assert windows.labels[1].tolist() == pytest.approx(columns["reward"][rows].reshape(3, 3).sum(1).tolist())
    assert primitive is not None
    assert primitive[1].tolist() == columns["reward"][rows].tolist()
    labelled = saved(tmp_path, walk((3, 4), states=10), label=[np.nan, np.nan, 1, *[np.nan] * 3, 2])
    with pytest.raises(UserError, match="4 steps, and here they have at most 3"):
        windows_of(read(labelled, env, problem), feedback, problem)
    labelled = saved(tmp_path, walk((3, 2), states=10), label=[np.nan, np.nan, 1, np.nan, 2])
    with pytest.raises(UserError, match=r"window 1 has 2 steps and the label 2; .* all have 3 steps"):
        windows_of(read(labelled, env, problem), feedback, problem)
    with pytest.raises(UserError, match="no window of 3 steps"):
        windows_of(read(saved(tmp_path, walk((2, 2), states=10)), env, problem), feedback, problem)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"observation": np.full(17, 16)},
            r"observation of row 0 \(episode 0, step 0\) is 16: allowed are whole numbers from 0 to 15",
        ),
        ({"action": np.arange(17) % 5}, "action of row 4 is 4.0, and here it must be of Discrete"),
        ({"action": np.arange(17) / 2}, "action of row 1 is 0.5, and here it must be of Discrete"),
        (
            {"next_observation": np.full(17, 15)},
            r"next_observation 15 of row 0 \(.* is not the observation",
        ),
        ({"episode": [0] * 5 + [1] + [0] * 7 + [2] * 4}, "3 episodes in 4 pieces"),
        ({"terminated": np.ones(17)}, "row 0 is terminated, and its episode goes on"),
        ({"step": np.zeros(17)}, "step of row 1 is 0; steps of an episode rise by one"),
        ({"step": np.r_[98:103, 0, 0:7, 0:4]}, "row 2 is step 100 of its episode .* at most 100 steps"),
        ({"observation": None, "observation_0": np.zeros(17), "observation_1": np.zeros(17)}, "has the shape \\[2\\]"),
        ({"label": np.arange(17.0), "window": np.r_[0, 0, 1:16]}, "row 0 has a label, and is not the last row"),
    ],
)
def test_what_does_not_fit_is_told_by_column_and_row(tmp_path: Path, changed: Columns, said: str) -> None:
    env, problem = lake(EpisodeSum())
    with pytest.raises(UserError, match=said) as caught:
        read(saved(tmp_path, walk(), **changed), env, problem)
    assert "log.csv" in str(caught.value)


def test_bits_must_be_bits(tmp_path: Path) -> None:
    env = Gymnasium("FrozenLake-v1", success="reward")
    problem = problem_of(env, Success(None), SEEDS, "cpu", rolling=True)
    columns = walk()
    found, _ = windows_of(
        read(saved(tmp_path, columns, success=columns["action"]), env, problem), Success(None), problem
    )
    pieces = np.split(columns["action"], np.cumsum(LENGTHS)[:-1])
    assert found.labels[0].tolist() == [float(part.any()) for part in pieces]
    with pytest.raises(
        UserError, match=r"label of the window that ends with row 0 .* is 0\.5, and this feedback's are bits"
    ):
        windows_of(read(saved(tmp_path, columns, label=np.full(17, 0.5)), env, problem), Success(None), problem)


def test_actions_stand_in_the_environments_own_numbers(tmp_path: Path) -> None:
    env = Gymnasium("Pendulum-v1")
    problem = problem_of(env, EpisodeSum(), SEEDS, "cpu", rolling=True)
    states = {f"{name}_{i}": [0.0, 0.0] for name in ("observation", "next_observation") for i in range(3)}
    columns = {**states, "action_0": [-2.0, 1.0], "reward": [0, 0]}
    assert read(saved(tmp_path, columns), env, problem).actions.tolist() == [[-1.0], [0.5]]
    assert env.recorded(torch.tensor([[-1.0], [0.5]])).tolist() == [[-2.0], [1.0]]
    with pytest.raises(UserError, match=r"action of row 1 is \[3.0\], and here it must be of Box\(-2.0, 2.0"):
        read(saved(tmp_path, columns, action_0=[0.0, 3.0]), env, problem)
    with pytest.raises(UserError, match=r"action has the shape \[2\]"):
        read(saved(tmp_path, columns, action_1=[0.0, 0.0]), env, problem)
    with pytest.raises(UserError, match=r"observation has the shape \[4\], and here a step has 3 numbers"):
        read(saved(tmp_path, columns, observation_3=[0.0, 0.0]), env, problem)


def test_observations_far_outside_the_space_are_of_another_environment(tmp_path: Path) -> None:
    env = Gymnasium("Pendulum-v1")
    problem = problem_of(env, EpisodeSum(), SEEDS, "cpu", rolling=True)
    states = {f"{name}_{i}": [0.0, 0.0] for name in ("observation", "next_observation") for i in range(3)}
    columns = {**states, "action_0": [0.0, 0.0], "reward": [0, 0]}
    assert (
        len(read(saved(tmp_path, columns, next_observation_2=[0.0, 9.0]), env, problem)) == 2
    )  # a little: 8 is allowed
    with pytest.raises(
        UserError, match=r"row 1 \(episode 0, step 1\) is where nobody can be .* \(1 of 2 steps are so\)"
    ):
        read(saved(tmp_path, columns, next_observation_2=[0.0, 100.0]), env, problem)


def test_half_an_archive_is_named(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("trainer: {}")
    (tmp_path / "recovery.npz").write_bytes(b"PK\x03\x04 and nothing else")
    with pytest.raises(UserError, match=r"recovery\.npz cannot be read .* compute the run again"):
        read(tmp_path, *lake(EpisodeSum()))


class Parts(gymnasium.Env[Any, Any]):
    """Observations with parts, actions with digits."""

    observation_space = gymnasium.spaces.Dict(
        {"far": gymnasium.spaces.Box(-9, 9, (2,)), "kind": gymnasium.spaces.Discrete(3)}
    )
    action_space = gymnasium.spaces.MultiDiscrete([2, 3])


@pytest.mark.filterwarnings("ignore:.*env.*:UserWarning")
def test_a_minari_dataset_is_encoded_as_the_environment_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    gymnasium.register("Parts-v0", Parts, max_episode_steps=9)
    try:
        env = Gymnasium("Parts-v0")
        problem = problem_of(env, EpisodeSum(), SEEDS, "cpu", rolling=True)
        far = np.array([[1.0, 2], [3, 4], [5, 6]])
        seen = {"far": far, "kind": np.array([0.0, 2, 1])}
        minari_written("mine/parts-v0", [{"observations": seen, "actions": np.array([[0, 1], [1, 2.0]])}])
        found = read("mine/parts-v0", env, problem)
        assert found.states.tolist() == [[1, 2, 1, 0, 0], [3, 4, 0, 0, 1]]
        assert found.next_states.tolist() == [[3, 4, 0, 0, 1], [5, 6, 0, 1, 0]]
        assert found.actions.tolist() == [1, 5]
        assert (found.episode.tolist(), found.step.tolist()) == ([0, 0], [0, 1])
        odd = seen | {"kind": np.array([0.0, 3, 1])}
        minari_written("mine/odd-v0", [{"observations": odd, "actions": np.zeros((2, 2))}])
        with pytest.raises(UserError, match=r"mine/odd-v0, episode 0: observation\['kind'\] of row 1 is 3"):
            read("mine/odd-v0", env, problem)
        other = Gymnasium("Pendulum-v1")
        with pytest.raises(UserError, match=r"observation has the parts \['far', 'kind'\], and here it must be of Box"):
            read("mine/parts-v0", other, problem_of(other, EpisodeSum(), SEEDS, "cpu", rolling=True))
    finally:
        gymnasium.registry.pop("Parts-v0")


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("left_out", ["none", "episode"])
def test_a_log_without_a_row_is_said(tmp_path: Path, suffix: str, left_out: str) -> None:
    empty = pd.DataFrame({name: column for name, column in walk().items() if name != left_out}).iloc[:0]
    file = (tmp_path / "log").with_suffix(suffix)
    empty.to_csv(file, index=False) if suffix == ".csv" else empty.to_parquet(file)
    with pytest.raises(UserError, match=rf"log\{suffix}: there are no steps in it"):
        read(file, *lake(EpisodeSum()))
    file.write_text("")
    with pytest.raises(UserError, match=rf"log\{suffix}"):
        read(file, *lake(EpisodeSum()))


def test_what_is_nowhere_is_said(tmp_path: Path) -> None:
    env, problem = lake(EpisodeSum())
    (tmp_path / "log.txt").touch()
    with pytest.raises(UserError, match=r"log.txt: files of steps end in .csv or .parquet"):
        read(tmp_path / "log.txt", env, problem)
    with pytest.raises(UserError, match="there is no file and no run's folder of that name"):
        read(tmp_path / "none", env, problem)
    (tmp_path / "config.yaml").write_text("trainer: {}", encoding="utf-8")
    with pytest.raises(UserError, match=r"no steps were kept in this folder .* keep=\[steps\] rerun=true"):
        read(tmp_path, env, problem)


def test_a_digest_tells_steps_apart(tmp_path: Path) -> None:
    env, problem = lake(EpisodeSum())
    one: Logged = read(saved(tmp_path, walk()), env, problem)
    two = replace(one, source="elsewhere")
    assert one.digest == two.digest != replace(one, step=one.step + 1).digest
