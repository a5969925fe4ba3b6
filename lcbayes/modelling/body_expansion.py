"""The brightness of a known body near one solution, as a polynomial that is cheap.

A gradient of the posterior of a rocket stage takes seven milliseconds for 450 points, nearly all of
it in the shadows between its parts. Near one solution the brightness hardly bends.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any, NamedTuple

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.expansion import factors, monomials
from lcbayes.physics.reflectance import LAWS, REFLECTANCES
from lcbayes.simulation.known_bodies.reader import BodyFile

DEGREES = (3, 2)  # the first of them with few enough monomials
MOST_MONOMIALS = 300
RANK = 60  # number of components of the light curves
FITTED = 3  # number of draws for each monomial

type Numbers = Mapping[str, Mapping[str, Any]]  # material → parameter → value


def _degree(size: int) -> int:
    """Degree of a polynomial in so many variables."""
    few = (d for d in DEGREES if len(factors(size, d)) <= MOST_MONOMIALS)
    return next(few, DEGREES[-1])


def number_of_monomials(size: int) -> int:
    """Number of coefficients of a polynomial in so many variables."""
    return len(factors(size, _degree(size)))


class BodyExpansion(NamedTuple):
    """Brightness as a function of motion, lobes and lengths p, and of the reflectances.

    f is linear in each reflectance, and materials add up. With all reflectances of a material 0 or
    1, and those of the other materials 0, it is one of K functions of p alone, and

        f(t) = Σₖ wₖ fₖ(p, t),

    where wₖ is a product of reflectances r and of 1 − r (`weights`). Each fₖ is replaced by the
    polynomial that fits it best at draws about the solution. Of all light curves only the principal
    components of those of the draws are kept.

    Attributes
    ----------
    middle : (3, 3)
        Attitude from which the motion in p is counted.
    centre : (d,)
        Mean of p.
    whitening : (d, d)
        Of p − centre.
    components : (T, R), single precision
        Of the light curves, orthonormal.
    response : (R, F K), single precision
        Coefficients of the F monomials of the K functions, in these components.
    """

    middle: jax.Array
    centre: jax.Array
    whitening: jax.Array
    components: jax.Array
    response: jax.Array

    @classmethod
    def of(
        cls, middle: jax.Array, p: jax.Array, weights: jax.Array, curves: jax.Array
    ) -> BodyExpansion:
        """From p (n, d), w (n, K) and fₖ (n, K, T) of n draws."""
        n, size = p.shape
        centre, sd = p.mean(axis=0), p.std(axis=0)
        unit = (p - centre) / sd
        values, vectors = jnp.linalg.eigh(unit.T @ unit / n)
        whitening = (vectors / jnp.sqrt(jnp.maximum(values, 1e-9))).T / sd
        rows = jax.vmap(lambda x: monomials(whitening @ (x - centre), _degree(size)))(p)
        fitted = jnp.linalg.lstsq(rows, curves.reshape(n, -1))[0]
        response = jnp.moveaxis(fitted.reshape(-1, *curves.shape[1:]), 2, 0)
        response = response.reshape(len(response), -1)
        each = jax.vmap(jnp.outer)(rows, weights).reshape(n, -1)
        components = jnp.linalg.svd(response @ each.T, full_matrices=False)[0][:, :RANK]
        kept = (x.astype(jnp.float32) for x in (components, components.T @ response))
        return cls(middle, centre, whitening, *kept)

    def __call__(self, p: jax.Array, weights: jax.Array) -> jax.Array:
        """f (T,) of p (d,) and w (K,)."""
        m = monomials(self.whitening @ (p - self.centre), _degree(p.size))
        each = jnp.outer(m, weights).ravel().astype(self.response.dtype)
        return (self.components @ (self.response @ each)).astype(m.dtype)


def unknown_reflectances(file: BodyFile) -> dict[str, tuple[str, ...]]:
    """The unknown parameters of each material in which its brightness is linear."""
    materials = file.body.materials
    return {
        name: tuple(k for k in unknown if k in REFLECTANCES)
        for name, unknown in file.priors.items()
        if LAWS[materials[name].law].multilinear
    }


def shape_of(file: BodyFile, values: Numbers, sizes: Mapping[Any, Any]) -> jax.Array:
    """The other unknown numbers: lobes and lengths, logarithms of those of log-normal priors."""
    linear = unknown_reflectances(file)
    others = [
        (prior, values[name][key])
        for name, unknown in file.priors.items()
        for key, prior in unknown.items()
        if key not in linear.get(name, ())
    ]
    others += [(prior, sizes[key]) for key, prior in file.sizes.items()]
    numbers = [jnp.log(x) if prior.kind == "log-normal" else x for prior, x in others]
    return jnp.stack([jnp.asarray(x) for x in numbers]) if numbers else jnp.zeros(0)


def _corners(linear: Mapping[str, tuple[str, ...]]) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Each material with each choice of 0 and 1 for its reflectances, but all 0."""
    for name, keys in linear.items():
        for ends in product((0, 1), repeat=len(keys)):
            if any(ends):
                yield name, ends


def weights(file: BodyFile, values: Numbers) -> jax.Array:
    """w (K,), of all reflectances 0 first."""
    linear = unknown_reflectances(file)
    each = [
        jnp.prod(
            jnp.stack(
                [
                    values[name][key] if end else 1.0 - values[name][key]
                    for key, end in zip(linear[name], ends, strict=True)
                ]
            )
        )
        for name, ends in _corners(linear)
    ]
    return jnp.stack([1.0 - sum(each), *each])


def corners(file: BodyFile) -> dict[str, dict[str, jax.Array]]:
    """The reflectances (K,) of the K functions."""
    linear = unknown_reflectances(file)
    chosen = [("", ()), *_corners(linear)]
    return {
        name: {
            key: jnp.array([float(one == name and ends[i]) for one, ends in chosen])
            for i, key in enumerate(keys)
        }
        for name, keys in linear.items()
    }
