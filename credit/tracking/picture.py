"""What a seed believes at its end, as a picture beside its files: tables of `recovery.npz`, in SVG, in milliseconds."""

from __future__ import annotations

import base64
import struct
import zlib
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIDE, GAP, HEAD, FOOT = 150, 16, 34, 20  # pixels of a panel, and below all
SPARSE = 8  # a grid of places has no more than so many fields for each that is known
ACROSS = 4  # panels in a row
ROWS = (
    "reward/true",
    "reward/mixed",
    "reward/",
    "weight/",
    "mse/",
    "disagreement/",
    "bonus/",
    "visits",
)  # in this order
LOW, MIDDLE, HIGH = (0x00, 0x72, 0xB2), (0xF7, 0xF7, 0xF7), (0xD5, 0x5E, 0x00)  # below 0, 0, above


def recovery_picture(file: Path) -> str | None:
    """Panels of rewards, weights, MSE proxies, bonuses, for every state and action, or place; one scale a kind.

    Args:
        file: a run's `recovery.npz`.

    Returns:
        SVG; None where there is no such file, or neither a table nor a grid of places in it.
    """
    if not file.exists():
        return None
    with np.load(file) as arrays:
        shape = arrays["reward/mixed"].shape if "reward/mixed" in arrays else ()
        if len(shape) != 2:
            return None
        names = [name for start in ROWS for name in arrays if name.startswith(start) and arrays[name].shape == shape]
        tables = {name: np.asarray(arrays[name], dtype=np.float64) for name in dict.fromkeys(names)}
        rows, columns = arrays["cells"].tolist() if "cells" in arrays else ("state", "action")
        axes = f"{rows} down, {columns} across"
        if "grid/states" in arrays:
            axes = "the last fit, x to the right, y upwards"
            placed = {name: _placed(arrays["grid/states"], table[-1]) for name, table in tables.items()}
            tables = {name: table for name, table in placed.items() if table is not None}
    if not tables:
        return None
    width, height = ACROSS * (SIDE + GAP) + GAP, -(-len(tables) // ACROSS) * (SIDE + HEAD + GAP) + GAP + FOOT
    kinds = {name: name.partition("/")[0] for name in tables}
    largest = {kind: max(_largest(tables[name]) for name in tables if kinds[name] == kind) for kind in kinds.values()}
    drawn = {name: _coloured(table, largest[kinds[name]]) for name, table in tables.items()}
    parts = [_panel(name, tables[name], drawn[name], number) for number, name in enumerate(tables)]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif">'
    words = escape(f"{axes}; blue is below 0, orange above, grey unknown; one scale a kind")
    foot = f'<text x="{GAP}" y="{height - FOOT + 6}" font-size="11" fill="#666">{words}</text>'
    return "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *parts, foot, "</svg>"])


def _placed(states: NDArray[Any], values: Array) -> Array | None:
    """Values at places as a map whose first row is the top; None where the places are no grid.

    Args:
        states: x and y first [N, 2 or more]. values: [N].
    """
    (x, columns), (y, rows) = (np.unique(states[:, axis].round(6), return_inverse=True) for axis in (0, 1))
    if len(x) * len(y) > SPARSE * len(states):
        return None
    table = np.full((len(y), len(x)), np.nan)
    table[len(y) - 1 - rows, columns] = values
    return table


def _largest(table: Array) -> float:
    return float(np.abs(table[np.isfinite(table)]).max(initial=0.0))


def _panel(name: str, table: Array, colours: NDArray[np.uint8], number: int) -> str:
    left = GAP + number % ACROSS * (SIDE + GAP)
    top = GAP + number // ACROSS * (SIDE + HEAD + GAP)
    known = table[np.isfinite(table)]
    span = f"{known.min():.3g} … {known.max():.3g}" if known.size else ""
    image = base64.b64encode(_png(colours)).decode()
    return (
        f'<text x="{left}" y="{top + 12}" font-size="12">{escape(name)}</text>'
        f'<text x="{left}" y="{top + 26}" font-size="10" fill="#666">{span}</text>'
        f'<image x="{left}" y="{top + HEAD}" width="{SIDE}" height="{SIDE}" preserveAspectRatio="none" '
        f'style="image-rendering: pixelated" href="data:image/png;base64,{image}"/>'
    )


def _coloured(table: Array, largest: float) -> NDArray[np.uint8]:
    """Colours [rows, columns, 3] of values around 0; `largest` is the full shade, what is not known is grey."""
    known = np.isfinite(table)
    share = np.where(known, table, 0.0) / (largest or 1.0)
    ends = np.where(share[..., None] < 0, LOW, HIGH)
    colours = MIDDLE + np.abs(share)[..., None] * (ends - np.array(MIDDLE))
    return np.where(known[..., None], colours, 0xC0).astype(np.uint8)


def _png(pixels: NDArray[np.uint8]) -> bytes:
    height, width, _ = pixels.shape
    lines = b"".join(b"\0" + row.tobytes() for row in pixels)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")
