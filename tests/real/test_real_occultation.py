"""The chords of Hertha of 2008, and the geometry of the event."""

import numpy as np

from lcbayes.data.formats.occultation import read_occultations
from lcbayes.geometry.sky_plane import west_north


def test_hertha(data_dir):
    (event,) = read_occultations(data_dir / "hertha-occultation" / "Hertha.occ")
    assert event.jd.shape == (18, 2)
    assert not event.negative.any()
    # ends are known to a tenth of a second, which is half a kilometre
    assert event.error_km.max() < 1.2
    assert np.ptp(event.place_km.reshape(-1, 2), axis=0).max() < 100.0
    # observers move as the file's velocity says, but for the rotation of the Earth
    moved = event.place_km[:, 1] - event.place_km[:, 0]
    velocity = moved / (86400.0 * np.ptp(event.jd, axis=1))[:, None]
    stated = west_north(event.to_earth_km) @ event.velocity_km_s
    assert np.linalg.norm(velocity.mean(axis=0) - stated) < 0.5
    # with the axis to the east, they would move elsewhere
    assert np.linalg.norm(velocity.mean(axis=0) - stated * [-1, 1]) > 5.0
