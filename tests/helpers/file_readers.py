"""Every reader of a file that a user gives, with sound texts for tests that damage them."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from lcbayes.core.errors import InputError
from lcbayes.data.read import read, read_geometry
from lcbayes.geometry.tle import read_tle
from lcbayes.physics.attitude import catalogue
from lcbayes.physics.bodies import mesh
from lcbayes.results.record import read_record
from lcbayes.simulation.scenarios.scenario import load
from lcbayes.tasks.batch.objects import objects

SCENARIOS = Path(__file__).resolve().parents[2] / "lcbayes" / "simulation" / "scenarios"
NAMED = ("one-facet", "two-facet-spin", "brick")
VECTORS = (
    "# frame: icrs\nt,flux,flux_err,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z,range_km,curve,band,extra\n"
    "0,1.5,0.1,1,0,0,0,1,0,700,a,V,x\n10,1.6,0.1,1,0,0,0,1,0.1,710,a,V,y\n"
    "20,1.5,0.1,1,0,0,0,1,0,700,b,V,\n"
)
PLACES = (
    "utc,mag,ra_deg,dec_deg,range_km,site_lat_deg,site_lon_deg,site_height_m\n"
    "2024-04-29T10:28:45Z,2.4,296.558,2.64,409.0,36.128,-95.988,201\n"
    "2024-04-29T10:30:27Z,2.3,294.895,4.36,400.3,36.128,-95.988,201\n"
)
HEIGHTS = (
    "utc;mag;mag_err;altitude_deg;azimuth_deg;height_km;site_lat_deg;site_lon_deg;site_height_m\n"
    "2022-01-25T12:53:02;7.8;0.1;23.1;45.8;543.3;32.44;-110.79;2790\n"
    "2022-01-25T12:54:02;7.9;0.1;25.1;46.8;543.3;32.44;-110.79;2790\n"
)
DAMIT = (
    "2\n2 0\n2443845.25 2.0 0 -2 0 3 0 0\n2443845.75 4.0 0 -2 0 3 0 0\n"
    "2 1\n2443846.5 7.5 0 0 1 0 4 3\n2443846.6 7.6 0 0 1 0 4 3\n"
)
ECSV = (
    "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: t, datatype: float64, unit: s}\n"
    "# - {name: flux, datatype: float64}\n# - {name: sun_x, datatype: float64}\n"
    "# - {name: sun_y, datatype: float64}\n# - {name: sun_z, datatype: float64}\n"
    "# - {name: obs_x, datatype: float64}\n# - {name: obs_y, datatype: float64}\n"
    "# - {name: obs_z, datatype: float64}\n# meta: {frame: icrs}\n"
    "t flux sun_x sun_y sun_z obs_x obs_y obs_z\n1 2 1 0 0 0 1 0\n2 3 1 0 0 0 1 0\n"
)
MMT9 = (
    "# Date Time StdMag Mag Filter Penumbra Distance Phase Channel Track\n"
    "2008-09-20 15:14:40 6.1 7.1 Clear 0 1593 71.6 4 777\n"
    "2008-09-20 15:15:00 6.1 7.1 Clear 0 1523 66.9 4 777\n"
)
ALCDEF = (
    "# one\nSTARTMETADATA\nOBJECTNUMBER=43\nFILTER=V\nLTCAPP=NONE\nDELIMITER=PIPE\nENDMETADATA\n"
    "DATA=2458910.5|+0.25|0.01|1.2\nDATA=2458910.6|+0.30|0.01|1.2\nENDDATA\n"
)
TIMES = "utc,mag\n2008-09-20T15:14:40Z,7\n2008-09-20T15:15:00Z,7\n"
OBJ = "o box\nusemtl side\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
TLE = (
    "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n"
    "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n"
)
RUN = (
    'schema = 4\ntask = "fit"\ncurve = "x.csv"\nversion = "0.1.0"\n\n'
    '[options]\nmodel = "faceted"\nseed = 1\nn_facets = 2\nspin = "none"\nlaw = ["a", "b"]\n\n'
    '[reading]\nsite = "1,2,3"\n\n[input.curve]\npath = "x.csv"\nsha256 = "00"\n'
)
BATCH = "name,curve,n_facets,tle,seed,error\na,one.csv,3,x.tle,1,\nb,two.csv,,,7,0.1\n"
TABLE = '[defaults]\nmodel = "faceted"\nn_facets = 2\n[[objects]]\ncurve = "b.csv"\nseed = 3\n'


@dataclass(frozen=True)
class Reader:
    """What reads a file of this suffix, and texts that it reads."""

    suffix: str
    read: Callable[[Path], object]
    texts: tuple[str, ...]


def _with_elements(path: Path) -> object:
    elements = path.with_name("object.tle")
    elements.write_text(TLE)
    return read(path, tle=elements, site="43.65,41.431,2030")


READERS = {
    "light curve": Reader(".csv", read, (VECTORS, PLACES, HEIGHTS, DAMIT, ECSV)),
    "ECSV": Reader(".ecsv", read, (ECSV, ECSV.replace("# ---\n", "# ---\n# delimiter: ' '\n"))),
    "geometry": Reader(".csv", read_geometry, (VECTORS, PLACES, HEIGHTS)),
    "DAMIT": Reader(".lcs", read, (DAMIT,)),
    "ALCDEF": Reader(".txt", partial(read, geometry=False), (ALCDEF,)),
    "with elements": Reader(".txt", _with_elements, (MMT9, TIMES)),
    "elements": Reader(".tle", read_tle, (TLE, "ISS\n" + TLE)),
    "scenario": Reader(
        ".toml", load, tuple((SCENARIOS / f"{n}.toml").read_text("utf-8") for n in NAMED)
    ),
    "body": Reader(".obj", mesh.read_body, (OBJ,)),
    "configuration": Reader(".toml", read_record, (RUN,)),
    "catalogue": Reader(".csv", objects, (BATCH,)),
    "table of objects": Reader(".toml", objects, (TABLE,)),
    "attitude law": Reader(
        ".txt",
        lambda p: catalogue.parse(p.read_bytes().decode("latin-1")),
        ("lvlh:yaw_deg=4,roll_deg=-1", "orbit-normal-spin:period_s=12.5"),
    ),
}


class Fault(AssertionError):
    """A reader did something else than read or refuse."""


def give(name: str, content: bytes, folder: Path) -> bool:
    """Let a reader have a file of this content; whether it took it.

    Raises
    ------
    Fault
        The reader raised anything but an InputError in one line, or warned.
    """
    reader = READERS[name]
    path = folder / f"file{reader.suffix}"
    path.write_bytes(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            reader.read(path)
    except InputError as fault:
        if "\n" in str(fault) or not str(fault):
            raise Fault(f"{name}: not one line: {fault!r} of {content!r}") from fault
        return False
    except Exception as fault:
        raise Fault(f"{name}: {type(fault).__name__}: {fault} of {content!r}") from fault
    return True


def scratch() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory(prefix="readers-")
