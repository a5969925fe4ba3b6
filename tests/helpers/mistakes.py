"""Usual mistakes of users: files, command, and what the message must contain.

``tests/e2e/test_mistakes.py`` runs them all, and ``docs/make_mistakes.py`` writes
``docs/mistakes.md`` from them.
"""

from __future__ import annotations

import contextlib
import io
import shlex
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lcbayes.cli.main import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE
from tests.helpers.small_tables import MAGS, PASS, VECTORS, sky

SCENARIOS = Path(__file__).resolve().parents[2] / "lcbayes" / "simulation" / "scenarios"
SITE = "--site 36.4,28.2,100"
ORBIT = f"--tle object.tle {SITE}"
FIT = "fit vectors.csv -o out"
BODY = """[[body.parts]]
kind = "cylinder"
length = 5.0
radius = -1.0
[materials.paint]
law = "lambertian"
r_diff = 0.3
"""


@dataclass(frozen=True)
class Mistake:
    """One mistake.

    Attributes
    ----------
    what : the mistake in a few words
    command : what is typed after ``lcbayes``
    says : what the message must contain
    files : files that differ from the correct ones
    noticed : whether the command runs and a note warns; otherwise it is refused
    """

    what: str
    command: str
    says: tuple[str, ...]
    files: Mapping[str, str | bytes] = field(default_factory=dict[str, str | bytes])
    noticed: bool = False

    @property
    def status(self) -> int:
        return EXIT_DONE if self.noticed else EXIT_BAD_INPUT


def _read(what: str, text: str | bytes, *says: str, options: str = "", noticed: bool = False):
    """A mistake in the file ``pass.csv``."""
    command = f"convert pass.csv out.csv {options}".rstrip()
    return Mistake(what, command, says, {"pass.csv": text}, noticed)


