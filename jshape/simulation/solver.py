"""The kernel's step as a diffrax solver."""

from typing import ClassVar

import diffrax
import equinox as eqx
import jax.numpy as jnp

from jshape import _check
from jshape.simulation.integrate import METHODS, runge_kutta_step, tableau_of


class WrittenOut(diffrax.AbstractAdaptiveSolver):
    """A tableau of ``integrate``, its stages written out: adaptive steps, dense output, all of ``diffeqsolve``.

    Takes a single ``ODETerm`` on a one-dimensional array. *Raises* ``ValueError`` for an unknown method.
    """

    method: str = eqx.field(static=True, default="dopri8")

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = diffrax.ThirdOrderHermitePolynomialInterpolation.from_k

    def __check_init__(self):
        _check.one_of(self.method, "method", METHODS)

    def order(self, terms) -> int:
        del terms
        return {"dopri8": 8, "tsit5": 5}[self.method]

    def init(self, terms, t0, t1, y0, args) -> None:
        del terms, t0, t1, y0, args

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        del solver_state, made_jump
        step = terms.contr(t0, t1)

        def slope(fraction, y):
            return terms.vf(t0 + fraction * step, y, args)

        y1, error = runge_kutta_step(tableau_of(self.method), slope, y0, step)
        ends = jnp.stack([step * slope(jnp.zeros_like(step), y0), step * slope(jnp.ones_like(step), y1)])
        return y1, error, dict(y0=y0, y1=y1, k=ends), None, diffrax.RESULTS.successful

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)
