"""Flexible joint: motor and load are joined by a spring and a damper; the encoder sits on the motor, or on the load.

With w the angular frequency of the load behind a motor that is held still, ``2 pi frequency``, and J the whole inertia,
``q_l'' = w^2 (q - q_l) + 2 damping_ratio w (q' - q_l')`` and ``J (1 - r) q'' = tau - J r q_l''``: stiffness J r w^2.
With no inertia behind it the spring has no effect, whatever its frequency. The flexible spline of a strain wave gear
stiffens as it is twisted: its spring is ``K d (1 + c d^2)``
with the twist ``d = q - q_l``; the model has ``c / K^2``.

Source: M. W. Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Syst. Meas. Control 109 (1987); T. D.
Tuttle, W. P. Seering, A nonlinear model of a harmonic drive gear transmission, IEEE T-RA 12 (1996).
"""

import math
from dataclasses import replace

from methods.effects.base import Effect, EffectParameter, exclusive, geometric, grid
from methods.effects.load_dependent_friction import BY_THE_LINK


def starts(s):
    """Frequencies that the recording spans, below half the Nyquist frequency; little or much of the load behind."""
    return grid((0.15, 0.5), geometric(max(3.0 / s.duration, 0.5), 0.25 / s.sample_time, 1.5), (0.04,))


def ringing(frequency):
    """Little or much of the load behind: motor and load ring at ``f / sqrt(1 - r)``."""
    return [(share, frequency * math.sqrt(1.0 - share), 0.01) for share in (0.3, 0.55, 0.85)]


EFFECT = Effect(
    name="joint_flexibility",
    stage="transmission",
    slot="structure",
    parameters=(
        EffectParameter("inertia_ratio", "ratio", "share of the inertia behind the spring", lower=0.0, upper=0.98),
        EffectParameter("frequency", "frequency", "of the load behind a motor that stands still", lower=1e-3),
        EffectParameter("damping_ratio", "ratio", "of the load behind a motor that stands still", lower=0.0),
    ),
    equation=r"J(1-r)\ddot q = \tau - F,\ J r\,\ddot q_l = F,\ F = K(q-q_l) + D(\dot q-\dot q_l)",
    variable="acceleration",
    source="Spong 1987",
    starts=starts,
    ringing=ringing,
    tries=3,
)

LOAD_SIDE = replace(
    EFFECT,
    name="joint_flexibility_load_side",
    kind="joint_flexibility",
    parameters=(
        replace(EFFECT.parameters[0], lower=0.1),
        EFFECT.parameters[1],
        replace(EFFECT.parameters[2], upper=0.2),  # beyond that it is a low-pass of the sensor, no spring
    ),
    amplitudes=(),
    starts=lambda s: [values for values in starts(s) if values[0] == 0.5],
)
"""The same with the encoder behind the spring, which sees the spring even where no inertia hangs behind it."""
STIFFENING = replace(
    EFFECT,
    name="joint_flexibility_stiffening",
    kind="joint_flexibility",
    parameters=(
        *EFFECT.parameters,
        EffectParameter("stiffening", "1/command squared", "of the spring, per squared torque without it", lower=0.0),
    ),
    equation=r"J(1-r)\ddot q = \tau - F,\ J r\,\ddot q_l = F,\ F = K\delta\,(1 + c\,\delta^2) + D\dot\delta,"
    r"\ \delta = q - q_l",
    includes=("joint_flexibility",),
    neutral=(0.0,),
    after=("joint_flexibility",),
    ringing=None,
    starts=lambda s: [(*values, 0.1 / s.torque_rms**2) for values in starts(s)[:1]],
)
STIFFENING_LOAD_SIDE = replace(
    STIFFENING,
    name="joint_flexibility_stiffening_load_side",
    parameters=(*LOAD_SIDE.parameters, STIFFENING.parameters[3]),
    amplitudes=(),
    includes=("joint_flexibility_load_side",),
    after=("joint_flexibility_load_side",),
    starts=lambda s: [(*values, 0.1 / s.torque_rms**2) for values in starts(s) if values[0] == 0.5][:1],
)
"""A spring that stiffens, with the encoder on either side."""
OTHERS = ("backlash", "backlash_load_side", BY_THE_LINK)
FORMS = exclusive((EFFECT, LOAD_SIDE, STIFFENING, STIFFENING_LOAD_SIDE))
EFFECTS = tuple(replace(form, excludes=(*form.excludes, *OTHERS)) for form in FORMS)
