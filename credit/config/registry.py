"""The table of kinds, and Hydra as far as it composes: compose, expand a sweep, list.

The YAML file is the registration: `conf/<kind>/<name>.yaml` names a class by `_target_`, and that is all it takes.
"""

from __future__ import annotations

import importlib.util
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import hydra
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from credit.core.errors import UserError, nearest
from credit.renamed import instead

# What may differ between two runs that are the same run.
CIRCUMSTANCES = (
    "seed",
    "replicas",
    "device",
    "output",
    "session",
    "rerun",
    "sweep",
    "tracking",
    "written_for",
    "checkpoint_rounds",
    "checkpoint_seconds",
)
CONFIG_NAME = "config"


@dataclass(frozen=True)
class Kind:
    """A folder of `conf/`: the class its files build (`module:name`), the slots they fill, and one line of help."""

    base: str
    slots: tuple[str, ...]
    help: str

    def load(self) -> type:
        """The class itself; imported only when it is needed, so that `--help` stays fast."""
        module, name = self.base.split(":")
        found: type = getattr(importlib.import_module(module), name)
        return found


KINDS = {
    "env": Kind("credit.core.seams:Environment", ("env",), "where steps happen"),
    "feedback": Kind("credit.core.seams:Feedback", ("feedback",), "what a label is"),
    "reward": Kind(
        "credit.core.seams:RewardModel",
        ("reference", "surrogates"),
        "reward models: reward@reference=…, +reward@surrogates.NAME=…",
    ),
    "features": Kind("credit.core.seams:FeatureMap", (), "what a reward model looks at"),
    "uncertainty": Kind("credit.core.seams:Uncertainty", ("uncertainty",), "how far a fit can be trusted"),
    "mixer": Kind("credit.core.seams:Mixer", ("mixer",), "MSE proxies → weights of the models"),
    "bonus": Kind("credit.core.seams:Bonus", ("bonus",), "what optimism adds; several: bonus=[count,disagreement]"),
    "assigner": Kind("credit.core.seams:CreditAssigner", ("assigner",), "windows → one reward per step"),
    "transition": Kind("credit.core.seams:Transition", ("transition",), "P̂ for planning"),
    "optimizer": Kind("credit.core.seams:Agent", ("optimizer",), "relabelled rewards → policy"),
    "scaler": Kind("credit.core.seams:Scaler", ("scaler",), "how a pseudo-reward is scaled and clipped"),
    "tracking": Kind("credit.tracking:Tracking", ("tracking",), "where runs are mirrored"),
}
CHOICES = {  # folders that choose among the kinds, and build nothing themselves
    "method": "a credit assigner and an optimizer, by the name it has in tables",
    "experiment": "an environment, its feedback, models and horizon",
    "planner": "which optimizer recovery methods use (set by the experiment)",
    "learner": "which optimizer model-free methods use (set by the experiment)",
    "sweep": "the jobs of a table or figure, by one word: credit train -m sweep=…",
}


CHOSEN = ("planner", "learner")  # parts of an experiment, by which methods find their own


def conf_dir() -> Path:
    """The folder of YAML files: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    return next(path for path in (package / "conf", package.parent / "conf") if path.is_dir())


def search_path(config_dirs: Sequence[str] = ()) -> list[Path]:
    """Folders that may hold YAML files: ours, those of packages that announced themselves, and the user's own."""
    found = [conf_dir()]
    for point in entry_points(group="credit.components"):
        spec = importlib.util.find_spec(point.module)
        places = (spec.submodule_search_locations or []) if spec else []
        found.extend(folder for place in places if (folder := Path(place) / "conf").is_dir())
    for name in config_dirs:
        folder = Path(name).resolve()
        if not folder.is_dir():
            raise UserError(f"--config-dir {name}: no such folder; give a folder with sub-folders like {conf_dir()}")
        found.append(folder)
    return found


