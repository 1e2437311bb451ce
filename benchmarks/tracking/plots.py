"""The image of docs/tracking.md."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.tracking.figures import Figures, rigid, summarise
from benchmarks.tracking.methods import ORACLE, OURS
from benchmarks.tracking.prose import title
from lidarcli.sweeps.types import Float64


def plot(figures: Figures, target: Path) -> None:
    """HOTA and the error of the velocity of every method in every cell of rigid bodies, sorted by value."""
    cells = [cell for cell in figures.cells if rigid(cell)]
    hota: dict[str, Float64] = {}
    speed: dict[str, Float64] = {}
    for method in figures.methods:
        summaries = [summarise(figures.of(cell.__eq__), method) for cell in cells]
        hota[method] = np.sort([one.hota for one in summaries])
        speed[method] = np.sort([one.speed_rms for one in summaries])[::-1]
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rc("font", size=8)
        mpl.rc("axes.spines", top=False, right=False)
        figure = Figure(figsize=(9.2, 3.4), layout="constrained")
        left, right = figure.subplots(1, 2)
        for method in figures.methods:
            colour = {OURS: "black", ORACLE: "grey"}.get(method)
            width = 2.4 if method == OURS else 1.2
            dots = ":" if method == ORACLE else "-"
            left.plot(hota[method], dots, label=title(method).strip("*"), color=colour, linewidth=width)
            if method != ORACLE:
                right.plot(speed[method], dots, color=colour, linewidth=width)
        left.set(xlabel="cells, worst first", ylabel="HOTA", ylim=(None, 1.0))
        right.set(xlabel="cells, worst first", ylabel="velocity of what moves, RMSE [m/s]", ylim=(0.0, None))
        figure.legend(loc="outside right center", frameon=False)
        target.parent.mkdir(parents=True, exist_ok=True)
        FigureCanvasAgg(figure)
        figure.savefig(target, dpi=110, metadata={"Software": None}, pil_kwargs={"optimize": True})
