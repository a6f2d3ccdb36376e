"""An environment of one's own: a kiosk that is told its profit once a week. Gymnasium's rules, and nothing of credit.

Run:  python examples/own_environment.py
"""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np

import credit

ROOM, ORDERS, DAYS = 10, (0, 2, 4), 28


class Kiosk(gymnasium.Env[np.int64, np.int64]):
    """What lies in the kiosk in the evening is what it sees; how many boxes to order for tomorrow is what it does.

    A box that is sold brings 1, one that is ordered costs .4, and .1 a night while it lies there.
    """

    metadata: ClassVar = {"render_modes": []}
    observation_space = gymnasium.spaces.Discrete(ROOM + 1)
    action_space = gymnasium.spaces.Discrete(len(ORDERS))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.int64, dict[str, Any]]:
        """An empty kiosk."""
        super().reset(seed=seed)
        self._boxes = 0
        return np.int64(0), {}

    def step(self, action: np.int64) -> tuple[np.int64, float, bool, bool, dict[str, Any]]:
        """A day: the order comes, two boxes are asked for on average, what is left waits for tomorrow."""
        ordered = ORDERS[int(action)]
        boxes = min(ROOM, self._boxes + ordered)
        sold = min(boxes, int(self.np_random.poisson(2)))
        self._boxes = boxes - sold
        return np.int64(self._boxes), sold - 0.4 * ordered - 0.1 * self._boxes, False, False, {}


gymnasium.register("Kiosk-v0", entry_point=Kiosk, max_episode_steps=DAYS)
WORDS = ["env=gymnasium", "env.id=Kiosk-v0", "feedback=block_sum", "feedback.window=7", "trainer.steps=2800"]


def main(replicas: int = 3) -> dict[str, float]:
    """Two methods on the kiosk; what each earns in four weeks after a hundred that it learned from."""
    found = {}
    for method in ("random", "reference"):
        result = credit.run([*WORDS, f"method={method}", f"replicas={replicas}", "tracking=none"])
        found[method] = float(result.metrics["eval/return"].mean())
        print(f"{method:<10} earns {found[method]:.1f} in {DAYS} days")
    return found


if __name__ == "__main__":
    main()
