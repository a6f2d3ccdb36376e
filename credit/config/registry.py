"""Hydra as far as it composes: compose a job, expand a sweep.

The YAML file is the registration: `conf/<kind>/<name>.yaml` names a class by `_target_`, and that is all it takes.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from functools import lru_cache
from typing import Any

import hydra
from hydra._internal.hydra import Hydra
from hydra._internal.utils import create_config_search_path
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from credit.config import answers, files, layers
from credit.config.files import CONFIG_NAME
from credit.config.kinds import CHOICES, KINDS
from credit.core.errors import UserError

COMPOSES = ("hydra", "choose", "defaults_for", "names")  # keys that are not part of a job
ROLES = {  # what to type instead of what only files say
    "choose": "choose the part itself: agent=<option>, assigner=<option>",
    "defaults_for": "write the key itself, such as mixer.alpha=.3",
    "names": "write title=<name>",
    "slug": "folders are named by what differs; output=<folder> says where they lie",
    "session": "a session names itself; output=<folder> says where it lies",
}
REFUSED = (HydraException, OmegaConfBaseException, YAMLError, RecursionError)  # how words and files are refused
GENERIC = "generic"  # the experiment of an environment that has none of its own


def compose(overrides: Sequence[str] = (), config_dirs: Sequence[str] = ()) -> dict[str, Any]:
    """The resolved configuration of one job as plain mappings and lists, not yet checked.

    Args:
        overrides: as on the command line: `["method=reference", "mixer.alpha=.3"]`.
        config_dirs: further folders of YAML files.

    Raises:
        UserError: an override cannot be parsed, or names no option or key.
    """
    require_words(overrides, config_dirs)
    if named := [text for text in overrides if is_sweep_file(text)]:
        raise UserError(f"{named[0]!r} is a sweep of many jobs, and this is one; `credit train -m {named[0]}` runs it")
    if swept := [text for text in overrides if is_sweep(text)]:
        raise UserError(
            f"{swept[0]!r} names several values, and this is one job; credit.sweep([...]) runs a job of each, as "
            "`credit train -m` does"
        )
    words = with_budget(with_experiment(overrides, config_dirs))
    for text in overrides:
        if (first := str(parse(text).key_or_group).partition(".")[0]) in ROLES:
            raise UserError(f"{text!r}: {first} is not for the command line: {ROLES[first]}")
    _require_one_meaning(overrides, config_dirs)
    return deepcopy(_composed(tuple(words), tuple(config_dirs), files.stamp(config_dirs)))


def _require_one_meaning(words: Sequence[str], config_dirs: Sequence[str]) -> None:
    """Refuse an option that is typed and means several parts; a file in a folder of the user's own is the one meant.

    One that is empty, or no mapping, is refused by its name.
    """
    own = files.own_dirs(config_dirs)
    for parsed in map(parse, words):
        kind, named = str(parsed.key_or_group), parsed.value()
        if kind in {*KINDS, *CHOICES}:
            if isinstance(named, list) and not (kind in KINDS and KINDS[kind].several):
                raise UserError(
                    f"{kind} is one option and no list; write {kind}=<option>, or several with -m: {kind}=a,b"
                )
            for option in named if isinstance(named, list) else [named]:
                if "/" in str(option):  # which Hydra would look for in another folder
                    raise UserError(answers.no_option(kind, str(option), config_dirs))
                mine = [file for folder in own if (file := folder / kind / f"{option}.yaml").exists()]
                for file in mine:
                    if not files.read(file) and kind in KINDS:
                        raise UserError(f"{file}: it is empty; name a class in it: _target_: my_package.MyClass")
                if not mine and (line := files.twice(kind).get(str(option))):
                    raise UserError(f"{line}; rename one of them, or uninstall the package that has it")


@lru_cache(maxsize=256)
def _composed(words: tuple[str, ...], config_dirs: tuple[str, ...], stamp: object) -> dict[str, Any]:
    """What Hydra composes; once, as long as no file changes."""
    try:
        with composing(words, config_dirs) as layer:
            found = plain(hydra.compose(CONFIG_NAME, overrides=[*_names(words, layer.roles), *words]))
    except UserError:
        raise
    except (*REFUSED, ValueError) as error:  # the last: `mixer=3`
        if added := answers.of_constructor(error, words, config_dirs, compose):
            return _composed(tuple(added), config_dirs, stamp)
        raise UserError(answers.explain(error, words, config_dirs, compose)) from None
    found = {slot: {} for kind in KINDS.values() if kind.several for slot in kind.slots} | found  # bonus=[]
    if found.get("experiment") != GENERIC:
        return found
    which = found["env"].get("id", found["env"].get("target"))
    return found | {"experiment": _folder_of(words, config_dirs, which)}


def _names(words: Sequence[str], roles: Mapping[str, str]) -> list[str]:
    """How titles call an agent that was chosen in the place of the experiment's: by its option."""
    if (own := chosen("agent", words)) is None:
        return []
    said = {role: own for role in ("planner", "learner") if roles.get(role) != own}
    return [f"names.{role}={name}" for role, name in said.items()] + (
        [f"names.reference='Reference {own}'"] if "planner" in said else []
    )


