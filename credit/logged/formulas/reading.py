"""A formula's text → products of factors, with every factor checked before anything else sees it."""

from __future__ import annotations

import ast
import keyword
import re
from collections.abc import Mapping
from math import prod
from typing import Any

from credit.core.errors import UserError, nearest
from credit.logged.formulas import bases
from credit.logged.formulas.safety import ALLOWED, BASES, CATEGORY, called, column, named, read
from credit.logged.panel import Column, Roles
from credit.recovery.features.grammar import Scoped, complaint, require_few, require_powers, scoped

LARGEST = 10_000  # columns
MOST_LEVELS = 1000  # of a number that is taken as a category

KEYWORD = re.compile(f"`({'|'.join(keyword.kwlist)})`")

Trees = dict[str, ast.expr]  # text of a factor → what it is


def parse(text: str | None, columns: Mapping[str, Column], roles: Roles) -> tuple[list[Scoped], Trees]:
    """Read a formula.

    Args:
        text: of it; None: an intercept and every feature. columns: features by name.
        roles: of other names, for messages.

    Raises:
        UserError: `formulaic` is not installed; the text is no formula, or reaches for what is not listed.
    """
    every = tuple(columns)
    if text is None:
        trees = {ast.unparse(named(name)): named(name) for name in every}
        kinds = [(each, levels(tree, columns) is not None) for each, tree in trees.items()]
        return [Scoped(1.0, ()), *(Scoped(1.0, (kind,)) for kind in kinds)], dict[str, ast.expr](trees)
    try:
        return _parse(text, columns, roles, every)
    except UserError as error:
        raise UserError(f"formula {text!r}: {error}") from None


def levels(tree: ast.expr, columns: Mapping[str, Column]) -> tuple[Any, ...] | None:
    """Those of a factor that is a category, None for others.

    Raises:
        UserError: C of a number that is not whole, or has too many values.
    """
    if isinstance(tree, ast.Name):
        return columns[column(tree)].levels
    if called(tree) != CATEGORY:
        return None
    assert isinstance(tree, ast.Call)
    assert isinstance(tree.args[0], ast.Name)
    one = columns[column(tree.args[0])]
    if one.levels is not None:
        return one.levels
    near = [abs(value - round(value)) < 1e-9 for value in one.quantiles]  # some lie between two values
    if one.least % 1 or one.most % 1 or 2 * sum(near) < len(near) or one.most - one.least >= MOST_LEVELS:
        raise UserError(
            f"{ast.unparse(tree)}: {one.name} is a number from {one.least:g} to {one.most:g}, and categories are of at "
            f"most {MOST_LEVELS} whole ones; bs({one.name}, 4) is a curve"
        )
    return tuple(range(int(one.least), int(one.most) + 1))


def _parse(
    text: str, columns: Mapping[str, Column], roles: Roles, every: tuple[str, ...]
) -> tuple[list[Scoped], Trees]:
    try:
        import formulaic
    except ImportError:
        raise UserError("formulas are read by a package: pip install 'credit-rl[formula]'") from None
    if not text.strip():
        raise UserError("there is nothing in it; write terms like 1 + price + tv:price, or . for every feature")
    placed, shown = _factors(text, columns, roles)
    found: Any = None
    try:
        require_powers(shown)
        require_few(shown, LARGEST, len(every))
        found = formulaic.Formula(shown, _context={"__formulaic_variables_available__": every})
    except UserError:
        raise
    except Exception as error:  # of any kind, where the text is no formula
        raise UserError(f"{complaint(error)}; {ALLOWED}") from None
    if not isinstance(found, formulaic.SimpleFormula):
        raise UserError("~ and | make several formulas, and one is wanted: what explains the label, without the label")
    trees, terms = dict[str, ast.expr](), dict[tuple[str, ...], None]()
    for term in found:
        texts = dict[str, None]()
        for factor in term.factors:
            if factor.eval_method.value == "literal":
                texts[factor.expr] = None
                continue
            tree = named(factor.expr) if factor.token is None else placed[factor.token.source_start]
            trees[ast.unparse(tree)] = tree
            texts[ast.unparse(tree)] = None
        terms[tuple(texts)] = None
    if not terms:
        raise UserError("there is no term in it; 1 is an intercept")
    if sum(prod(_spanning(trees[each], columns) or 1 for each in term if each in trees) for term in terms) > LARGEST:
        raise UserError(f"more than {LARGEST} columns; fewer levels or products")
    spanning = {each: _spanning(tree, columns) for each, tree in trees.items()}
    return scoped(terms, trees, {each: count for each, count in spanning.items() if count}), trees


def _spanning(tree: ast.expr, columns: Mapping[str, Column]) -> int:
    """Columns that add up to 1; 0 for those of others, which do not."""
    if (known := levels(tree, columns)) is not None:
        return len(known)
    return bases.size(tree) if called(tree) in BASES and bases.spans_one(tree) else 0


def _factors(text: str, columns: Mapping[str, Column], roles: Roles) -> tuple[dict[int, ast.expr], str]:
    """Where each factor begins → what it is; all of them are checked, whether or not they end up in a term.

    And the text for formulaic, which takes `class` in a call for a word of Python's: of the same length.
    """
    from formulaic.parser.algos.tokenize import tokenize

    def known(name: str, place: int) -> bool:
        if name in columns:
            return columns[name].levels is not None
        others = {
            roles.label: "the label, which the formula explains; leave it out",
            roles.window: "what names the windows, and no feature",
            roles.time: f"the time; to use it, name it among the features, data.states=[{name}]",
            roles.group: f"the group; to use it, name it among the features, data.states=[{name}]",
        }
        said = f"is {others[name]}" if name in others else f"is no feature; {nearest(name, columns)}"
        raise UserError(f"{name!r}, at character {place}, {said}")

    try:
        tokens = list(tokenize(text))
    except Exception as error:  # of any kind
        raise UserError(f"{complaint(error)}; {ALLOWED}") from None
    placed = dict[int, ast.expr]()
    for token in tokens:
        kind, start = str(token.kind.value), int(token.source_start or 0)
        if kind == "name":
            known(token.token, start + 1)
            placed[start] = named(token.token)
        elif kind == "python":
            inside = start + (text[start] == "{")
            placed[start] = read(token.token, inside, known)
            plain = KEYWORD.sub(lambda found: f"`{found[1][:-1]}$`", token.token)
            text = text[:inside] + plain + text[inside + len(plain) :]
        elif kind == "value" and token.token != "." and not _is_number(token.token):
            raise UserError(f"{token.token}, at character {start + 1}, is no number; {ALLOWED}")
    return placed, text


def _is_number(text: str) -> bool:
    return text.replace(".", "", 1).isdecimal() and text.isascii() and len(text) < 100