def compose(overrides: Sequence[str] = (), config_dirs: Sequence[str] = ()) -> dict[str, Any]:
    """The resolved configuration of one job as plain mappings and lists, not yet checked.

    Args:
        overrides: as on the command line: `["method=reference", "mixer.alpha=.3"]`.
        config_dirs: further folders of YAML files.

    Raises:
        UserError: an override cannot be parsed, or names no option or key.
    """
    if named := [text for text in overrides if is_sweep_file(text)]:
        raise UserError(f"{named[0]!r} is a sweep of many jobs, and this is one; `credit train -m {named[0]}` runs it")
    with composing():
        return _compose(list(overrides), config_dirs)


def expand(overrides: Sequence[str], config_dirs: Sequence[str] = ()) -> list[list[str]]:
    """The overrides of every job of a sweep, in the order in which Hydra's basic sweeper has them.

    `sweep=<name>` stands for the words in its file: those in `hydra.sweeper.params`, and once more for each of
    `sweep.rows` with the words of that row. Of two words for one key the later counts: params, row, command line.

    Raises:
        UserError: an override cannot be parsed, or there is no such file.
    """
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper

    typed = [text for text in overrides if not is_sweep_file(text)]
    files = [text for text in overrides if is_sweep_file(text)]
    jobs: list[list[str]] = []
    with composing():
        for words in _words(files, config_dirs) if files else [[]]:
            parsed = [_parse(text) for text in (*words, *typed)]
            kept = [override for override in parsed if not override.key_or_group.startswith("hydra")]
            jobs += BasicSweeper.split_arguments(kept, max_batch_size=None)[0]
    return jobs


def _words(files: list[str], config_dirs: Sequence[str]) -> list[list[str]]:
    """The words that a sweep's file stands for: one list for its grid, and one for each of its rows."""
    if len(files) > 1 or is_sweep(files[0]):
        raise UserError(f"{' '.join(files)}: one sweep at a time; run one after the other")
    config = hydra_node(files, config_dirs, whole=True)
    grid = [f"{key}={value}" for key, value in (config["hydra"]["sweeper"]["params"] or {}).items()]
    return [grid, *([*grid, *row.split()] for row in config["sweep"].get("rows", ()))]


def hydra_node(overrides: Sequence[str], config_dirs: Sequence[str] = (), whole: bool = False) -> dict[str, Any]:
    """Hydra's own part of a configuration, not resolved; `whole`: with all the rest.

    Raises:
        UserError: an override names no option or key.
    """
    with composing():
        try:
            words = [*overrides, *search_override(config_dirs)]
            config = hydra.compose(CONFIG_NAME, overrides=words, return_hydra_config=True)
        except (HydraException, OmegaConfBaseException) as error:
            raise UserError(_explain(error, list(overrides), config_dirs)) from None
    found: Any = OmegaConf.to_container(config, resolve=False)
    return found if whole else found["hydra"]


def is_sweep(override: str) -> bool:
    """Whether an override names several values."""
    return bool(_parse(override).is_sweep_override())


def is_sweep_file(override: str) -> bool:
    """Whether an override chooses a sweep that stands in a file."""
    return override.startswith("sweep=")


def slug(overrides: Sequence[str]) -> str:
    """A folder name for what was changed: `default`, or the overrides that make a run another run."""
    ignored = re.compile(rf"^[+~]*({'|'.join(('experiment', 'method', 'hydra', *CIRCUMSTANCES))})\b(?!@)")
    kept = sorted(_spelled(text) for text in overrides if not ignored.match(text))
    name = re.sub(r"[^A-Za-z0-9=._,@~+-]+", "-", re.sub(r"[\[\]'\"]", "", ",".join(kept))).strip("-")
    if len(name) > 120:
        import zlib

        name = f"{name[:110]}-{zlib.crc32(name.encode()):08x}"
    return name or "default"


def _spelled(text: str) -> str:
    """An override as Hydra's sweeper spells it: `.3` and `0.3` are one folder."""
    parsed = _parse(text)
    if parsed.is_delete():
        return text.removesuffix("=null")  # as the sweeper spells it
    return f"{parsed.key_or_group}{f'@{parsed.package}' if parsed.package else ''}={parsed.get_value_element_as_str()}"


def plain(config: Any) -> dict[str, Any]:
    """A resolved DictConfig as plain mappings, without the folders that only choose."""
    container = OmegaConf.to_container(config, resolve=True, throw_on_missing=False)
    assert isinstance(container, dict)
    return {str(key): value for key, value in container.items() if key not in ("hydra", "tuned", *CHOSEN)}


