"""One design that holds all candidates of what is free: which columns are where."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from credit.core.errors import UserError
from credit.logged.formulas.blocks import Block, Factor
from credit.logged.formulas.free import DECAYS, Free, choices, concrete, free_calls, left_open, together
from credit.logged.formulas.reading import LARGEST, Trees
from credit.logged.panel import Column, Ints
from credit.recovery.features.grammar import Scoped


def laid_out(
    scoped: Sequence[Scoped], trees: Trees, columns: Mapping[str, Column]
) -> tuple[tuple[Block, ...], Ints, tuple[Free, ...]]:
    """The blocks of all candidates side by side, columns that are always there, and those of each candidate."""
    calls = [{text: n for name, _ in each.factors for text, n in free_calls(trees[name]).items()} for each in scoped]
    groups = {group[0]: group for group in together(calls)}
    linked = {at for group in groups.values() for at in group}
    blocks, fixed, free = list[Block](), list[Ints](), list[Free]()
    size = 0

    def add(block: Block) -> Ints:
        nonlocal size
        size += block.size
        if size > LARGEST:
            raise UserError(f"more than {LARGEST} columns; fewer levels, candidates or products")
        blocks.append(block)
        return np.arange(size - block.size, size)

    for at, each in enumerate(scoped):
        if at not in linked:
            fixed.append(add(_block(each, trees, {}, columns)))
        elif at in groups:
            members = [scoped[member] for member in groups[at]]
            free.append(_free(members, trees, {k: v for m in groups[at] for k, v in calls[m].items()}, columns, add))
    return tuple(blocks), np.concatenate([np.empty(0, np.int64), *fixed]).astype(np.int64), tuple(free)


def _free(
    members: Sequence[Scoped],
    trees: Trees,
    calls: Mapping[str, int],
    columns: Mapping[str, Column],
    add: Callable[[Block], Ints],
) -> Free:
    """All candidates of terms that are chosen together; blocks and candidates that are the same are there once."""
    known, candidates = dict[tuple[int, tuple[str, ...]], Ints](), dict[str, Ints]()
    for choice in choices(calls):
        parts, texts = list[Ints](), dict[str, None]()
        for at, each in enumerate(members):
            block = _block(each, trees, choice, columns)
            key = (at, tuple(one.text for one in block.factors))
            known[key] = known[key] if key in known else add(block)
            parts.append(known[key])
            texts |= dict.fromkeys(
                one.text for one, (name, _) in zip(block.factors, each.factors, strict=True) if free_calls(trees[name])
            )
        candidates.setdefault(", ".join(texts), np.concatenate(parts))  # what stands at one place is the same
    free = dict.fromkeys(name for each in members for name, _ in each.factors if free_calls(trees[name]))
    alone = next(iter(calls)) if len(calls) == 1 and len(candidates) == len(DECAYS) else ""
    own = (
        (alone, tuple(map(float, DECAYS)))
        if alone and left_open("adstock", alone, [trees[name] for name in free])
        else ("", ())
    )
    return Free(", ".join(free), tuple(candidates), tuple(candidates.values()), *own)


def _block(each: Scoped, trees: Trees, choice: Mapping[str, int], columns: Mapping[str, Column]) -> Block:
    factors = [Factor.of(concrete(trees[name], choice, columns), reduced, columns) for name, reduced in each.factors]
    return Block(each.scale, tuple(factors))