MISTAKES: dict[str, list[Mistake]] = {
    "Files": [
        Mistake("A path is misspelt", "look pas.csv", ("pas.csv does not exist", "check the path")),
        Mistake("A folder is given in place of a file", "look .", (". is a folder", "give a file")),
        _read("The file is empty", "", "pass.csv is empty", "check that it was saved"),
        _read("An Excel workbook", b"PK\x03\x04\x14\0\6\0", "an Excel workbook", "save it as CSV"),
        _read("A FITS file", b"SIMPLE  =      T\0", "is a FITS file", "write its table as ECSV"),
        _read(
            "A web page was saved in place of the download",
            "<!DOCTYPE html>\n<html>Log in</html>\n",
            "is a web page",
            "download the file itself",
        ),
        Mistake(
            "Two-line elements are given in place of the light curve",
            "look object.tle",
            ("object.tle holds two-line elements", "give a light curve", "--tle"),
        ),
        _read(
            "Columns are separated by another character",
            PASS.replace(",", "|"),
            "line 1 is one cell, 'utc|mag|mag_err'",
            "separate cells by commas",
        ),
        _read(
            "Decimal commas between commas",
            PASS.replace("7.", "7,"),
            "line 2 has 4 comma-separated cells",
            "decimal commas need semicolons",
        ),
        _read(
            "Photometry in ALCDEF is given where directions are needed",
            "STARTMETADATA\nOBJECTNAME=Ariadne\nENDMETADATA\nDATA=2458910.5|14.1\nENDDATA\n",
            "is ALCDEF, which holds no directions",
            "lcbayes look finds its periods",
        ),
        _read("The header is missing", PASS.split("\n", 1)[1], "no column of times", "--columns"),
    ],
    "Columns": [
        _read(
            "Names of columns are not recognised",
            PASS.replace("utc,mag,", "when,brightness,"),
            "no column of times",
            "found: mag_err, when, brightness",
            "--columns t=NAME if it is in seconds",
        ),
        _read(
            "--columns is the wrong way round",
            PASS.replace(",mag,", ",V,"),
            "the lcbayes name comes first",
            "mag=V",
            options="--columns V=mag",
        ),
        _read(
            "A column could be an error, under an unusual name",
            PASS.replace("mag_err", "sigma_phot"),
            "'sigma_phot' looks like an error",
            "--columns mag_err='sigma_phot'",
        ),
        _read(
            "Errors are missing",
            "\n".join(line.rsplit(",", 1)[0] for line in PASS.splitlines()),
            "no errors",
            "--error",
            options=ORBIT,
            noticed=True,
        ),
        _read(
            "Magnitudes in a column flux",
            PASS.replace("mag", "flux"),
            "for which a body would need",
            "name the column mag",
            options=ORBIT,
        ),
        _read(
            "Magnitudes in a column flux, without distances",
            VECTORS,
            "flux without range_km is taken as reduced to 1 m",
            "if it holds magnitudes, name it mag",
            noticed=True,
        ),
        _read(
            "Magnitudes in a DAMIT file",
            "1\n8 0\n"
            + "".join(f"2458910.{50 + i} {mag} 2 0 0 1 0 0\n" for i, mag in enumerate(MAGS[:8])),
            "as magnitudes do",
            "give intensities, 10^(-0.4 mag)",
        ),
        _read(
            "Fluxes in a column mag",
            PASS.replace(",7.", ",0.00000007"),
            "within 0.001 of zero",
            "name the column flux",
            options=ORBIT,
        ),
        _read(
            "Errors in millimagnitudes",
            PASS.replace("0.02", "20"),
            "mag_err has 9 values >= 9 mag",
            "in mag",
            options=ORBIT,
        ),
        Mistake(
            "The error is in another unit than the flux",
            "convert box-wing.csv out.csv --tle object.tle --error 0.02",
            ("the error is 0.02 and the flux", "in the unit of the flux"),
            noticed=True,
        ),
    ],
    "Values": [
        _read(
            "NaN", PASS.replace("7.11", "nan", 1), "mag has 1 value not finite", "drop those rows"
        ),
        _read(
            "99.99 for missing measurements",
            PASS.replace("7.11", "99.99", 1),
            "mag has 1 value outside -30 .. 40 mag",
            "drop those rows",
            options=ORBIT,
        ),
        _read(
            "Rows are not sorted by time",
            PASS.replace("T19:54:00", "T19:53:30"),
            "utc has 1 value earlier than the row before",
            "line 5",
            "sort the rows by time",
            options=ORBIT,
        ),
        _read(
            "A row is repeated",
            PASS + PASS.splitlines()[-1],
            "equal to the row before",
            "drop the repeats",
            options=ORBIT,
        ),
        _read(
            "One point",
            "\n".join(PASS.splitlines()[:2]),
            "holds one point",
            "at least two",
            options=ORBIT,
        ),
    ],
    "Times": [
        _read(
            "Dates are written day first",
            PASS.replace("2026-04-15T", "15.04.2026 "),
            "not written in ISO 8601",
            "write them like",
        ),
        _read(
            "Modified Julian dates in a column jd",
            VECTORS.replace("t,", "jd,").replace("\n", "\n6104")[:-4],
            "outside the years 1900 .. 2099",
            "MJD + 2400000.5",
        ),
        _read(
            "Julian dates in a column t, which is in seconds",
            VECTORS.split("\n")[0]
            + "".join(f"\n2461146.{i:04d},7.{i},0.1,1,0,0,0,1,0" for i in range(10, 20)),
            "as Julian dates do",
            "--columns jd=t",
        ),
        _read(
            "Seconds without a date",
            PASS.replace("utc", "t")
            .replace("2026-04-15T19:5", "")
            .replace(":", "")
            .replace("Z", ""),
            "seconds without a date",
            "epoch_jd",
            options=ORBIT,
        ),
        _read(
            "Local time in place of UTC",
            PASS.replace("T19", "T22"),
            "below the horizon",
            "the times (UTC)",
            options=ORBIT,
        ),
        _read(
            "Local time in place of UTC, with directions in the sky",
            sky(hours=-9),
            "the Sun is up at the observer",
            "UTC",
            options=SITE,
            noticed=True,
        ),
    ],
    "Places and elements": [
        _read(
            "The sign of the longitude is wrong",
            PASS,
            "below the horizon",
            "the opposite sign of the longitude (east is positive)",
            options="--tle object.tle --site 36.4,-28.2,100",
        ),
        _read(
            "Latitude and longitude are exchanged",
            PASS,
            "below the horizon",
            "latitude and longitude exchanged",
            options="--tle object.tle --site 28.2,36.4,100",
        ),
        _read(
            "The site is in radians",
            PASS,
            "below the horizon",
            "degrees in place of radians",
            options="--tle object.tle --site 0.6353,0.4922,100",
        ),
        _read(
            "The site is a name",
            PASS,
            "site is 'Rhodes'",
            "43.65,41.431,2030",
            options="--tle object.tle --site Rhodes",
        ),
        _read("No site", PASS, "names no site", "--site LAT,LON,H", options="--tle object.tle"),
        _read("No geometry", PASS, "has no geometry", "--tle FILE"),
        Mistake(
            "Elements of another object",
            f"convert pass.csv out.csv --tle other.tle {SITE}",
            ("below the horizon", "the elements are of this object"),
        ),
        _read(
            "Elements two months old",
            PASS.replace("-04-15", "-06-15"),
            "are 61 days from some of the times",
            "get elements within 30 days",
            options=ORBIT,
        ),
        _read(
            "Elements three weeks old",
            PASS.replace("-04-15", "-05-05"),
            "up to 20 days from the observations",
            "get elements within 5 days",
            options=ORBIT,
            noticed=True,
        ),
        _read(
            "Detections at times when the object is in the Earth's shadow",
            PASS.replace("T19:5", "T19:3"),
            "in the Earth's shadow",
            "check the times",
            options="--tle object.tle --site -31,27,100",
        ),
        _read(
            "Right ascension in hours",
            sky(ra_unit=15.0),
            "km/s",
            "in degrees (not hours)",
            options="--site 36.4,135,100",
            noticed=True,
        ),
        _read(
            "Distances in metres",
            sky(range_unit=1000.0),
            "km/s",
            "range_km in km",
            options=SITE,
            noticed=True,
        ),
        _read(
            "Vectors that point the wrong way",
            VECTORS.replace("1,0,0,0,1,0", "-1,0,0,1,0.05,0"),
            "stands in front of the Sun",
            "check the signs",
            noticed=True,
        ),
    ],
    "Options": [
        Mistake(
            "An option is misspelt or abbreviated",
            f"{FIT} --n-facet 2",
            ("unknown option --n-facet", "did you mean --n-facets?"),
        ),
        Mistake("A command is misspelt", "fti pass.csv", ("unknown command 'fti'", "mean fit?")),
        Mistake("A value is missing", f"{FIT} --model", ("--model: expected one argument",)),
        Mistake("Two files", "look pass.csv vectors.csv", ("unexpected argument 'vectors.csv'",)),
        Mistake(
            "A model is misspelt",
            f"{FIT} --model facetted",
            ("unknown model 'facetted'", "did you mean faceted?"),
        ),
        Mistake(
            "The file of a model is missing",
            f"{FIT} --model ./mine.py",
            ("model file ./mine.py does not exist", "give the path"),
        ),
        Mistake(
            "An attitude law is misspelt",
            f"{FIT} --model stabilised --law lvhl",
            ("unknown attitude law 'lvhl'", "did you mean lvlh?"),
        ),
        Mistake(
            "A sampler is misspelt",
            f"{FIT} --sampler nut",
            ("--sampler is 'nut'", "did you mean nuts?"),
        ),
        Mistake(
            "A negative number of facets",
            f"{FIT} --n-facets -3",
            ("--n-facets is -3", "expected a whole number >= 1"),
        ),
        Mistake(
            "The period is in seconds in place of hours",
            f"{FIT} --model convex-grid --period 90",
            ("--period is 90 hours", "covers 110 s", "90 s are 0.025 hours"),
        ),
        Mistake(
            "The period is missing",
            f"{FIT} --model convex-grid",
            ("needs 'period'", "give it with --period"),
        ),
        Mistake(
            "An option of another model",
            f"{FIT} --law lvlh",
            ("model 'faceted' has no attitude law", "--reflectance"),
        ),
        Mistake(
            "An option of a model is misspelt",
            f"{FIT} --model body --body plate --set scale=0",
            ("model 'body' has no option 'scale'", "mean scale_sd?"),
        ),
        Mistake(
            "A length of a body is negative",
            f"{FIT} --model body --body mine.toml",
            ("mine.toml, line 4: ", "radius is -1.0"),
        ),
        Mistake(
            "A range of periods backwards",
            "scan vectors.csv -o out --period-range 0.03,0.02",
            ("--period-range is 0.03,0.02", "the shortest and the longest period"),
        ),
        Mistake(
            "A scenario is misspelt",
            "simulate boxwing -o out.csv",
            ("called 'boxwing'", "available:", "box-wing"),
        ),
    ],
    "Folders": [
        Mistake("No output folder", "fit vectors.csv", ("no place for the results", "-o DIR")),
        Mistake(
            "The output folder holds another kind of result",
            "spin vectors.csv -o looked",
            ("looked already holds results of lcbayes look", "choose another"),
        ),
        Mistake(
            "predict from a folder that holds no fit",
            "predict looked vectors.csv -o out.csv",
            ("looked holds no posterior.nc", "lcbayes fit -o"),
        ),
        Mistake(
            "The arguments of predict are exchanged",
            "predict vectors.csv looked -o out.csv",
            ("vectors.csv holds no posterior.nc", "give the folder"),
        ),
        Mistake(
            "report on a folder without results",
            "report empty",
            ("empty holds no results of lcbayes", "a folder that -o named"),
        ),
        Mistake(
            "The folder of the output file is missing",
            "convert vectors.csv absent/out.csv",
            ("absent/out.csv cannot be written", "a folder that exists"),
        ),
    ],
}


