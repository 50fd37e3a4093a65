"""A robust shaper that also cancels the vibration that is there when the move begins.

Five impulses, a quarter of the damped period apart, are as many as the conditions: they sum to 1, they leave the mode
the phasor ρ that cancels its initial vibration, and what they leave does not change with the frequency to first order.
With ρ = 0 the second and fourth vanish, and it is the ZVD shaper.
"""

from typing import Any

import numpy as np

from jshape.adaptive.formulas import Numbers


def transition(numbers: Numbers, omega: Any, zeta: Any, total: Any, rest: Any, slope: Any = 0.0) -> tuple[Any, Any]:
    """Amplitudes and times of five impulses with Σ A = S, Σ A exp(−p t) = ρ and Σ A t exp(−p t) = σ; p the mode's pole.

    Args:
        numbers: JAX or NumPy.
        omega: undamped natural frequency, rad/s.
        zeta: damping ratio.
        total: S, 1 for a whole move.
        rest: ρ, complex, what the impulses alone are to leave: minus the phasor that the mode has at the time of the
            first impulse, over the one that a full step would give it; of any shape.
        slope: σ, s, complex, of the same shape; 0, as of a ZVD shaper, unless given.

    Returns:
        Amplitudes, of shape (5, …), positive for small ρ and S = 1, and times (s), of shape (5,).

    Source: Singer and Seering's (1990) ZVD with the initial state of Dhanda, Vaughan and Singhose; the five equations
        are solved by hand.
    """
    xp = numbers.xp
    root = xp.sqrt(1 - zeta * zeta)
    quarter = np.pi / (2 * omega * root)
    # Σ B_i (−j)^i = ρ and Σ B_i i (−j)^i = σ / quarter for B_i = A_i q^i.
    q = xp.exp(zeta * np.pi / (2 * root))
    real, imaginary, slope = rest.real, rest.imag, slope / quarter
    first, third = (slope.imag - 3 * imaginary) / 2, (slope.imag - imaginary) / 2
    half = slope.real / 2
    fourth = total - real + half * (1 + 1 / q**2) - first / q - third / q**3
    fourth = fourth / (1 + 2 / q**2 + 1 / q**4)
    scaled = (real + fourth - half, first, 2 * fourth - half, third, fourth)
    amplitudes = xp.stack([part / q**i for i, part in enumerate(scaled)])
    return amplitudes, quarter * np.arange(5.0)