def options(kind: str, config_dirs: Sequence[str] = ()) -> dict[str, Path]:
    """Name → YAML file of everything registered under a kind."""
    folders = [folder / kind for folder in search_path(config_dirs)]
    return {path.stem: path for folder in folders if folder.is_dir() for path in sorted(folder.glob("*.yaml"))}


def describe_file(path: Path) -> str:
    """The first comment line of a YAML file: what it is."""
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("#") and not line.startswith("# @package"):
            return line.lstrip("# ").strip()
    return ""


@contextmanager
def composing() -> Iterator[None]:
    """Hydra's compose API, which leaves no global state behind."""
    GlobalHydra.instance().clear()
    # our launcher `ray` has the name of the plugin's own schema, which then checks it: that is welcome
    warnings.filterwarnings("ignore", message=r"\s*'hydra/launcher/ray' is validated against ConfigStore schema")
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3", job_name="credit"):
        yield


def _compose(overrides: list[str], config_dirs: Sequence[str]) -> dict[str, Any]:
    for text in overrides:
        _parse(text)
    try:
        return plain(hydra.compose(CONFIG_NAME, overrides=[*overrides, *search_override(config_dirs)]))
    except (HydraException, OmegaConfBaseException, ValueError) as error:  # ValueError: `mixer=null`, `mixer=3`
        raise UserError(_explain(error, overrides, config_dirs)) from None


def _parse(text: str) -> Any:
    try:
        return OverridesParser.create().parse_override(text)
    except HydraException as error:
        raise UserError(f"{text!r} is no override ({_first_line(error)}); write group=option or key=value") from None


def _explain(error: Exception, overrides: list[str], config_dirs: Sequence[str]) -> str:
    """What Hydra's error means for the user: which override, and the nearest name that exists."""
    message = str(error)
    if old := next((text for text in overrides if instead(text)), None):
        return f"{old}: this is gone; {instead(old)}"
    if found := re.search(r"Could not (?:load|find) '([\w/@.]+)/([\w.-]+)'", message):
        group, option = found[1].partition("@")[0], found[2]
        return f"{group}={option}: no such option; {nearest(option, options(group, config_dirs))}"
    if found := re.search(r"Could not (?:override|delete)[^']*'([\w@./]+)'", message):
        return _unknown_key(found[1], overrides, config_dirs)
    if message.startswith("Config group override must be"):
        for text in overrides:
            group, _, value = text.lstrip("+~").partition("=")
            named = value.strip("[] ").isidentifier() and value != "null"
            if (kind := group.partition("@")[0]) in {*KINDS, *CHOICES, ""} and not named:
                known = ", ".join(options(kind, config_dirs)) if kind else ", ".join([*KINDS, *CHOICES])
                return f"{text!r}: no name of an option; valid: {known}"
    return re.sub(r"\s*\n\s*", "; ", message.strip())


def _unknown_key(key: str, overrides: list[str], config_dirs: Sequence[str]) -> str:
    """Name the deepest part of a key that exists, and the keys that could follow it."""
    others = [text for text in overrides if text.lstrip("+~").partition("=")[0] != key]
    written = next((text for text in overrides if text not in others), key)
    node: Any = _compose(others, config_dirs)
    parents: list[str] = []
    for part in key.split("."):
        if not isinstance(node, dict) or part not in node:
            break
        node = node[part]
        parents.append(part)
    valid = [name for name in node if name != "_target_"] if isinstance(node, dict) else []
    if not parents:
        valid += [*KINDS, *CHOICES]
    path = ".".join([*parents, part])
    where = f" of {node['_target_'].rpartition('.')[2]}" if isinstance(node, dict) and "_target_" in node else ""
    return f"{path}: unknown key{where} (in {written!r}); {nearest(part, valid)}"


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def search_override(config_dirs: Sequence[str]) -> list[str]:
    """The override that tells Hydra of the folders beside ours."""
    folders = [f"file://{folder}" for folder in search_path(config_dirs)[1:]]
    return [f"hydra.searchpath=[{','.join(folders)}]"] if folders else []
