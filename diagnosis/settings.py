"""The decision rules of a search."""

from __future__ import annotations

from dataclasses import dataclass, replace

from diagnosis.remainder import AMPLIFIER, DISTURBANCE

LENGTH = 60_000
"""Steps of a simulation of all logs that counts as one of the budget: one per sample, or per several of them."""
SHORTEST = 0.05
"""What one of short logs counts."""
SHARES = 4
"""Problems that a budget is divided among at most."""
TYPICAL = 0.05
"""Share of the command's rms that an effect's torque has when two effects are asked to be told apart."""


@dataclass(frozen=True)
class Settings:
    """Decision rules. Evidence is -2 log likelihood gained less the price of parameters and searched shapes.

    threshold: least evidence of an effect. weak: evidence below which an effect also has to do something for data that
    nobody fitted. material: least effect of its torque, as a share of the command's rms, beside others. faint: the same
    of the first one, beside which no inexact law of another one can need repair.
    rival: evidence within which two explanations cannot be told apart. limit: largest number of effects per joint; more
    would be patchwork around something unknown, but for one that explains the share `inexact` of all. banded: the limit
    in the band of the motion, where the whole band has left something unexplained.
    minor: share of all that was explained below which a further effect, or a drift of a parameter that is not
    `relevant` either, is taken for an inexact law of another.
    doubtful: the same while something else stays unexplained. unexplained: share that makes a verdict `unknown`. trace:
    share of the nominal model's error in free simulation of logs that nobody fitted below which a further effect that
    explains less than that share is taken for an inexact law, too.
    disturbance: unlogged torque, as a share of the motor torque, that does so too, unless it
    stays below `amplifier` times the largest command: amplifiers are that noisy. jitter: least jitter of the sampling
    instants as a share of the interval. patched: evidence of what was refused for its size, as a share of what was
    explained, above which something unknown must be there. relevant: torque of what stays
    unexplained, as a share of the command's rms, below which it is put down to integrators and inexact laws; a further
    effect needs half of that, or all beside one in which small causes grow and, where it is weak, beside one that
    follows the same signal. inexact: share of what was explained above
    which no such excuse holds, unless the torque stays below `seen`: rounding is not quite noise.
    budget: simulations of all logs, of each joint by itself, after which no other ways are tried; after half as many
    again no further effects are sought. It is that of simulations of `LENGTH` steps; of others more or fewer, in
    proportion.
    """

    threshold: float = 12.0
    weak: float = 60.0
    material: float = 2.5e-4
    faint: float = 5e-5
    rival: float = 6.0
    limit: int = 3
    banded: int = 2
    minor: float = 0.005
    doubtful: float = 0.15
    unexplained: float = 0.03
    trace: float = 0.005
    disturbance: float = DISTURBANCE
    amplifier: float = AMPLIFIER
    jitter: float = 0.002
    patched: float = 2.0
    relevant: float = 0.008
    inexact: float = 0.1
    seen: float = 0.0015
    budget: int = 12_000

    def shared(self, parts: int) -> Settings:
        """The same with the budget divided among problems that are searched one after the other, down to a quarter."""
        return replace(self, budget=self.budget // max(1, min(parts, SHARES)))
