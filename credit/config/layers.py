"""What an experiment and a method want of parts that may not be chosen, and how it reaches them.

An experiment says in `choose` which option a role means there (a method that plans asks for `${choose.planner}`), and
in `defaults_for` what an option's file should say there:

    choose: {planner: value_iteration, learner: q_learning}
    defaults_for: {mixer/relative_mse.alpha: 1.0, bonus/count.scale: .35, feedback/*.window: 5}

Both are known before anything is composed, and files are read as if they said so. So all the rest keeps its rank, low
to high: constructor, our file, experiment, method, the user's own file (which is read as it is), command line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra._internal.sources_registry import SourcesRegistry
from hydra.core.object_type import ObjectType
from hydra.plugins.config_source import ConfigResult
from omegaconf import DictConfig, OmegaConf, open_dict

from credit.config import classes, files
from credit.config.kinds import KINDS
from credit.core.errors import UserError, nearest

ROLE = re.compile(r"\$\{choose\.(\w+)\}")
EVERY = "*"  # every option of a group whose file says the key


@dataclass(frozen=True)
class Wish:
    """One entry of `defaults_for`: what a key of an option is worth, and who says so (`experiment=sepsis`)."""

    option: str
    key: str
    value: Any
    by: str


@dataclass(frozen=True)
class Layer:
    """What is between our files and the user's.

    Attributes:
        roles: role of a method → option of a group. wishes: entries of `defaults_for`; later ones count more.
        config_dirs: the user's folders.
    """

    roles: Mapping[str, str] = field(default_factory=dict)
    wishes: Sequence[Wish] = ()
    config_dirs: Sequence[str] = ()

    @classmethod
    def of(cls, experiment: str, method: str, config_dirs: Sequence[str] = ()) -> Layer:
        """What these two say; of what has no file, nothing.

        Raises:
            UserError: `choose` or `defaults_for` is no mapping, or names no option.
        """
        roles, wishes = dict[str, str](), list[Wish]()
        base = files.read(files.conf_dir() / f"{files.CONFIG_NAME}.yaml")
        chain = [("config.yaml", base), *_chain("experiment", experiment, config_dirs)]
        for by, node in [*chain, *_chain("method", method, config_dirs)]:
            roles |= {role: str(option) for role, option in _mapping(node, "choose", by).items()}
            entries = _mapping(node, "defaults_for", by).items()
            found = [_wish(str(name), value, by, config_dirs) for name, value in entries]
            wishes += sorted(found, key=lambda wish: not wish.option.endswith(EVERY))
        return cls(roles, wishes, config_dirs)

    def for_file(self, option: str, node: Mapping[Any, Any]) -> list[Wish]:
        """What is wished for an option whose file says `node`."""
        every = f"{option.partition('/')[0]}/{EVERY}"
        return [
            wish
            for wish in self.wishes
            if wish.option == option or (wish.option == every and wish.key.partition(".")[0] in node)
        ]

    def apply(self, option: str, node: DictConfig) -> None:
        """Make a file say what is wished, and roles what they mean here.

        Raises:
            UserError: the file asks for a role that nobody has.
        """
        with open_dict(node):
            for wish in self.for_file(option, node):
                OmegaConf.update(node, wish.key, wish.value, merge=False, force_add=True)
            if any(ROLE.search(str(entry)) for entry in node.get("defaults") or ()):
                entries = OmegaConf.to_container(node.defaults, resolve=False)
                assert isinstance(entries, list)
                node.defaults = [self._named(option, entry) for entry in entries]

    def _named(self, option: str, entry: Any) -> Any:
        if not isinstance(entry, dict):
            return entry
        said = {group: name for group, name in entry.items() if isinstance(name, str)}
        return entry | {group: ROLE.sub(lambda role: self._role(option, role[1]), name) for group, name in said.items()}

    def _role(self, option: str, role: str) -> str:
        if role not in self.roles:
            raise UserError(
                f"{option.replace('/', '=')}: nothing says which option its role {role!r} means; "
                f"{nearest(role, self.roles)}; an experiment says it: choose: {{{role}: <option>}}"
            )
        return self.roles[role]


def _chain(
    kind: str, name: str, config_dirs: Sequence[str], seen: frozenset[str] = frozenset()
) -> list[tuple[str, dict[str, Any]]]:
    """A file and those of its kind that it starts from, those first: who, and what it says."""
    path = files.options(kind, config_dirs).get(name)
    if path is None or name in seen:
        return []
    node = files.read(path)
    before = [_chain(kind, base, config_dirs, seen | {name}) for base in files.bases(kind, node)]
    own = any(folder in path.parents for folder in files.own_dirs(config_dirs))
    return [*(link for chain in before for link in chain), (f"your file {path}" if own else f"{kind}={name}", node)]


def _mapping(node: Mapping[str, Any], key: str, by: str) -> Mapping[str, Any]:
    found = node.get(key) or {}
    if not isinstance(found, Mapping):
        raise UserError(f"{by}: {key}={found!r}: a mapping belongs here, such as {_EXAMPLES[key]}")
    return found


_EXAMPLES = {"choose": "{planner: value_iteration}", "defaults_for": "{bonus/count.scale: 0.35}"}


def _wish(name: str, value: Any, by: str, config_dirs: Sequence[str]) -> Wish:
    """An entry of `defaults_for`, such as `bonus/count.scale`."""
    where = f"{by}: defaults_for: {name!r}"
    option, _, key = name.partition(".")
    group, _, file = option.partition("/")
    if not (file and key):
        raise UserError(f"{where} is no key of an option; write GROUP/OPTION.KEY, such as {_EXAMPLES['defaults_for']}")
    if group not in KINDS:
        raise UserError(f"{where}: {group!r} is no group; {nearest(group, KINDS)}")
    known = files.options(group, config_dirs)
    if file not in {*known, EVERY}:
        raise UserError(f"{where}: {group} has no option {file!r}; {nearest(file, known)}")
    names = known if file == EVERY else [file]
    heads = [heads for name in names if (heads := _heads(group, name, config_dirs)) is not None]
    if heads and not any(key.partition(".")[0] in keys for keys in heads):
        raise UserError(f"{where}: {option} has no key {key!r}; {nearest(key, set().union(*heads))}")
    return Wish(option, key, value, by)


def _heads(group: str, option: str, config_dirs: Sequence[str]) -> set[str] | None:
    """The parameters of an option's class; None where they cannot be told."""
    node = classes.node_of_option(group, option, config_dirs)
    with suppress(UserError):
        return set(classes.parameters(f"{group}={option}", node)) if classes.is_component(node) else None
    return None


