"""Made the runs beside this file, with the code of 6a61dfa: PYTHONPATH=<its checkout> python make.py"""

import contextlib

import credit

WORDS = ["trainer.steps=210", "trainer.log_every=5", "tracking=none", "output=runs"]


def stop(title: str, steps: int, total: int) -> None:
    if steps >= 140:
        raise KeyboardInterrupt


credit.run(["method=reference", "replicas=2", *WORDS])
credit.run(["experiment=sepsis", "method=random", "replicas=1", "feedback=terminal", *WORDS])
with contextlib.suppress(KeyboardInterrupt):
    credit.run(["method=delayed", "replicas=1", "checkpoint_seconds=0", *WORDS], progress=stop)