def with_experiment(overrides: Sequence[str], config_dirs: Sequence[str] = ()) -> list[str]:
    """The words, with the experiment that `env=…` alone means: that of its name, or the generic one."""
    for text in overrides:
        parse(text)
    env = chosen("env", overrides)
    if env is None or chosen("experiment", overrides) is not None:
        return list(overrides)
    if env in files.options("experiment", config_dirs):
        return [f"experiment={env}", *overrides]
    own = [text for text in overrides if str(parse(text).key_or_group).partition(".")[0] == "env"]
    return [f"experiment={_generic(tuple(own), tuple(config_dirs), files.stamp(config_dirs))}", *overrides]


def with_budget(words: Sequence[str]) -> list[str]:
    """The words, with no steps where episodes alone are given: a budget that was typed takes the place of a file's."""
    given = {str(parsed.key_or_group): parsed for parsed in map(parse, words)}
    episodes = given.get("trainer.episodes")
    if episodes is None or episodes.value() is None or "trainer.steps" in given:
        return list(words)
    return [*words, "trainer.steps=null"]


@lru_cache(maxsize=64)
def _generic(words: tuple[str, ...], config_dirs: tuple[str, ...], stamp: object) -> str:
    """The generic experiment of an environment, by what its states and actions are."""
    from credit.config import schema

    node = _composed((f"experiment={GENERIC}", *words), config_dirs, stamp)
    if "???" in node["env"].values():
        return GENERIC
    env = schema.build(node, "env")
    problem = env.problem(env.horizon or 1, (0,), "cpu")
    if not problem.finite_actions:
        return f"{GENERIC}_control"
    if not problem.finite_states:
        return f"{GENERIC}_discrete"
    return f"{GENERIC}_episodes" if problem.episodic else GENERIC


def chosen(group: str, overrides: Sequence[str]) -> str | None:
    """The option of a group that the words name last; None where they name none."""
    found = [parsed.value() for parsed in map(parse, overrides) if parsed.key_or_group == group and not parsed.package]
    return found[-1] if found and isinstance(found[-1], str) else None


def _folder_of(words: Sequence[str], config_dirs: Sequence[str], id: object) -> str:
    """What the generic experiment is called with this environment: no name that another experiment has."""
    env = chosen("env", words)
    if env is None:
        raise UserError(f"experiment={GENERIC} needs an environment; add env=<option> (see `credit list env`)")
    if isinstance(id, str) and id != "???":  # of an environment that is many
        env = re.sub(r"[^\w.-]+", "-", id)
    return env if env not in files.options("experiment", config_dirs) else f"{GENERIC}_{env}"


def hydra_node(overrides: Sequence[str], config_dirs: Sequence[str] = (), whole: bool = False) -> dict[str, Any]:
    """Hydra's own part of a configuration, not resolved; `whole`: with all the rest.

    Raises:
        UserError: an override names no option or key.
    """
    try:
        with composing(overrides, config_dirs):
            config = hydra.compose(CONFIG_NAME, overrides=list(overrides), return_hydra_config=True)
    except REFUSED as error:
        raise UserError(answers.explain(error, overrides, config_dirs, compose)) from None
    found: Any = OmegaConf.to_container(config, resolve=False)
    return found if whole else found["hydra"]


