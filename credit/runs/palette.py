"""The colours of the methods that ship, and of variants, wherever their curves are drawn."""

from __future__ import annotations

import colorsys

# Okabe and Ito's colours, which stay apart for colour-blind readers; greys for what is only a landmark.
COLOURS = {
    "block": "#7a7a7a",
    "block_fair": "#4a4a4a",
    "delayed": "#cc79a7",
    "delayed_fair": "#882255",
    "delayed_monte_carlo": "#999933",
    "reference": "#0072b2",
    "adaptive_mse": "#009e73",
    "disagreement": "#d55e00",
    "elliptical": "#56b4e9",
    "thompson": "#e69f00",
    "credit_hypotheses": "#c00000",
    "last_step": "#332288",
    "oracle": "#000000",
    "random": "#b0b0b0",
}
TINT = 0.55
GOLDEN = 0.381966  # of the circle of hues: any number of steps leaves the neighbours as far apart as can be
SHADES = ((0.44, 0.90), (0.66, 0.65), (0.28, 0.75), (0.55, 0.45), (0.36, 0.50))  # lightness, saturation, in turn


def tint(colour: str) -> str:
    """A lighter shade, for the seeds beside their mean."""
    parts = (int(colour[place : place + 2], 16) for place in (1, 3, 5))
    return "#" + "".join(f"{round(part + TINT * (255 - part)):02x}" for part in parts)


def nth(number: int) -> str:
    """The colour of one of many: those of dozens of numbers in a row are all different ones.

    Args:
        number: from 0.
    """
    light, strong = SHADES[number % len(SHADES)]
    parts = colorsys.hls_to_rgb((0.58 + number * GOLDEN) % 1.0, light, strong)
    return "#" + "".join(f"{round(255 * part):02x}" for part in parts)
