"""`credit.run` leaves the process as it found it, unless it is asked for more."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

import credit
from credit.core.errors import UserError
from credit.trainer import Trainer

NUMBERS = (signal.SIGINT, signal.SIGTERM)
WORDS = ("method=random", "replicas=1", "trainer.steps=140", "tracking=none")


class Heard(Exception):
    """A signal reached the handler that the program had set."""


@pytest.fixture
def own_handlers() -> Iterator[Any]:
    """Handlers of the program that uses credit."""

    def hear(number: int, frame: Any) -> None:
        raise Heard

    before = {number: signal.signal(number, hear) for number in NUMBERS}
    yield hear
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def three_threads() -> Iterator[None]:
    """What a program may have set for itself."""
    torch.set_num_threads(3)
    yield
    torch.set_num_threads(1)


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[tuple[int, list[Any]]]:
    """Threads and handlers in the middle of every round."""
    found: list[tuple[int, list[Any]]] = []
    learn = Trainer._learn

    def look(trainer: Trainer, *experience: Any, **how: Any) -> None:
        found.append((torch.get_num_threads(), [signal.getsignal(number) for number in NUMBERS]))
        learn(trainer, *experience, **how)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Trainer, "_learn", look)
    return found


def test_a_run_leaves_threads_and_handlers(own_handlers, three_threads, seen):
    credit.run(WORDS)
    assert len(seen) == 20
    assert all(facts == (3, [own_handlers] * 2) for facts in seen)


def test_a_run_sets_both_where_it_is_asked_and_gives_them_back(own_handlers, three_threads, seen):
    credit.run(WORDS, threads=2, signals=True)
    assert all(threads == 2 and own_handlers not in handlers for threads, handlers in seen)
    assert torch.get_num_threads() == 3
    assert [signal.getsignal(number) for number in NUMBERS] == [own_handlers] * 2


def signals_itself(trainer: Trainer, *experience: Any, **how: Any) -> None:
    os.kill(os.getpid(), signal.SIGTERM)


@pytest.mark.thorough
def test_a_signal_is_the_programs_unless_it_is_asked_for(own_handlers, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Trainer, "_learn", signals_itself)
    assert credit.run(WORDS).error == "Heard: "
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    learn, once = Trainer._learn, iter([signals_itself])

    def learn_and_signal(trainer: Trainer, *experience: Any, **how: Any) -> None:
        learn(trainer, *experience, **how)
        next(once, lambda _: None)(trainer)

    monkeypatch.setattr(Trainer, "_learn", learn_and_signal)
    with pytest.raises(KeyboardInterrupt):
        credit.run([*WORDS, "seed=1"], signals=True)
    assert len(list(tmp_path.rglob("seed-1/checkpoint.pt"))) == 1
    (ended,) = credit.resume(tmp_path / "outputs/advertiser/random/trainer.steps=140/seed-1")
    assert ended.resumed == [1]


def test_less_than_one_thread_is_refused(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match="threads=0: at least 1 is needed"):
        credit.run(WORDS, threads=0)
    assert not list(tmp_path.iterdir())
