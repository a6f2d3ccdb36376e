"""Our Gymnasium ids. Gymnasium finds no plug-ins by itself, and importing it takes twenty times as long as `credit`."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

IDS = {
    "credit/Advertiser-v0": "credit.envs.advertiser.environment:AdvertiserEnv",
    "credit/Sepsis-v0": "credit.envs.sepsis.environment:SepsisEnv",
}


def register() -> None:
    """Tell Gymnasium our ids; what stands behind them is imported by `gymnasium.make`."""
    import gymnasium

    for name, entry_point in IDS.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point=entry_point)


def register_soon() -> None:
    """Tell Gymnasium our ids now, if somebody has imported it, or as soon as somebody does."""
    if "gymnasium" in sys.modules:
        register()
    else:
        sys.meta_path.insert(0, _Waiting())


class _Waiting:
    """Looks for Gymnasium where the others look, and registers our ids behind its import."""

    def find_spec(self, name: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != "gymnasium":
            return None
        finders = (finder for finder in sys.meta_path if finder is not self)
        spec = next(filter(None, (finder.find_spec(name, path, target) for finder in finders)), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module: ModuleType) -> None:
                execute(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                    register()

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec
