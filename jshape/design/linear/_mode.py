"""One linear mode: its checks, its decay, and equations that are continued as damping grows.

Times of the solved shapers are phases τ = ω_d t, frequencies are over the design frequency, so that the unknowns depend
on the damping (and the vibration) alone.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float

from jshape import _check
from jshape._roots import implicit, without_nan
from jshape._types import ArrayLike, Scalar


def mode(omega: ArrayLike, zeta: ArrayLike) -> tuple[Scalar, Scalar]:
    """The mode's frequency (rad/s) and damping ratio as arrays of one type, checked."""
    arrays = _check.scalar(omega, "omega"), _check.scalar(zeta, "zeta")
    _check.positive(arrays[0], "omega")
    _check.damping_ratio(arrays[1])
    # A plain number beside an array does not make double precision of a single one.
    dtypes = [array.dtype for given, array in zip((omega, zeta), arrays, strict=True) if hasattr(given, "dtype")]
    dtype = jnp.result_type(*(dtypes or [arrays[0].dtype]))
    return arrays[0].astype(dtype), arrays[1].astype(dtype)


def damped(omega: Scalar, zeta: Scalar) -> Scalar:
    """Damped frequency, rad/s."""
    return omega * jnp.sqrt(1 - zeta**2)


def decay(zeta: Scalar) -> Scalar:
    """Decay per radian of damped phase, nepers."""
    return zeta / jnp.sqrt(1 - zeta**2)


def parts(values: Complex[Array, " n"]) -> Float[Array, " parts"]:
    """Real parts, then imaginary parts."""
    return jnp.concatenate([values.real, values.imag])


_STEPS = 128
"""Steps from where the solution is known to the damping (and negative amplitude) asked for."""


def follow(residual, start: Float[Array, " unknowns"], begin: tuple, args: tuple) -> tuple[Array, Bool[Array, ""]]:
    """The root of ``residual(unknowns, args)`` that continues ``start``, the one for ``begin``; whether it was found

    A homotopy with a linear predictor. Derivatives come from the implicit function theorem at the end alone.
    """
    import optimistix as optx

    begin, end = jax.lax.stop_gradient((begin, args))
    eps = float(jnp.finfo(start.dtype).eps)
    solver = optx.Newton(rtol=64 * eps, atol=64 * eps)

    def step(carry, share):
        before, here = carry
        at = tuple(a + share * (b - a) for a, b in zip(begin, end, strict=True))
        ahead = optx.root_find(residual, solver, 2 * here - before, at, max_steps=6, throw=False).value
        return (here, ahead), None

    start = jax.lax.stop_gradient(start)
    shares = jnp.arange(1, _STEPS + 1, dtype=start.dtype) / _STEPS
    (_, guess), _ = jax.lax.scan(step, (start, start), shares)
    root = optx.root_find(residual, solver, guess, end, max_steps=6, throw=False).value
    root = implicit(lambda unknowns, *args: residual(unknowns, args), root, args)
    found = jnp.max(jnp.abs(residual(root, args))) < eps**0.5
    return root, found


def when_solved(times: Array, solved: Bool[Array, ""], hint: str, **given: Scalar) -> Array:
    """The times, if they solve the equations. *Raises* otherwise: at once where concrete, at run time where traced;
    where a traced number is NaN they are NaN."""
    if not _check.is_concrete(solved, times):
        return eqx.error_if(times, ~solved & without_nan(given), f"zeta must be lower: {hint}")
    if not bool(solved):
        values = ", ".join(f"{name} = {_check.show(value)}" for name, value in given.items())
        raise ValueError(f"zeta must be lower: for {values} {hint}")
    return times