def prepare(folder: Path) -> None:
    """The correct files, a results folder of ``look`` and an empty folder."""
    elements = (SCENARIOS / "box-wing.tle").read_text()
    (folder / "object.tle").write_text(elements)
    shutil.copy(SCENARIOS / "box-wing.csv", folder / "box-wing.csv")
    (folder / "other.tle").write_text(
        "1 25544U 98067A   26105.51782528 -.00002182  00000-0 -11606-4 0  2921\n"
        "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n"
    )
    (folder / "pass.csv").write_text(PASS)
    (folder / "vectors.csv").write_text(VECTORS)
    (folder / "mine.toml").write_text(BODY)
    (folder / "empty").mkdir()
    assert run(folder, "look vectors.csv -o looked --no-report")[0] == EXIT_DONE


def run(folder: Path, command: str) -> tuple[int, str, str]:
    """Status, standard output and standard error of a command in a folder."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(shlex.split(command))
    return status, out.getvalue(), err.getvalue()


@dataclass(frozen=True)
class Answer:
    """What the command says: its status, its message, and the names of files that it made."""

    status: int
    message: str
    made: frozenset[str]


def answers(folder: Path) -> dict[str, Answer]:
    """The answer to each mistake, by its description."""
    prepare(folder)
    return {m.what: give(folder, m) for group in MISTAKES.values() for m in group}


def give(folder: Path, mistake: Mistake) -> Answer:
    """The answer to a mistake, without the name of the command."""
    before = {path.name for path in folder.iterdir()}
    for name, content in mistake.files.items():
        path = folder / name
        path.write_bytes(content) if isinstance(content, bytes) else path.write_text(content)
    status, out, err = run(folder, mistake.command)
    for name in mistake.files:
        (folder / name).write_text(PASS)
    made = frozenset(path.name for path in folder.iterdir()) - before
    for name in made:
        (folder / name).unlink()
    if not mistake.noticed:
        assert out == "", mistake.what
        assert err.count("\n") == 1, err
        return Answer(status, err.rstrip("\n").partition(": ")[2], made)
    notes = [line.removeprefix("note: ") for line in out.splitlines() if line.startswith("note: ")]
    fitting = (note for note in notes if all(said in note for said in mistake.says))
    return Answer(status, next(fitting, f"{notes}"), made)
