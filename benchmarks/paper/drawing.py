"""What all figures share: style, colours, panel letters, thinned lines, files that do not change from run to run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from envs.log import Array

STYLE = Path(__file__).with_name("paper.mplstyle")
WIDTH = 7.2  # in
MEASURED, WITHOUT, WITH, TRUTH, NOISE = "#000000", "#D55E00", "#0072B2", "#009E73", "#BBBBBB"
"""Colours of the measurement, the model without and with compensator, the truth, and raw differences."""


@contextmanager
def paper_style() -> Iterator[None]:
    """Everything drawn inside has the style of the paper."""
    with plt.style.context(STYLE):
        yield


def letter(axes: Axes, text: str) -> None:
    """Panel letter above the upper left corner."""
    axes.set_title(f"({text})", loc="left", fontweight="bold", pad=4)


def thin(*columns: Array, points: int = 1500) -> list[Array]:
    """Every n-th sample of equally long columns, about `points` of them."""
    step = max(1, len(columns[0]) // points)
    return [np.ravel(column)[::step] for column in columns]


def save(figure: Figure, folder: Path, name: str) -> None:
    """NAME.svg and NAME.png, the same bytes for the same figure."""
    figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    figure.savefig(folder / f"{name}.png", metadata={"Software": None})
    plt.close(figure)