def require_words(overrides: Any, config_dirs: Any = ()) -> None:
    """Refuse what is no list of words, as a caller from Python may give it.

    Raises:
        UserError: what it is instead.
    """
    for name, given, like in (
        ("overrides", overrides, "'method=reference', 'replicas=5'"),
        ("config_dirs", config_dirs, "'conf'"),
    ):
        several = isinstance(given, Sequence) and not isinstance(given, str)
        if wrong := [item for item in (given if several else [given]) if not (several and isinstance(item, str))]:
            raise UserError(f"{name}: {wrong[0]!r} is a {type(wrong[0]).__name__}; give a list of words: [{like}]")
    for place, word in enumerate(overrides):
        if found := _apart(overrides[place:]):
            raise UserError(
                f"{' '.join(found)!r}: a setting is one word, without spaces; write {word.rstrip('=')}={found[-1]}"
            )


def _apart(words: Sequence[str]) -> list[str]:
    """The words that begin here, where they are a key and a value with a space between."""
    if not re.fullmatch(r"\+*[A-Za-z][\w.@/]*=?", words[0]):
        return []
    found = [*words[: 3 if [*words[1:2]] == ["="] else 2]]
    return found if len(found) > 1 and "=" not in found[-1].lstrip("=") and found[-1].strip("=") else []


def is_sweep(override: str) -> bool:
    """Whether an override names several values."""
    return bool(parse(override).is_sweep_override())


def is_sweep_file(override: str) -> bool:
    """Whether an override chooses a sweep that stands in a file."""
    return override.startswith("sweep=")


def plain(config: Any) -> dict[str, Any]:
    """A resolved DictConfig as plain mappings, without what only says how others are composed."""
    container = OmegaConf.to_container(config, resolve=True, throw_on_missing=False)
    assert isinstance(container, dict)
    return {str(key): value for key, value in container.items() if key not in COMPOSES}


@contextmanager
def composing(overrides: Sequence[str] = (), config_dirs: Sequence[str] = ()) -> Iterator[layers.Layer]:
    """Hydra's compose API, which leaves no global state behind; files are read as the experiment and method wish."""
    base = files.read(files.conf_dir() / f"{CONFIG_NAME}.yaml")["defaults"]
    first = {group: option for entry in base if isinstance(entry, dict) for group, option in entry.items()}
    names = {group: chosen(group, overrides) or first[group] for group in ("experiment", "method")}
    # our launcher `ray` has the name of the plugin's own schema, which then checks it: that is welcome
    warnings.filterwarnings("ignore", message=r"\s*'hydra/launcher/ray' is validated against ConfigStore schema")
    GlobalHydra.instance().clear()
    with hydra.initialize_config_dir(str(files.conf_dir()), version_base="1.3", job_name="credit"):
        GlobalHydra.instance().clear()
        Hydra.create_main_hydra2("credit", _search_path(config_dirs))
        layer = layers.Layer.of(**names, config_dirs=config_dirs)
        with layers.applied(layer):
            yield layer


def _search_path(config_dirs: Sequence[str]) -> Any:
    """Where Hydra looks for files: the first that has one counts."""
    found = create_config_search_path(f"{layers.Shared.scheme()}://{files.conf_dir()}")
    for folder in files.own_dirs(config_dirs):
        found.append("own", f"{layers.Own.scheme()}://{folder}", "hydra")  # behind Hydra's, before what came so far
    for folder in reversed(files.package_dirs()):
        found.append("package", f"{layers.Shared.scheme()}://{folder}", "main")
    return found


@lru_cache(maxsize=4096)  # Hydra's parser takes a fifth of a millisecond a word
def parse(text: str) -> Any:
    """An override, parsed.

    Raises:
        UserError: it is none.
    """
    try:
        return OverridesParser.create().parse_override(text)
    except HydraException as error:
        why = str(error).strip().splitlines()[0] if "=" in text else "there is no = in it"
        key, _, value = text.partition("=")
        quoted = f"; a value with = in it, like a folder of runs, stands in quotes: '{key}=\"{value}\"'"
        hint = quoted if "=" in value and '"' not in value else ""
        raise UserError(f"{text!r} is no override ({why}); write group=option or key=value{hint}") from None