_LAYER: ContextVar[Layer | None] = ContextVar("layer", default=None)


@contextmanager
def applied(layer: Layer) -> Iterator[None]:
    """Files of credit and of packages are read as this layer wishes."""
    token = _LAYER.set(layer)
    try:
        yield
    finally:
        _LAYER.reset(token)


@cache
def _base() -> Layer:
    """Where nobody composes a job: a launcher asks for its own part alone."""
    return Layer.of("", "")


def _named_by_its_file(option: str, found: ConfigResult) -> None:
    """A method or an experiment that does not say its name has that of its file.

    Raises:
        UserError: what it says would reach nothing but its own group.
    """
    group, _, name = option.partition("/")
    if group not in ("method", "experiment") or not isinstance(found.config, DictConfig):
        return
    if found.header.get("package") != "_global_":
        raise UserError(
            f"{group}={name}: its file has to begin with the line `# @package _global_`, to reach other groups"
        )
    with open_dict(found.config):
        found.config.setdefault(group, name)


def _at_home(option: str, found: ConfigResult) -> None:
    """A file of a group that holds several, `bonus=[count,ucb1]`, fills a place of its own where it says none."""
    group, _, name = option.partition("/")
    if group in KINDS and KINDS[group].several and found.header.get("package") is None:
        said = files.package_of(group, name, (_LAYER.get() or _base()).config_dirs)
        found.header["package"] = said or f"{KINDS[group].slots[0]}.{name}"


@lru_cache(maxsize=1024)  # a job composes forty files, and a sweep has a hundred jobs
def _parsed(path: Path, changed: int, size: int) -> ConfigResult:
    return FileConfigSource("file", str(path.parent)).load_config(path.name)


class Files(FileConfigSource):
    """A folder whose files are parsed once, as long as they do not change."""

    def load_config(self, config_path: str) -> ConfigResult:
        """A file as it stands."""
        path = Path(self.path, self._normalize_file_name(config_path))
        if not path.is_file():
            return super().load_config(config_path)  # which says so
        found = path.stat()
        parsed = _parsed(path, found.st_mtime_ns, found.st_size)
        return replace(
            parsed,
            provider=self.provider,
            path=f"{self.scheme()}://{self.path}",
            config=deepcopy(parsed.config),
            header=dict(parsed.header),
        )


class Shared(Files):
    """A folder of credit, or of a package: `credit://<folder>`."""

    @staticmethod
    def scheme() -> str:
        """How its address begins."""
        return "credit"

    def load_config(self, config_path: str) -> ConfigResult:
        """A file, as an experiment and a method wish it."""
        found = super().load_config(config_path)
        if isinstance(found.config, DictConfig):
            layer = _LAYER.get() or _base()
            layer.apply(option := config_path.removesuffix(".yaml"), found.config)
            _named_by_its_file(option, found)
            _at_home(option, found)
        return found


class Own(Files):
    """A folder of the user's: `own://<folder>`. What it says stands, but what every run starts from is credit's."""

    @staticmethod
    def scheme() -> str:
        """How its address begins."""
        return "own"

    def load_config(self, config_path: str) -> ConfigResult:
        """A file, its roles as an experiment has them."""
        found = super().load_config(config_path)
        if isinstance(found.config, DictConfig):
            roles = Layer((_LAYER.get() or _base()).roles)
            roles.apply(option := config_path.removesuffix(".yaml"), found.config)
            _named_by_its_file(option, found)
            _at_home(option, found)
        return found

    def is_config(self, config_path: str) -> bool:
        """Whether there is such a file."""
        return self._normalize_file_name(config_path) != f"{files.CONFIG_NAME}.yaml" and super().is_config(config_path)

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Names of files; none where there is no such folder."""
        return super().list(config_path, results_filter) if self.is_group(config_path) else []


for _source in (Shared, Own):
    SourcesRegistry.instance().register(_source)
