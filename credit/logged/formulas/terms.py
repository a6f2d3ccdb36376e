"""A formula over logged rows: its design, whose terms look back in time, in parts and with nothing learned anew.

`Terms.of` reads it. One design holds the columns of all candidates of free parameters; a choice takes some of them.

    terms = Terms.of("1 + price + bs(temperature, 4) + saturate(adstock(tv))", panel.columns, panel.roles)
    terms = terms.learn(part)              # a sample, for what columns do not tell; without need of it, the same terms
    state = {}                             # a new one for every pass over the rows
    for part in panel.parts():
        x = terms.design(part, state)      # [n, D]
    x[:, terms.chosen([2])]                # with the third candidate of the one free term
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from credit.core.errors import UserError
from credit.logged.formulas import learning
from credit.logged.formulas.blocks import Block
from credit.logged.formulas.compute import Learned, Rows, code
from credit.logged.formulas.free import Free, tried
from credit.logged.formulas.layout import laid_out
from credit.logged.formulas.reading import parse
from credit.logged.panel import Column, Floats, Ints, Part, Roles, plain

State = dict[str, Floats]  # text of a lag or adstock → what is carried on


@dataclass(frozen=True)
class Terms:
    """A formula's terms, as columns of one design [n, D].

    Attributes:
        formula: the text; None: an intercept and every feature. columns: features by name. blocks: its products.
        choices: what is chosen by cross-validation, in order. fixed: columns that are in every choice.
        learned: text of a call → what is fixed of it. decays: text of a call → what is tried, where that was refined.
    """

    formula: str | None
    columns: Mapping[str, Column]
    blocks: tuple[Block, ...]
    choices: tuple[Free, ...]
    fixed: Ints
    learned: Mapping[str, Learned]
    decays: Mapping[str, Sequence[float]] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        formula: str | None,
        columns: Mapping[str, Column],
        roles: Roles,
        decays: Mapping[str, Sequence[float]] | None = None,
    ) -> Terms:
        """Read a formula.

        Args:
            formula: its text; None: all features. columns: features by name. roles: of other names, for messages.
            decays: candidates of calls that leave theirs open, text → numbers; None: the usual ones.

        Raises:
            UserError: it is no formula, reaches for what is not listed, or does not fit the columns.
        """
        order = [name for name in dict.fromkeys((*roles.features, *columns)) if name in columns]
        columns = {name: replace(columns[name], stock=columns[name].stock or name in roles.stock) for name in order}
        scoped, trees = parse(formula, columns, roles)
        trees = {name: tried(tree, decays or {}) for name, tree in trees.items()}
        try:
            blocks, fixed, free = laid_out(scoped, trees, columns)
            learned = learning.from_columns((one.tree for block in blocks for one in block.factors), columns)
        except UserError as error:
            raise error if formula is None else UserError(f"formula {formula!r}: {error}") from None
        return cls(formula, columns, blocks, free, fixed, learned, dict(decays or {}))

    def refined(self, decays: Mapping[str, Sequence[float]]) -> Terms:
        """The same with other candidates for decays that were left open, text of a call → numbers."""
        roles = Roles(window="", label="", states=tuple(self.columns))
        found = Terms.of(self.formula, self.columns, roles, {**self.decays, **decays})
        return replace(found, learned={**found.learned, **self.learned})

    @property
    def names(self) -> tuple[str, ...]:
        """Of all columns of the design."""
        return tuple(name for block in self.blocks for name in block.names)

    @property
    def stock(self) -> NDArray[np.bool_]:
        """Whether all that stands in a column is a level [D]; an intercept is none: windows have as many as steps."""
        levels = [
            bool(block.features) and all(self.columns[name].stock for name in block.features) for block in self.blocks
        ]
        return np.repeat(np.array(levels, dtype=bool), [block.size for block in self.blocks])

    @property
    def sampled(self) -> bool:
        """Whether `learn` must be called: something is fixed that quantiles of columns do not tell."""
        return any(learning.needs_rows(call) for call in self._calls.values())

    def touching(self, column: str) -> Ints:
        """Columns of the design in which a feature stands."""
        touched = np.repeat([column in block.features for block in self.blocks], [block.size for block in self.blocks])
        return np.flatnonzero(touched).astype(np.int64)

    def chosen(self, choice: Sequence[int] | Ints) -> Ints:
        """Columns of the design where each of `choices` has the candidate of this number, ascending."""
        parts = [free.columns[at] for free, at in zip(self.choices, choice, strict=True)]
        return np.unique(np.concatenate([self.fixed, *parts])).astype(np.int64)

    def learn(self, part: Part) -> Terms:
        """These terms, with means and knots of what is carried over, or of several columns, from a sample in time.

        What is a function of one column is known from all rows already, and stays as it is. Values beyond those of the
        sample make no error later: see `bases`.
        """
        if not self.sampled:
            return self
        rows = Rows(part, self.columns, dict(self.learned), {})
        learning.from_rows(self._trees, rows)
        return replace(self, learned=rows.learned)

    def design(self, part: Part, state: State, columns: Ints | None = None) -> Floats:
        """The columns of some rows [n, D], one after the other in memory.

        Args:
            part: of the rows; parts come in order. state: what is carried on; a new one, {}, for each pass.
            columns: those that are wanted, ascending, the same for all of a pass; None: all.

        Raises:
            UserError: a row in which a term is no number, or a category has a new value.
        """
        return self._design(Rows(part, self.columns, self.learned, state), columns)

    def replaced(self, part: Part, state: State, column: str, value: Any, columns: Ints | None = None) -> Floats:
        """The same where a column has one value in all rows, and always had: [n, D]. It has a state of its own.

        Raises:
            UserError: no value of a category; a row in which a term is no number.
        """
        known = self.columns[column].levels
        try:
            value = float(value) if known is None else known[code(column, value, known)]
        except (TypeError, ValueError) as error:
            said = str(error) if isinstance(error, UserError) else f"{value!r} is no number, and {column} is one"
            raise UserError(said) from None
        return self._design(Rows(part, self.columns, self.learned, state, {column: value}), columns)

    def to_dict(self) -> dict[str, Any]:
        """Plain lists, texts and numbers, from which `from_dict` makes these terms."""
        columns = [one.to_dict() for one in self.columns.values()]  # all: a text may name what it takes away
        parts = {"columns": columns, "learned": plain(self.learned), "decays": plain(self.decays)}
        return {"formula": self.formula, **parts}

    @classmethod
    def from_dict(cls, saved: Mapping[str, Any]) -> Terms:
        """Terms that were saved. Their text is checked as that of any formula.

        Raises:
            UserError: it is no formula.
        """
        columns = {one["name"]: Column.from_dict(one) for one in saved["columns"]}
        roles = Roles(window="", label="", states=tuple(columns))
        found = cls.of(saved["formula"], columns, roles, saved["decays"])
        return replace(found, learned=dict(saved["learned"]))

    @cached_property
    def _trees(self) -> Sequence[ast.expr]:
        return [one.tree for block in self.blocks for one in block.factors]

    @cached_property
    def _calls(self) -> dict[str, ast.Call]:
        return {ast.unparse(call): call for call in learning.calls(self._trees)}

    def _design(self, rows: Rows, columns: Ints | None) -> Floats:
        if missing := [text for text in self._calls if text not in self.learned]:
            raise ValueError(f"{missing[0]} is not learned: terms = terms.learn(part) comes before the design")
        sizes = [block.size for block in self.blocks]
        ends = np.cumsum(sizes)
        wanted = np.arange(sum(sizes)) if columns is None else columns
        values = np.empty((len(rows.part), len(wanted)), order="F")
        for block, end in zip(self.blocks, ends, strict=True):
            first, last = np.searchsorted(wanted, [end - block.size, end])
            if last - first == block.size:
                block.fill(rows, values[:, first:last])
            elif last > first:
                whole = np.empty((len(values), block.size), order="F")
                block.fill(rows, whole)
                values[:, first:last] = whole[:, wanted[first:last] - (end - block.size)]
        return values
