"""The sepsis treatment simulator of section 6.2: four vitals and labs, diabetes, three treatments on or off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Annotated, Any

import torch
from annotated_types import Interval
from torch import Tensor

from credit.core.cells import Cells
from credit.core.errors import UserError
from credit.core.knowledge import KnownTransitions
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import Probability
from credit.envs.exact.episodic import EpisodicEnvironment, EpisodicGymEnv, SuccessorMDP

# A state (25) is the number with these digits, most significant first; vitals are low, normal, high = 0, 1, 2. An
# action is the number of the three treatment digits alone: antibiotics·4 + vasopressors·2 + ventilator.
RADIX = {
    "diabetes": 2,
    "heart rate": 3,
    "blood pressure": 3,
    "oxygen": 3,
    "glucose": 3,
    "antibiotics": 2,
    "vasopressors": 2,
    "ventilator": 2,
}
STATES, VITALS, ACTIONS = 1296, 81, 8  # VITALS: combinations of the four levels
LEVELS = ("low", "normal", "high")
STAY = torch.eye(3, dtype=FLOAT)
_BASE = torch.tensor(tuple(RADIX.values()))
_PLACE = STATES // _BASE.cumprod(0)

EachWay = Annotated[float, Interval(ge=0, le=0.5)]  # the probability of a move down, and the same again of one up


def decode(states: Tensor) -> Tensor:
    """The eight digits [..., 8] of states [...], in the order of `RADIX`."""
    return states.unsqueeze(-1) // _PLACE.to(states.device) % _BASE.to(states.device)


def encode(digits: Tensor) -> Tensor:
    """The states [...] of digits [..., 8]."""
    return (digits * _PLACE.to(digits.device)).sum(-1)


def abnormal(states: Tensor) -> Tensor:
    """A(s) [...], how many of the four vitals and labs are not normal."""
    return (decode(states)[..., 1:5] != 1).sum(-1)


def treatments(states: Tensor) -> Tensor:
    """U(s) [...], how many of the three treatments are on."""
    return decode(states)[..., 5:].sum(-1)


def reward(states: Tensor) -> Tensor:
    """r_true(s') [...] (26): +1 healthy and off treatment, −1 with three or more abnormal, else 0."""
    wrong, treated = abnormal(states), treatments(states)
    return ((wrong == 0) & (treated == 0)).to(FLOAT) - (wrong >= 3).to(FLOAT)


@dataclass(frozen=True)
class SepsisKnowledge(KnownTransitions):
    """What a clinician knows of a state's number: the digits that it has, and that the vitals move independently.

    Attributes:
        digits: name → how many values, most significant first.
    """

    digits: Mapping[str, int]


def require_patients(who: str, problem: Problem) -> None:
    """Refuse states that are no patients.

    Raises:
        UserError: names the component, what it knows, and what the problem has.
    """
    if (problem.states, problem.actions) != (STATES, ACTIONS):
        raise UserError(
            f"{who} knows patients of env=sepsis ({STATES} states, {ACTIONS} actions), and the environment has "
            f"{problem.states} states and {problem.actions} actions; choose another component in its place"
        )


class Sepsis(EpisodicEnvironment):
    """Sepsis simulator (6.2): 1296 states, 8 treatments; the reward looks at the state a step leads to (26).

    The action sets the treatments of s'. Effects come in the order antibiotics, ventilator, vasopressors, fluctuation,
    and a vital that a treatment acts on, or has just stopped to act on, does not fluctuate. Moves off the scale stay.

    Args:
        diabetes: share of patients with diabetes.
        start_heart_rate: probabilities of low, normal, high at the start, where all treatments are off.
        start_blood_pressure: likewise. start_oxygen: likewise. start_glucose: likewise, without diabetes.
        start_glucose_diabetes: likewise, with diabetes. A start is drawn again unless 1 or 2 vitals are abnormal.
        fluctuation: an untreated vital moves down with this probability, and up with the same.
        glucose_fluctuation: the same of glucose, without diabetes and not under vasopressors.
        glucose_fluctuation_diabetes: the same of glucose, with diabetes and not under vasopressors.
        antibiotics_lower: antibiotics bring a high heart rate, and a high blood pressure, to normal.
        antibiotics_withdrawn: without them a step later, normal ones become high.
        ventilator_raises: the ventilator brings low oxygen to normal.
        ventilator_withdrawn: without it a step later, normal oxygen becomes low.
        vasopressors_raise: vasopressors raise the blood pressure by one level, without diabetes.
        vasopressors_low_to_normal: from low to normal, with diabetes.
        vasopressors_low_to_high: from low to high, with diabetes.
        vasopressors_normal_to_high: from normal to high, with diabetes.
        vasopressors_glucose: vasopressors raise glucose by one level, with diabetes.
        vasopressors_withdrawn: without them a step later, blood pressure falls by one level, without diabetes.
        vasopressors_withdrawn_diabetes: the same with diabetes.
    """

    def __init__(
        self,
        diabetes: Probability = 0.2,
        start_heart_rate: Sequence[float] = (0.25, 0.5, 0.25),
        start_blood_pressure: Sequence[float] = (0.25, 0.5, 0.25),
        start_oxygen: Sequence[float] = (0.2, 0.8, 0.0),
        start_glucose: Sequence[float] = (0.2, 0.6, 0.2),
        start_glucose_diabetes: Sequence[float] = (0.06, 0.15, 0.79),
        fluctuation: EachWay = 0.1,
        glucose_fluctuation: EachWay = 0.1,
        glucose_fluctuation_diabetes: EachWay = 0.3,
        antibiotics_lower: Probability = 0.5,
        antibiotics_withdrawn: Probability = 0.1,
        ventilator_raises: Probability = 0.7,
        ventilator_withdrawn: Probability = 0.1,
        vasopressors_raise: Probability = 0.7,
        vasopressors_low_to_normal: Probability = 0.5,
        vasopressors_low_to_high: Probability = 0.4,
        vasopressors_normal_to_high: Probability = 0.9,
        vasopressors_glucose: Probability = 0.5,
        vasopressors_withdrawn: Probability = 0.1,
        vasopressors_withdrawn_diabetes: Probability = 0.05,
    ) -> None:
        if vasopressors_low_to_normal + vasopressors_low_to_high > 1:
            raise UserError(
                f"env.vasopressors_low_to_normal + env.vasopressors_low_to_high = "
                f"{vasopressors_low_to_normal + vasopressors_low_to_high:g}: at most 1 is allowed"
            )
        common = [
            _levels("start_heart_rate", start_heart_rate),
            _levels("start_blood_pressure", start_blood_pressure),
            _levels("start_oxygen", start_oxygen),
        ]
        glucose = (
            _levels("start_glucose", start_glucose),
            _levels("start_glucose_diabetes", start_glucose_diabetes),
        )
        self.initial = _start(diabetes, [[*common, of_patient] for of_patient in glucose])
        # 3 × 3 matrices, level → level; of pairs, the second is with diabetes
        self._fluctuates = _each_way(fluctuation)
        self._glucose = (_each_way(glucose_fluctuation), _each_way(glucose_fluctuation_diabetes))
        self._antibiotics = _moves({(2, 1): antibiotics_lower}), _moves({(1, 2): antibiotics_withdrawn})
        self._ventilator = _moves({(0, 1): ventilator_raises}), _moves({(1, 0): ventilator_withdrawn})
        self._vasopressors = (
            _moves({(0, 1): vasopressors_raise, (1, 2): vasopressors_raise}),
            _moves(
                {
                    (0, 1): vasopressors_low_to_normal,
                    (0, 2): vasopressors_low_to_high,
                    (1, 2): vasopressors_normal_to_high,
                }
            ),
        )
        self._vasopressors_off = tuple(
            _moves({(1, 0): fall, (2, 1): fall}) for fall in (vasopressors_withdrawn, vasopressors_withdrawn_diabetes)
        )
        self._vasopressors_glucose = (STAY, _moves({(0, 1): vasopressors_glucose, (1, 2): vasopressors_glucose}))

    @cached_property
    def mdp(self) -> SuccessorMDP:
        """P, r(s') and the start; each row lists the 81 combinations of vitals, most of them with probability zero."""
        table = torch.zeros(2, VITALS, ACTIONS, ACTIONS, VITALS, dtype=FLOAT)
        for diabetes, before, action in product(range(2), range(ACTIONS), range(ACTIONS)):
            # given diabetes and treatments, the vitals move independently of each other
            parts = self._vitals(diabetes, _bits(before), _bits(action))
            joint = torch.einsum("ae,bf,cg,dh->abcdefgh", *parts)
            table[diabetes, :, before, action] = joint.reshape(VITALS, VITALS)
        row = torch.arange(STATES * ACTIONS).unsqueeze(1)
        diabetes_of_row, action_of_row = row // (VITALS * ACTIONS * ACTIONS), row % ACTIONS
        successors = (diabetes_of_row * VITALS + torch.arange(VITALS)) * ACTIONS + action_of_row
        return SuccessorMDP(successors, table.reshape(-1, VITALS), reward(torch.arange(STATES)), self.initial)

    def knowledge(self) -> SepsisKnowledge:
        """The digits of a patient's number; and P, for oracles."""
        return SepsisKnowledge(self.mdp.transitions.backup, RADIX)

    def summary(self, cells: Cells) -> dict[str, Tensor]:
        """How many vitals are abnormal, and how many treatments are given: of s', or in s and by the action."""
        steps = cells.steps(torch.device("cpu"))
        states, given = (steps.next_states,) * 2 if cells.arrival else (steps.states, steps.actions)
        return {"abnormal vitals": abnormal(states), "treatments": treatments(given)}

    def _vitals(self, diabetes: int, before: tuple[int, ...], action: tuple[int, ...]) -> tuple[Tensor, ...]:
        """How heart rate, blood pressure, oxygen and glucose move, 3 × 3 each."""

        def effect(treatment: int, on: Tensor, withdrawn: Tensor, otherwise: Tensor) -> Tensor:
            return on if action[treatment] else withdrawn if before[treatment] else otherwise

        heart_rate = effect(0, *self._antibiotics, self._fluctuates)
        by_antibiotics = effect(0, *self._antibiotics, STAY)
        then = STAY if action[0] or before[0] else self._fluctuates
        by_vasopressors = effect(1, self._vasopressors[diabetes], self._vasopressors_off[diabetes], then)
        oxygen = effect(2, *self._ventilator, self._fluctuates)
        glucose = (self._vasopressors_glucose if action[1] else self._glucose)[diabetes]
        return heart_rate, by_antibiotics @ by_vasopressors, oxygen, glucose


def _bits(treated: int) -> tuple[int, ...]:
    return treated >> 2 & 1, treated >> 1 & 1, treated & 1


def _moves(probabilities: dict[tuple[int, int], float]) -> Tensor:
    """Level → level [3, 3]; what the moves leave over is to stay."""
    matrix = torch.zeros(3, 3, dtype=FLOAT)
    for (level, to), probability in probabilities.items():
        matrix[level, to] = probability
    return matrix + torch.diag(1 - matrix.sum(-1))


def _each_way(probability: float) -> Tensor:
    return _moves(dict.fromkeys(((0, 1), (1, 0), (1, 2), (2, 1)), probability))


def _levels(key: str, probabilities: Sequence[float]) -> Tensor:
    values = torch.tensor(tuple(probabilities), dtype=FLOAT)
    if len(values) != 3 or (values < 0).any() or abs(float(values.sum()) - 1) > 1e-9:
        raise UserError(f"env.{key}={list(probabilities)}: three probabilities (low, normal, high) that sum to 1")
    return values


def _start(diabetes: float, levels: list[list[Tensor]]) -> Tensor:
    """The start distribution [S], from the levels' of patients without and with diabetes."""
    drawn = torch.zeros(2, VITALS, ACTIONS, dtype=FLOAT)
    for patient, share in enumerate((1 - diabetes, diabetes)):
        drawn[patient, :, 0] = share * torch.einsum("a,b,c,d->abcd", *levels[patient]).flatten()
    wrong = abnormal(torch.arange(STATES))
    kept = drawn.flatten() * ((wrong >= 1) & (wrong <= 2))
    if kept.sum() <= 0:
        raise UserError(
            "env.start_*: no patient has 1 or 2 abnormal vitals, so that a start would be drawn again for ever; "
            "give some patients with 1 or 2 vitals that are not normal a probability above 0"
        )
    return kept / kept.sum()


class SepsisEnv(EpisodicGymEnv):
    """`credit/Sepsis-v0`: one patient as a Gymnasium environment; other keyword arguments as in `Sepsis`.

    Args:
        horizon: T, steps an episode.
        render_mode: `ansi` describes the patient in words.

    Example:
        >>> env = gymnasium.make("credit/Sepsis-v0", render_mode="ansi")
        >>> state, info = env.reset(seed=0)
    """

    def __init__(self, horizon: int = 5, render_mode: str | None = None, **parameters: Any) -> None:
        super().__init__(Sepsis(**parameters).mdp, horizon, render_mode)

    def info(self) -> dict[str, Any]:
        """The step, and the state in words."""
        words = {}
        for (name, radix), digit in zip(RADIX.items(), decode(torch.tensor(self.state)).tolist(), strict=True):
            words[name] = LEVELS[digit] if radix == 3 else ("off", "on")[digit]
        words["diabetes"] = "yes" if words["diabetes"] == "on" else "no"
        return {**super().info(), **words}

    def render(self) -> str | None:
        """The patient as one line of text."""
        if self.render_mode != "ansi":
            return None
        told = self.info()
        step, diabetes = told.pop("step"), told.pop("diabetes")
        patient = " · ".join(f"{name} {value}" for name, value in told.items())
        return f"step {step} of {self.horizon}: diabetes {diabetes} · {patient}"
