"""The sepsis simulator of section 6.2: its states, exact values, start and Gymnasium face."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
import yaml
from gymnasium.utils.env_checker import check_env

import credit.envs
from credit.core.errors import UserError
from credit.core.problem import FLOAT
from credit.envs.feedback import BlockSum
from credit.envs.sepsis.environment import (
    RADIX,
    STATES,
    Sepsis,
    SepsisEnv,
    abnormal,
    decode,
    encode,
    reward,
    treatments,
)

from ..collecting import collected

ALL = torch.arange(STATES)
MDP = Sepsis().mdp
HORIZON = 5
# additive, terminal: the known values under the start distribution
VALUES = {
    "optimal": (0.427, 0.208),
    "random": (-0.982, -0.237),
    "nothing": (-1.775, -0.485),
    "antibiotics and ventilator": (-0.108, -0.022),
}


def policy_of(name: str, additive: bool) -> torch.Tensor:
    """Probabilities of actions [T, S, A]."""
    if name == "random":
        return torch.full((HORIZON, STATES, 8), 1 / 8, dtype=FLOAT)
    if name == "optimal":
        chosen = MDP.optimal(HORIZON, additive)[1]
    else:
        chosen = torch.full((HORIZON, STATES), 0 if name == "nothing" else 5)
    return torch.nn.functional.one_hot(chosen, 8).to(FLOAT)


def test_states_are_digits() -> None:
    digits = decode(ALL)
    assert digits.shape == (STATES, 8)
    assert torch.equal(encode(digits), ALL)
    assert digits.amax(0).tolist() == [base - 1 for base in RADIX.values()]
    assert decode(torch.tensor([[1, 8], [648, 1295]])).tolist()[1] == [[1, *[0] * 7], [1, 2, 2, 2, 2, 1, 1, 1]]
    assert int(encode(torch.tensor([0, 1, 1, 1, 1, 0, 0, 0]))) == 216 + 72 + 24 + 8


def test_counts_and_reward_by_hand() -> None:
    states = encode(
        torch.tensor(
            [
                [0, 1, 1, 1, 1, 0, 0, 0],  # healthy
                [1, 1, 1, 1, 1, 0, 0, 0],  # healthy with diabetes
                [0, 1, 1, 1, 1, 0, 1, 0],  # well under treatment
                [0, 0, 2, 1, 1, 0, 0, 0],
                [0, 0, 2, 0, 1, 0, 0, 0],
                [1, 0, 0, 0, 0, 1, 1, 1],
            ]
        )
    )
    assert abnormal(states).tolist() == [0, 0, 0, 2, 3, 4]
    assert treatments(states).tolist() == [0, 0, 1, 0, 0, 3]
    assert reward(states).tolist() == [1, 1, 0, 0, -1, -1]
    assert torch.equal(MDP.reward_next, reward(ALL))
    assert int((MDP.reward_next == 1).sum()) == 2


def test_size_of_the_transition_table() -> None:
    assert MDP.probabilities.shape == (STATES * 8, 81)
    assert int((MDP.probabilities > 0).sum()) == 89_186
    assert all(len(set(successors)) == 81 for successors in MDP.next_states[::97].tolist())


@pytest.mark.parametrize("name", VALUES)
def test_exact_values(name: str) -> None:
    for additive, expected in zip((True, False), VALUES[name], strict=True):
        value = MDP.evaluate(policy_of(name, additive).unsqueeze(0), additive)
        assert float(value) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("name", VALUES)
def test_simulation_agrees_with_the_exact_values(name: str) -> None:
    episodes = 200_000
    for additive in (True, False) if name == "optimal" else (True,):
        policy = policy_of(name, additive)
        cumulative, generator = policy.cumsum(-1), torch.Generator().manual_seed(1)

        def act(states: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
            draw = torch.rand(*states.shape, 1, dtype=FLOAT, generator=generator)  # noqa: B023
            return (cumulative[step, states] <= draw).sum(-1)  # noqa: B023

        feedback, seeds = BlockSum(HORIZON, noise=0), tuple(range(800))
        windows, primitive = collected(Sepsis(), feedback, seeds, act, episodes // 800)
        assert torch.equal(windows.labels, primitive.sum(-1))
        for objective, returns in ((True, primitive.sum(-1)), (False, primitive[..., -1])):
            exact = float(MDP.evaluate(policy.unsqueeze(0), objective))
            half_width = 3.2905 * float(returns.std()) / np.sqrt(episodes)  # 99.9%
            assert abs(float(returns.mean()) - exact) < half_width


def test_start_states() -> None:
    states = ALL[MDP.initial > 0]
    assert len(states) == 50
    assert set(abnormal(states).tolist()) == {1, 2}
    assert (treatments(states) == 0).all()
    assert (decode(states)[:, 3] != 2).all()  # oxygen is never high
    # with diabetes only glucose is high, against only heart rate and blood pressure low
    weight = [
        float(MDP.initial[int(encode(torch.tensor(s)))]) for s in ([1, 1, 1, 1, 2, 0, 0, 0], [0, 0, 0, 1, 1, 0, 0, 0])
    ]
    assert weight[0] / weight[1] == pytest.approx((0.2 * 0.5 * 0.5 * 0.8 * 0.79) / (0.8 * 0.25 * 0.25 * 0.8 * 0.6))


@pytest.mark.parametrize(
    ("key", "value", "digit", "zero"),
    [
        ("start_heart_rate", (0.5, 0.5, 0.0), 1, 2),
        ("start_blood_pressure", (0.0, 0.5, 0.5), 2, 0),
        ("start_oxygen", (0.0, 1.0, 0.0), 3, 0),
    ],
)
def test_start_keys(key: str, value: tuple[float, ...], digit: int, zero: int) -> None:
    initial = Sepsis(**{key: value}).mdp.initial  # type: ignore[arg-type]
    at = decode(ALL)[:, digit]
    assert float(initial[at == zero].sum()) == 0
    assert float(MDP.initial[at == zero].sum()) > 0
    assert float(initial.sum()) == pytest.approx(1)


def test_start_keys_of_patients_with_diabetes() -> None:
    diabetes, glucose = decode(ALL)[:, 0], decode(ALL)[:, 4]
    for key, patients in (("start_glucose", 0), ("start_glucose_diabetes", 1)):
        initial = Sepsis(**{key: (0.0, 1.0, 0.0)}).mdp.initial  # type: ignore[arg-type]
        assert float(initial[(diabetes == patients) & (glucose != 1)].sum()) == 0
        assert float(initial[(diabetes != patients) & (glucose != 1)].sum()) > 0
    assert float(Sepsis(diabetes=0.0).mdp.initial[diabetes == 1].sum()) == 0
    assert float(Sepsis(diabetes=1.0).mdp.initial[diabetes == 0].sum()) == 0


def test_the_yaml_file_has_every_key_and_its_default() -> None:
    path = Path(credit.envs.__file__).parents[2] / "conf" / "env" / "sepsis.yaml"
    written = yaml.safe_load(path.read_text())
    assert written.pop("_target_") == "credit.envs.sepsis.environment.Sepsis"
    defaults = {name: parameter.default for name, parameter in inspect.signature(Sepsis).parameters.items()}
    assert written == {name: list(value) if isinstance(value, tuple) else value for name, value in defaults.items()}


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"start_oxygen": (0.2, 0.7, 0.0)}, r"env\.start_oxygen=\[0\.2, 0\.7, 0\.0\].*sum to 1"),
        ({"start_glucose": (0.5, 0.5)}, r"env\.start_glucose=.*three probabilities"),
        ({"start_heart_rate": (-0.5, 1.0, 0.5)}, r"env\.start_heart_rate="),
        ({"vasopressors_low_to_normal": 0.7}, r"vasopressors_low_to_normal.*vasopressors_low_to_high.*1\.1.*at most 1"),
        (
            {name: (0.0, 1.0, 0.0) for name in inspect.signature(Sepsis).parameters if name.startswith("start_")},
            "1 or 2 abnormal",
        ),
        (
            {"start_heart_rate": (1, 0, 0), "start_blood_pressure": (1, 0, 0), "start_oxygen": (1, 0, 0)},
            "1 or 2 abnormal",
        ),
    ],
)
def test_invalid_parameters(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        Sepsis(**parameters)


@pytest.mark.parametrize("key", ["fluctuation", "antibiotics_lower", "vasopressors_glucose"])
@pytest.mark.parametrize("value", [1.2, -0.1])
def test_probabilities_outside_their_range_are_named(key: str, value: float) -> None:
    with pytest.raises(UserError, match=rf"Sepsis\({key}={value}\): .*; allowed: float ≥ 0"):
        Sepsis(**{key: value})  # type: ignore[arg-type]


def test_gymnasium_accepts_the_environment() -> None:
    env = gymnasium.make("credit/Sepsis-v0").unwrapped
    check_env(env)
    assert env.observation_space == gymnasium.spaces.Discrete(STATES)
    assert env.action_space == gymnasium.spaces.Discrete(8)


def test_gymnasium_tells_the_patient_in_words() -> None:
    env = SepsisEnv(horizon=2, render_mode="ansi", diabetes=1.0)
    state, info = env.reset(seed=3)
    digits = decode(torch.tensor(state)).tolist()
    assert info["diabetes"] == "yes"
    assert info["heart rate"] == ("low", "normal", "high")[digits[1]]
    assert info["antibiotics"] == "off"
    state, gained, terminated, _, info = env.step(5)
    assert (info["step"], info["antibiotics"], info["vasopressors"], info["ventilator"]) == (1, "on", "off", "on")
    assert gained == float(reward(torch.tensor(state)))
    assert not terminated
    assert env.step(0)[2]
    env.state, env.taken = int(encode(torch.tensor([0, 2, 1, 0, 1, 1, 0, 0]))), 1
    assert env.render() == (
        "step 1 of 2: diabetes no · heart rate high · blood pressure normal · oxygen low · glucose normal · "
        "antibiotics on · vasopressors off · ventilator off"
    )
    assert SepsisEnv().render() is None
