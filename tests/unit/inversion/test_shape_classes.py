"""The prior of shapes is that of the bodies that `benchmarks/shapes.py` simulates."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from lcbayes.inversion.attitude_scan.harmonics import ODD, ORDERS
from lcbayes.inversion.attitude_scan.shape_classes import LEAST_SD, classes, shape_prior
from tests.helpers.false_alarms import EACH

BODIES = 12
SCRIPT = Path(__file__).parents[3] / "benchmarks" / "shapes.py"


@pytest.fixture(scope="module")
def shapes():
    spec = importlib.util.spec_from_file_location("shapes", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_class_has_three_elongations(shapes):
    names, means, covariances = classes()
    assert set(names) == {f"{kind}, {part}" for kind in shapes.CLASSES for part in shapes.PARTS}
    assert means.shape == (len(names), ORDERS.size)
    assert np.all(np.linalg.eigvalsh(covariances) >= 0.9 * LEAST_SD**2)
    # Longitudes are arbitrary: only orders of zero that are even in z have a mean.
    assert np.all(means[:, (ORDERS != 0) | ODD] == 0.0)


@pytest.mark.parametrize("kind", ["cut", "boxy"])
@pytest.mark.statistical(false_alarm=EACH)
def test_other_bodies_of_a_class_have_its_coefficients(shapes, monkeypatch, kind):
    """Bodies of another seed, over random longitudes, against the mean and the covariance."""
    monkeypatch.setattr(shapes, "SEED", 1)
    found = shapes.coefficients(kind, BODIES)
    rows = [i for i, name in enumerate(classes()[0]) if name.startswith(kind)]
    means, covariances = (x[rows] for x in classes()[1:])
    mean = means.mean(axis=0)
    apart = means - mean
    sd = np.sqrt(np.diag(covariances.mean(axis=0) + apart.T @ apart / len(rows)))
    # |c| of each order has the same distribution at all longitudes.
    zonal = (ORDERS == 0) & ~ODD
    z = (found[:, zonal].mean(axis=0) - mean[zonal]) / (sd[zonal] / np.sqrt(BODIES))
    assert np.abs(z).max() < 6.0
    power = np.mean((found / sd)[:, ~zonal] ** 2)
    assert 0.5 < power < 2.0


def test_the_prior_of_all_classes_is_their_mixture():
    """Moments of draws from all classes in turn."""
    rng = np.random.default_rng(0)
    names, means, covariances = classes()
    draws = np.concatenate(
        [
            rng.multivariate_normal(m, c, 4000, method="cholesky")
            for m, c in zip(means, covariances, strict=True)
        ]
    )
    mean, covariance = shape_prior()
    sd = np.sqrt(np.diag(covariance))
    assert len(draws) == 4000 * len(names)
    np.testing.assert_allclose(draws.mean(axis=0), mean, atol=0.03 * sd.max())
    np.testing.assert_allclose(draws.std(axis=0) / sd, 1.0, atol=0.05)
