"""Environments. Importing this package registers `credit/Advertiser-v0` and `credit/Sepsis-v0` with Gymnasium."""

from __future__ import annotations

import gymnasium

gymnasium.register("credit/Advertiser-v0", entry_point="credit.envs.advertiser.environment:AdvertiserEnv")
gymnasium.register("credit/Sepsis-v0", entry_point="credit.envs.sepsis.environment:SepsisEnv")
