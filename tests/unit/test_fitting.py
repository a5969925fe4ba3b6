"""What a fit says that it rests on."""

from __future__ import annotations

import pytest
import small

from lcbayes import fitting, gallery

ERRORS = "The errors of the file are taken as they are, independent"


@pytest.mark.parametrize(
    ("model", "options", "said"),
    [
        ("faceted", {}, ERRORS + " and Gaussian."),
        ("faceted", {"noise_law": "student-t"}, "Noise follows Student's t"),
        ("faceted", {"noise_law": "mixture"}, "Some points are outliers"),
        ("stabilised", {"scatter": 0.0}, "Noise follows Student's t"),  # by default
    ],
)
def test_the_law_of_noise_is_named(model, options, said):
    told = fitting._assumptions(small.curve(), gallery.find(model), options)
    assert any(line.startswith(said) for line in told)
    assert any(line.startswith(ERRORS) for line in told)
    assert any("Gaussian" in line for line in told) == said.endswith("Gaussian.")
