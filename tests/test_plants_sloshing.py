"""The sloshing tank: beside Laplace's equation by spectral elements, and Lagrange's equations of its pendulums."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.linalg import eigh

import jshape as js
from jshape import plants

LENGTH, WIDTH, DENSITY, GRAVITY = 0.8, 0.3, 900.0, 9.7


def tank(depth=0.25, **given):
    return plants.SloshingTank(LENGTH, depth, WIDTH, DENSITY, gravity=GRAVITY, **given)


def matrices(nodes, length):
    """Stiffness and mass matrix of one spectral element, and its nodes from 0 to the length."""
    inner = legendre.Legendre.basis(nodes - 1).deriv().roots()
    x = np.concatenate([[-1.0], inner, [1.0]])
    to_nodal = np.linalg.inv(legendre.legvander(x, nodes - 1))
    at, weights = legendre.leggauss(nodes + 2)
    values = legendre.legvander(at, nodes - 1) @ to_nodal
    slopes = np.stack([legendre.Legendre(column).deriv()(at) for column in to_nodal.T], axis=1)
    stiffness = slopes.T @ (weights[:, None] * slopes) * 2 / length
    return stiffness, values.T @ (weights[:, None] * values) * length / 2, (x + 1) * length / 2


def surface_modes(depth, nodes=22):
    """Frequencies² over gravity, shapes at the surface (mass-normalised), its mass matrix and its nodes.

    The potential of an incompressible liquid: ∇²φ = 0, no flow through the walls, g ∂φ/∂z = ω² φ at the surface.
    """
    kx, mx, x = matrices(nodes, LENGTH)
    kz, mz, _ = matrices(nodes, depth)
    whole = (np.einsum("ij,kl->kilj", kx, mz) + np.einsum("ij,kl->kilj", mx, kz)).reshape(nodes**2, -1)
    inner, top = slice(0, -nodes), slice(nodes**2 - nodes, None)
    # The potential below follows from that at the surface.
    reduced = whole[top, top] - whole[top, inner] @ np.linalg.solve(whole[inner, inner], whole[inner, top])
    values, shapes = eigh(reduced, mx)
    return values, shapes, mx, x - LENGTH / 2


@pytest.mark.parametrize("depth", [0.04, 0.25, 1.5])
def test_pendulums_have_the_frequencies_forces_and_waves_of_the_liquid(depth):
    plant = tank(depth, modes=3)
    values, shapes, mass, x = surface_modes(depth)
    # The first is the level; of the others every second one is antisymmetric.
    found = slice(1, 6, 2)
    np.testing.assert_allclose(plant.natural_frequency() ** 2, GRAVITY * values[found], rtol=1e-9)
    # A tilt θ of the pendulums is the surface x θ, projected on the modes.
    parts = shapes.T @ mass @ x
    np.testing.assert_allclose(plant.masses() * plant.lengths(), (DENSITY * WIDTH * parts**2)[found], rtol=1e-9)
    for mode, angle in enumerate(0.1 * np.eye(3)):
        shape = shapes[:, found][:, mode] * parts[found][mode]
        np.testing.assert_allclose(plant.surface(jnp.asarray(angle), jnp.asarray(x)), np.tan(0.1) * shape, atol=1e-9)
        assert plant.offset(jnp.asarray(angle)) == pytest.approx(np.tan(0.1) * shape[-1], rel=1e-9)
    # With all modes the pendulums and what is left would be the liquid, and the waves' height that of a tilted plane.
    many = tank(depth, modes=400)
    assert jnp.all(jnp.cumsum(many.masses()) < many.carried())
    assert many.offset(jnp.full(400, -0.1)) == pytest.approx(-np.tan(0.1) * LENGTH / 2, rel=1e-3)


@pytest.mark.parametrize("drive", ["acceleration", "velocity", "force"])
def test_equations_of_motion_are_lagranges(drive):
    plant = tank(drive=drive, trolley=plants.Trolley(mass=30.0, damping=4.0))
    masses, lengths, still = plant.masses(), plant.lengths(), plant.carried() - jnp.sum(plant.masses())

    def lagrangian(q, v):
        along = v[0] + lengths * jnp.cos(q[1:]) * v[1:]
        kinetic = masses @ (along**2 + (lengths * jnp.sin(q[1:]) * v[1:]) ** 2) + (30.0 + still) * v[0] ** 2
        return kinetic / 2 + GRAVITY * masses @ (lengths * jnp.cos(q[1:]))

    random = np.random.default_rng(0)
    q, v = jnp.asarray(random.normal(size=3)), jnp.asarray(random.normal(size=3))
    given = 1.7
    # M q'' = ∂L/∂q − (∂²L/∂q'∂q) q' + force, where the tank's own motion is free or given.
    inertia, rest = jax.jit(
        lambda q, v: (
            jax.hessian(lagrangian, 1)(q, v),
            jax.grad(lagrangian)(q, v) - jax.jacfwd(jax.grad(lagrangian, 1))(q, v) @ v,
        )
    )(q, v)
    if drive == "force":
        push = jnp.array([given - 4.0 * v[0], 0.0, 0.0])
        wanted = jnp.linalg.solve(inertia, rest + push)
        found = plant.vector_field(0.0, jnp.concatenate([q, v]), jnp.asarray(given))
        np.testing.assert_allclose(found, jnp.concatenate([v, wanted]), rtol=1e-10)
        energy = v @ inertia @ v / 2 - GRAVITY * masses @ (lengths * (jnp.cos(q[1:]) - 1))
        # What no force pushes keeps its momentum: that of the centres of mass.
        momentum = (
            30.0 * v[0]
            + plant.carried() * jax.jvp(lambda q: plant.payload(jnp.concatenate([q, v]), 0.0), (q,), (v,))[1]
        )
        np.testing.assert_allclose(momentum, jax.grad(lagrangian, 1)(q, v)[0], rtol=1e-12)
        left = plant.residual_energy(jnp.concatenate([q, v]), jnp.asarray(given))
        np.testing.assert_allclose(left, energy, rtol=1e-12)
        return
    second = given if drive == "acceleration" else 0.0
    wanted = jnp.linalg.solve(inertia[1:, 1:], rest[1:] - inertia[1:, 0] * second)
    rates = v[1:]
    if drive == "velocity":
        # The state's velocities are those after a dead stop.
        state, inputs = jnp.concatenate([q[1:], rates + given * jnp.cos(q[1:]) / lengths]), jnp.asarray(given)
        found = plant.vector_field(0.0, state, inputs)
        swept = jax.jvp(lambda place: given * jnp.cos(place) / lengths, (q[1:],), (rates,))[1]
        np.testing.assert_allclose(found, jnp.concatenate([rates, wanted + swept]), rtol=1e-10)
    else:
        found = plant.vector_field(0.0, jnp.concatenate([q[1:], rates]), jnp.asarray(given))
        np.testing.assert_allclose(found, jnp.concatenate([rates, wanted]), rtol=1e-10)


def test_damping_ratios_are_those_of_small_waves():
    plant = tank(zeta=0.03)
    rest = plant.rest_state(jnp.asarray(0.0))
    matrix = jax.jacfwd(lambda y: plant.vector_field(0.0, y, jnp.asarray(0.0)))(rest)
    poles = np.linalg.eigvals(matrix)
    np.testing.assert_allclose(-poles.real / np.abs(poles), 0.03, rtol=1e-9)
    np.testing.assert_allclose(np.sort(np.abs(poles))[::2], plant.natural_frequency(), rtol=1e-9)


@pytest.mark.parametrize("modes", [pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_free_tank_has_its_waves_frequencies_whatever_the_damping(modes):
    free, damped = (tank(modes=modes, drive="force", zeta=zeta) for zeta in (0.0, 0.3))
    matrix = jax.jacfwd(lambda y: free.vector_field(0.0, y, jnp.asarray(0.0)))(free.rest_state(jnp.asarray(0.0)))
    # A pair of zeros is the tank's own motion.
    waves = np.sort(np.abs(np.linalg.eigvals(matrix)))[2::2]
    np.testing.assert_allclose(np.atleast_1d(free.natural_frequency()), waves, rtol=1e-9)
    np.testing.assert_allclose(damped.natural_frequency(), free.natural_frequency(), rtol=1e-12)


@pytest.mark.slow
def test_a_tuned_shaper_quiets_both_modes():
    plant = tank(modes=2)
    move = js.Trapezoid(1.0, 0.5, 1.0)
    first, second = 2 * np.pi / np.asarray(plant.natural_frequency())
    solution = js.tune(plant, move, 4, 0.5 * (first + second))
    bare = float(js.residual_energy(plant, None, move))
    assert solution.status is js.Status.CONVERGED
    assert solution.objective < 1e-12 * bare
    peak = lambda shaper: float(js.peak_deflection(plant, shaper, move))
    assert peak(solution.shaper) < peak(None)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (dict(length=0.0), "length must be greater than 0"),
        (dict(depth=-1.0), "depth must be greater than 0"),
        (dict(zeta=1.0), "zeta must be"),
        (dict(modes=0), "modes must be a whole number of at least 1, not 0"),
        (dict(modes=1.5), "modes must be a whole number"),
        (dict(drive="displacement"), "drive must be one of"),
    ],
)
def test_wrong_tanks(given, words):
    with pytest.raises(ValueError, match=words):
        plants.SloshingTank(**dict(length=1.0, depth=0.5) | given)
