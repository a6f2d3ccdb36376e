"""Single environments side by side in other processes, each with some of them."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any

import cloudpickle  # type: ignore[import-untyped]

from credit.core.errors import RunError
from credit.envs.gymnasium.copies import Here, Make, Out


class Elsewhere:
    """N environments in worker processes, which step theirs at the same time.

    Processes are made anew (`spawn`): a fork of a process with threads may hang.

    Args:
        make: one of them; what it needs is sent along. count: N. workers: processes, at most N.
    """

    def __init__(self, make: Make, count: int, workers: int) -> None:
        workers = min(workers, count)
        self._owner = [n % workers for n in range(count)]
        self._place = [n // workers for n in range(count)]
        if multiprocessing.get_start_method() not in multiprocessing.get_all_start_methods():
            # inside a worker of joblib's it is "loky", which would be told to a new interpreter that does not know it
            multiprocessing.set_start_method("spawn", force=True)
        context = multiprocessing.get_context("spawn")
        self._pipes, self._processes = list[Connection](), list[Any]()
        for worker in range(workers):
            here, there = context.Pipe()
            own = self._owner.count(worker)
            process = context.Process(target=_serve, args=(there, cloudpickle.dumps(make), own), daemon=True)
            process.start()
            there.close()
            self._pipes.append(here)
            self._processes.append(process)

    def reset(self, which: Sequence[int], seeds: Sequence[int]) -> list[Any]:
        """The first observations of new episodes."""
        return self._asked("reset", which, seeds)

    def step(self, which: Sequence[int], actions: Sequence[Any]) -> list[Out]:
        """One step each."""
        return self._asked("step", which, actions)

    def close(self) -> None:
        """Let all go."""
        for pipe in self._pipes:
            pipe.close()  # a worker whose pipe is closed ends
        for process in self._processes:
            process.join(timeout=5)
            process.kill()

    def _asked(self, method: str, which: Sequence[int], arguments: Sequence[Any]) -> list[Any]:
        """What the copies say, in their order.

        Raises:
            RunError: an environment raised, or a worker is gone.
        """
        asked: dict[int, list[int]] = {}
        for index, n in enumerate(which):
            asked.setdefault(self._owner[n], []).append(index)
        said: list[Any] = [None] * len(which)
        try:
            for worker, indices in asked.items():
                places = [self._place[which[index]] for index in indices]
                self._pipes[worker].send((method, places, [arguments[index] for index in indices]))
            answers = {worker: self._pipes[worker].recv() for worker in asked}
        except (EOFError, OSError) as error:
            gone = [process.pid for process in self._processes if not process.is_alive()]
            raise RunError(
                f"env.workers: a worker process died in {method} (process {', '.join(map(str, gone)) or 'unknown'}); "
                "if the machine ran out of memory, take fewer workers or copies"
            ) from error
        for worker, indices in asked.items():
            if isinstance(answers[worker], Exception):
                raise answers[worker]
            for index, answer in zip(indices, answers[worker], strict=True):
                said[index] = answer
        return said


def _serve(pipe: Connection, make: bytes, count: int) -> None:
    """Answer until the pipe is closed."""
    copies = Here(cloudpickle.loads(make), count)
    try:
        while True:
            method, which, arguments = pipe.recv()
            try:
                answer: Any = getattr(copies, method)(which, arguments)
            except Exception as error:
                answer = error
            pipe.send(answer)
    except (EOFError, OSError, KeyboardInterrupt):
        copies.close()
