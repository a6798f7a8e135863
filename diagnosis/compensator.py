"""A small network beside the extended model: it may take what no effect explains, if it pays on data it has not seen.

The network learns the input-equivalent residual of the final model as a function of angle and velocity on the first
part of the fitted logs. It joins the model only if free simulation in windows improves on the rest of them, by more
than the bootstrap interval of the improvement. The held-out logs can refuse it, not choose it: beyond the angles and
velocities that it has learned from a network says anything.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.finding import Finding
from diagnosis.ledger import Step, resampled
from diagnosis.problem import Problem, stack
from diagnosis.replay import WINDOW, in_blocks, input_equivalent, replay, rms, transfer, window_width
from envs.log import Log
from methods.closed_form_gradient import ClosedFormGradient
from methods.network_training import train_network
from methods.two_layer_network import TWO_SIGNALS, TwoLayerNetwork

LEARNED = 0.7
"""Share of each fitted log that the network learns from; the rest decides whether it stays."""
HIDDEN_NODES = 8
ROWS = 6000
"""Samples that the network is trained on."""


def compensators(
    logs: Sequence[Log], problem: Problem, finding: Finding, group: tuple[int, ...], rng: np.random.Generator
) -> tuple[tuple[TwoLayerNetwork | None, ...], str]:
    """One network per joint of a problem, or None where it does not earn its place; and the reason in words."""
    if all(left.excess <= 0.0 for left in finding.remainders):
        what = "follows no signal of the logs" if finding.verdict == "unknown" else "is noise"
        return (None,) * problem.joints, f"what is left {what}"
    cuts = [int(LEARNED * len(log)) for log in logs]
    learned, judged = (
        stack(problem.kernel, [log.slice(*ends(cut, len(log))) for log, cut in zip(logs, cuts, strict=True)], group,
              pair=problem.pair, arm=problem.arm)
        for ends in (lambda cut, size: (0, cut), lambda cut, size: (cut, size))
    )  # fmt: skip
    own = [transfer(part, finding.final.point) for part in (learned, judged)]
    found = replay(learned, own[0], WINDOW)
    residual = input_equivalent(learned, own[0], found.prediction)
    networks: list[TwoLayerNetwork | None] = []
    for j in range(problem.joints):
        if finding.remainders[j].excess <= 0.0:
            networks.append(None)
            continue
        rows = np.flatnonzero(learned.used)
        rows = rows[:: max(1, len(rows) // ROWS)]
        inputs = np.stack([found.motion[rows, j, 0], found.motion[rows, j, 1]], axis=1)
        trainer = ClosedFormGradient(iterations=120)
        network, _, _ = train_network(inputs, -residual[rows, j], TWO_SIGNALS, HIDDEN_NODES, trainer, True, rng)
        networks.append(network)
    before, after = replay(judged, own[1], WINDOW), replay(judged, own[1], WINDOW, networks)
    width = window_width(WINDOW, judged.sample_time)
    kept: list[TwoLayerNetwork | None] = []
    for j, candidate in enumerate(networks):
        blocks = np.array([in_blocks(item.windows[:, j], judged.bounds, width) for item in (before, after)])
        draws = resampled(blocks, rng)
        better = np.isfinite(rms(after.windows[:, j])) and float(np.quantile(draws[1] / draws[0], 0.95)) < 1.0
        kept.append(candidate if better else None)
    return tuple(kept), "" if any(kept) else "it does not improve on the part of the fitted logs that it has not seen"


def not_refused(
    held_out: Problem, last: Step, networks: Sequence[TwoLayerNetwork | None]
) -> tuple[tuple[TwoLayerNetwork | None, ...], Step | None, str]:
    """The networks without those that make the last model err more on the held-out logs, the step with what is left of
    them, if anything, and why one was refused."""

    def with_them(own: Sequence[TwoLayerNetwork | None]) -> Step:
        return Step("+ compensator", "compensator", None, last.point, replay(held_out, last.point, WINDOW, own))

    step, windows = with_them(networks), last.replay.windows
    ratios = [rms(own) / max(rms(before), 1e-300) for own, before in zip(step.replay.windows.T, windows.T, strict=True)]
    worse = [j for j, own in enumerate(networks) if own is not None and ratios[j] >= 1.0]
    if not worse:
        return tuple(networks), step, ""
    kept = tuple(None if j in worse else own for j, own in enumerate(networks))
    said = f"it makes the held-out error {max(ratios[j] for j in worse):.3g} times as large"
    return kept, with_them(kept) if any(kept) else None, said
