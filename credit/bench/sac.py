"""`credit bench sac`: updates and collection against other people's loops, and seeds side by side, on one thread."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import gymnasium
import gymnasium_robotics
import numpy as np
import torch
from torchrl.collectors import Collector
from torchrl.envs import DoubleToFloat, GymWrapper, TransformedEnv

from credit.agents.sac.agent import SAC
from credit.agents.sac.learner import Learner
from credit.agents.sac.networks import extract_actor
from credit.bench import peers
from credit.bench.measure import Row, taken_in_turns
from credit.bench.relabelling import relabelling
from credit.core.problem import Problem
from credit.envs.collect import Collector as OurCollector
from credit.envs.feedback import Success
from credit.envs.pointmaze.environment import PointMaze

PLAIN: dict[str, Any] = {"layer_norm": False, "policy_delay": 1, "n_step": 1, "success_share": 0, "target_clip": False}
FRAMES = 300


def run(say: Callable[[str], None] = lambda line: None) -> list[Row]:
    """Measure everything in this process, on one thread; about a minute."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    say("updates, 256×256 networks, batches of 256")
    rows = updates()
    say("collection")
    rows += collection()
    say("seeds side by side")
    rows += side_by_side()
    say("relabelling")
    return rows + relabelling()


def updates(rounds: int = 8) -> list[Row]:
    """Updates a second, sampling included."""
    works = {
        "the floor: matrix products of the same sizes": peers.products(),
        "ours": learner((0,), width=peers.WIDTH, batch=peers.BATCH, **PLAIN),
        "ours, compile=true": learner((0,), width=peers.WIDTH, batch=peers.BATCH, compile=True, **PLAIN),
        "plain PyTorch with fused Adam": peers.plain(),
        "TorchRL's SACLoss, replay buffer and Adam": peers.torchrl(),
    }
    other = peers.stable_baselines()
    if other:
        works["Stable-Baselines3"] = other
    seconds = {name: best / peers.UPDATES for name, best in taken_in_turns(works, rounds).items()}
    floor, ours, compiled, plain, stock, *rest = seconds.values()
    rows = [Row(f"updates a second, {name}", f"{1 / best:.0f}") for name, best in seconds.items()]
    rows += [
        Row("time of ours over the floor", f"{ours / floor:.2f}"),
        Row("the same, compiled", f"{compiled / floor:.2f}", "≤ 1.3", compiled <= 1.3 * floor),
        Row("speed over plain PyTorch", f"{plain / ours:.2f}"),
        Row("speed over TorchRL", f"{stock / ours:.2f}", "≥ 1.6", stock >= 1.6 * ours),
    ]
    if not rest:
        return [*rows, Row("speed over Stable-Baselines3", "not installed: pip install 'credit-rl[bench]'", "≥ 1.25")]
    return [*rows, Row("speed over Stable-Baselines3", f"{rest[0] / ours:.2f}", "≥ 1.25", rest[0] >= 1.25 * ours)]


def side_by_side(rounds: int = 8) -> list[Row]:
    """CPU time of eight seeds in one stack over one seed's."""
    rows = []
    for name, keys in (("plain", {"batch": 256, **PLAIN}), ("stable", {"batch": 64})):
        works = {str(seeds): learner(range(seeds), width=64, **keys) for seeds in (1, 8)}
        one, eight = (best / peers.UPDATES * 1e3 for best in taken_in_turns(works, rounds).values())
        what = f"64×64, {name}, batch {keys['batch']}: ms an update of 1 and of 8 seeds; ratio"
        met = eight <= 4 * one if name == "stable" else None
        rows.append(Row(what, f"{one:.2f}, {eight:.2f}; {eight / one:.1f}", "≤ 4" if met is not None else "", met))
    return rows


def learner(seeds: Sequence[int], **keys: Any) -> Callable[[], object]:
    """Our updates on the rows that the others get."""
    sac = Learner(learning_rate=peers.RATE, **keys)
    sac.make(4, 2, tuple(seeds))
    problem = Problem.vectors(4, 2, peers.LENGTH, tuple(seeds))
    replay, rows = sac.replay(problem), peers.transitions()
    replay.relabel(peers.windows(rows, len(seeds)), rows["next", "reward"][:, 0].expand(len(seeds), -1))
    return partial(sac.fit, replay, peers.UPDATES)


def collection(rounds: int = 4) -> list[Row]:
    """Environment steps a second with a 256×256 actor in the loop, on PointMaze Medium."""
    gymnasium.register_envs(gymnasium_robotics)
    sac, env, feedback = SAC(width=peers.WIDTH), PointMaze(successes=0, partials=0, failures=0), Success(FRAMES)
    problem = env.problem(FRAMES, (0,), "cpu")
    for part in (env, feedback, sac):
        part.start(problem)
    ours = OurCollector(env, feedback, problem)
    frames: dict[str, int] = {"TorchRL": FRAMES, "Gymnasium": FRAMES}
    works = {"TorchRL": stock_collector(sac), "Gymnasium": plain_loop(sac)}
    for balls in (5, 20):
        works[str(balls)], frames[str(balls)] = partial(ours.collect, sac, balls), FRAMES * balls
    seconds = taken_in_turns(works, rounds)
    rate = {name: frames[name] / best for name, best in seconds.items()}
    rows = [
        Row("steps a second, TorchRL's collector, one environment", f"{rate['TorchRL']:.0f}"),
        Row("steps a second, a plain Gymnasium loop", f"{rate['Gymnasium']:.0f}"),
        Row("steps a second, ours, a round of 5 and of 20 trajectories", f"{rate['5']:.0f}, {rate['20']:.0f}"),
    ]
    for name, target in (("TorchRL", 10), ("Gymnasium", 2)):
        ratios = [rate[balls] / rate[name] for balls in ("5", "20")]
        met = min(ratios) >= target
        rows.append(Row(f"steps over {name}'s, 5 and 20", f"{ratios[0]:.1f}, {ratios[1]:.1f}", f"≥ {target}", met))
    return rows


def gym_maze() -> gymnasium.Env:
    """PointMaze as Gymnasium has it."""
    return gymnasium.make("PointMaze_Medium-v3", continuing_task=False, max_episode_steps=FRAMES)


def stock_collector(sac: Learner) -> Callable[[], object]:
    """TorchRL's collector on one wrapped environment."""
    env = TransformedEnv(GymWrapper(gym_maze()), DoubleToFloat(in_keys=["observation"]))
    actor = extract_actor(sac.actor, 0)
    collector = Collector(env, actor, frames_per_batch=FRAMES, total_frames=-1, auto_register_policy_transforms=False)
    return partial(next, iter(collector))


def plain_loop(sac: Learner) -> Callable[[], object]:
    """One environment, one forward pass a step, rows in a list."""
    env = gym_maze()
    network = extract_actor(sac.actor, 0)[0].module

    def episode() -> list[Any]:
        observation, rows = env.reset()[0]["observation"], []
        for _ in range(FRAMES):
            with torch.no_grad():
                loc, scale = network(torch.as_tensor(observation, dtype=torch.float32))
                action = (loc + scale * torch.randn(2)).tanh().numpy()
            following, _, terminated, truncated, _ = env.step(action)
            rows.append((observation, action, np.float32(terminated)))
            observation = following["observation"]
            if terminated or truncated:
                observation = env.reset()[0]["observation"]
        return rows

    return episode
