"""Environments. `import credit` registers `credit/Advertiser-v0` and `credit/Sepsis-v0` with Gymnasium.

Gymnasium knows no plug-ins; without that import, `gymnasium.make("credit.envs:credit/Sepsis-v0")` does the same. Only
strings are registered: PyTorch is imported when an environment is made.
"""

from __future__ import annotations

import gymnasium

gymnasium.register("credit/Advertiser-v0", entry_point="credit.envs.advertiser.environment:AdvertiserEnv")
gymnasium.register("credit/Sepsis-v0", entry_point="credit.envs.sepsis.environment:SepsisEnv")
