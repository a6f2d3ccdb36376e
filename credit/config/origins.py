"""Where every value comes from: constructor, file, experiment, method, the user's own file, command line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.types import RunMode
from omegaconf import OmegaConf

from credit.config import classes, files, layers, registry
from credit.config.files import CONFIG_NAME
from credit.config.kinds import CHOICES, KINDS
from credit.core import signatures

COMMAND_LINE = "command line"


def explained(
    config: Mapping[str, Any], overrides: Sequence[str], config_dirs: Sequence[str] = ()
) -> list[tuple[str, Any, str]]:
    """Key, value and origin of all that a job is made of; `_target_` tells who chose the option, too.

    Args:
        config: composed and checked. overrides, config_dirs: what it was composed of.

    Example:
        >>> explained(config, ["experiment=sepsis"])
        [..., ('mixer.alpha', 1.0, 'experiment=sepsis'), ('mixer.epsilon', 1e-12, 'file mixer/relative_mse.yaml'), ...]
    """
    words = registry.with_experiment(overrides, config_dirs)
    said = {**dict(_said(words, config_dirs)), "slug": "credit"}
    for parsed in map(registry.parse, words):
        if parsed.key_or_group not in {*KINDS, *CHOICES}:
            said[parsed.key_or_group] = COMMAND_LINE
    return [(path, value, _origin(path, said)) for path, value in _values(config)]


def _origin(path: str, said: Mapping[str, str]) -> str:
    """Who says a key, or the nearest mapping around it, whichever said it last: the command line counts most."""
    parts = path.split(".")
    around = [".".join(parts[:end]) for end in range(len(parts), 0, -1)]
    if any(said.get(name) == COMMAND_LINE for name in around):
        return COMMAND_LINE
    return said.get(path, "constructor")


def _values(node: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Every key and its value, those included that only a constructor says."""
    hints = signatures.signature(classes.resolve(prefix, node)) if "_target_" in node else {}
    unsaid = {
        name: default
        for name, (hint, default) in hints.items()
        if name not in node and default is not signatures.REQUIRED and signatures.component_kind(hint) is None
    }
    for key, value in {**node, **unsaid}.items():
        path = f"{prefix}.{key}" if prefix else str(key)
        if isinstance(value, Mapping) and value:
            yield from _values(value, path)
        else:
            yield path, value


def _said(words: Sequence[str], config_dirs: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Key → who says it, in the order in which Hydra reads: what comes later counts."""
    with registry.composing(words, config_dirs) as layer:
        loader: Any = GlobalHydra.instance().config_loader()
        found = loader.compute_defaults_list(CONFIG_NAME, list(words), RunMode.RUN)
        choosers = found.overrides.override_metadata
        for default in found.defaults:
            name = str(default.config_path)
            if default.config_path is None or name.partition("/")[0] == "hydra":
                continue
            loaded = loader.repository.load_config(name)
            content = OmegaConf.to_container(loaded.config, resolve=False)
            assert isinstance(content, dict)
            own = loaded.path.startswith(layers.Own.scheme())
            who = _who(name, Path(loaded.path.partition("://")[2]), own)
            wishes = {} if own else {wish.key: wish.by for wish in layer.for_file(name, content)}
            chooser = choosers.get(default.override_key)
            package = default.package or ""
            for key in _keys(content):
                path = f"{package}.{key}" if package else key
                by = f" (chosen by {_chooser(chooser)})" if key == "_target_" and chooser else ""
                wished = next((says for start, says in wishes.items() if f"{key}.".startswith(f"{start}.")), None)
                yield path, wished or f"{who}{by}"


def _keys(node: Mapping[Any, Any], prefix: str = "") -> Iterator[str]:
    for key, value in node.items():
        path = f"{prefix}.{key}" if prefix else str(key)
        if isinstance(value, Mapping) and value:
            yield from _keys(value, path)
        else:
            yield path


def _who(name: str, folder: Path, own: bool) -> str:
    """Whose a file is, as a user would call it."""
    if own:
        return f"your file {folder / name}.yaml"
    if folder != files.conf_dir():
        return f"file {name}.yaml of {folder.parent.name}"
    kind, _, option = name.partition("/")
    return f"{kind}={option}" if kind in ("experiment", "method") else f"file {name}.yaml"


def _chooser(metadata: Any) -> str:
    """Who chose an option instead of the one that config.yaml has."""
    return COMMAND_LINE if metadata.external_override else str(metadata.containing_config_path).replace("/", "=", 1)
