"""What is left of a stopped run, and whose it is."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.files import write_atomic
from lcbayes.core.toml import to_toml
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.identity import digest
from lcbayes.results.store import PAGE, results_folder

IDENTITY = {"seed": 1, "model": "faceted"}


def test_arrays_come_back_bit_for_bit(tmp_path):
    kept = {"z": np.random.default_rng(0).standard_normal((3, 2)), "n": np.arange(3)}
    Checkpoint(tmp_path / "c", IDENTITY).save("a", kept)
    again = Checkpoint(tmp_path / "c", IDENTITY)
    assert again.resumed
    result = again.load("a")
    assert result is not None
    for name, values in kept.items():
        np.testing.assert_array_equal(result[name], values)
        assert result[name].dtype == values.dtype
    assert again.load("b") is None


def test_another_identity_starts_afresh(tmp_path):
    Checkpoint(tmp_path / "c", IDENTITY).save("a", {"z": np.zeros(1)})
    other = Checkpoint(tmp_path / "c", IDENTITY | {"seed": 2})
    assert not other.resumed
    assert other.load("a") is None
    assert not Checkpoint(tmp_path / "c", IDENTITY).resumed  # nor does the first come back


def test_finishing_empties(tmp_path):
    checkpoint = Checkpoint(tmp_path / "c", IDENTITY)
    checkpoint.save("a", {"z": np.zeros(1)})
    checkpoint.finish()
    assert not Checkpoint(tmp_path / "c", IDENTITY).resumed


def test_without_a_folder_nothing_is_kept():
    checkpoint = Checkpoint(None, IDENTITY)
    checkpoint.save("a", {"z": np.zeros(1)})
    assert checkpoint.load("a") is None
    assert not checkpoint.resumed
    checkpoint.finish()


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("old")

    def broken(scratch):
        scratch.write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_atomic(path, broken)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    write_atomic(path, lambda p: p.open("w").close())
    assert path.read_text() == ""


def test_no_pickle_is_read(tmp_path):
    checkpoint = Checkpoint(tmp_path / "c", IDENTITY)
    np.savez(tmp_path / "c" / "a.npz", z=np.array([Told()], dtype=object))
    assert checkpoint.load("a") is None
    assert not Told.made_again


class Told:
    """Says when a pickle of it is read."""

    made_again = False

    def __setstate__(self, _) -> None:
        Told.made_again = True


@pytest.mark.parametrize("left", [0, 300, -1])
def test_a_part_that_was_cut_off_is_done_again(left, tmp_path):
    said: list[str] = []
    checkpoint = Checkpoint(tmp_path / "c", IDENTITY, said.append)
    checkpoint.save("a", {"z": np.arange(100.0)})
    path = tmp_path / "c" / "a.npz"
    path.write_bytes(path.read_bytes()[:left])
    assert checkpoint.load("a") is None
    assert said == [f"{path} is damaged; that part is done again"]
    checkpoint.save("a", {"z": np.arange(100.0)})
    assert checkpoint.load("a") is not None


def test_what_is_no_regular_file_is_not_replaced(tmp_path):
    """Of a link the file pointed to is; a device is written into."""
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "target.txt", tmp_path / "link.txt"
    link.symlink_to(target)
    for text in ("new", "newer"):  # the link dangles first
        write_atomic(link, lambda p, text=text: p.write_text(text))
        assert link.is_symlink()
        assert target.read_text() == text
    ours, theirs = os.openpty()
    try:
        device = Path(os.ttyname(theirs))
        write_atomic(device, lambda p: p.write_text("shown"))
        assert device.is_char_device()
        assert os.read(ours, 100) == b"shown"
    finally:
        os.close(ours)
        os.close(theirs)


def refuse(out: Path, work) -> None:
    with results_folder(out, "fit") as folder:
        work(folder.checkpoint(IDENTITY, lambda _: None))
        raise InputError("the cluster is gone")


def test_a_refused_run_leaves_nothing_but_work_that_is_done(tmp_path):
    with pytest.raises(InputError):
        refuse(tmp_path / "new", lambda _: None)
    assert not (tmp_path / "new").exists()
    with pytest.raises(InputError):
        refuse(tmp_path / "out", lambda checkpoint: checkpoint.save("a", {"z": np.zeros(1)}))
    assert Checkpoint(tmp_path / "out" / "checkpoint", IDENTITY).load("a") is not None


def test_a_result_replaces_the_last_one_whole(tmp_path):
    for name in ("report.html", "shape.obj", "shape-2.obj", "shapes.md", "posterior.nc"):
        (tmp_path / name).write_text("old")
    (tmp_path / "run.toml").write_text('schema = 4\ntask = "fit"\n')
    (tmp_path / "figures").mkdir()
    with results_folder(tmp_path, "fit") as folder:
        before = {p.name for p in tmp_path.iterdir()}
        with pytest.raises(TypeError), folder.staging() as aside:
            (aside / "run.toml").write_text(None)  # type: ignore[arg-type]
        assert {p.name for p in tmp_path.iterdir()} == before
        with folder.staging(PAGE) as aside:  # the report alone
            (aside / "report.html").write_text("new")
        left = {p.name for p in tmp_path.iterdir()}
        assert left == {"run.toml", "shapes.md", "posterior.nc", "report.html", ".lock"}
        with folder.staging() as aside:
            (aside / "run.toml").write_text("new")
    assert {p.name for p in tmp_path.iterdir()} == {"run.toml", "shapes.md", ".lock"}
    assert (tmp_path / "run.toml").read_text() == "new"


def test_a_report_that_is_of_no_result_is_the_users_own(tmp_path):
    (tmp_path / "report.html").write_text("mine")
    with results_folder(tmp_path, "fit") as folder, folder.staging() as aside:
        (aside / "run.toml").write_text("new")
    assert (tmp_path / "report.html").read_text() == "mine"


def test_one_run_at_a_time_which_removes_what_a_killed_one_left(tmp_path):
    (tmp_path / ".new-abc123").mkdir()
    (tmp_path / "posterior.nc").write_text("whole")
    alone = partial(results_folder, tmp_path, "fit")
    with alone(), pytest.raises(InputError, match="another run"), alone():
        pass
    assert {p.name for p in tmp_path.iterdir()} == {".lock", "posterior.nc"}


def test_a_folder_holds_the_results_of_one_task(tmp_path):
    """Those that are there, and those of a run that was stopped."""
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "run.toml").write_text('schema = 4\ntask = "fit"\n')
    with (
        pytest.raises(InputError, match="holds results of lcbayes fit; choose another"),
        results_folder(tmp_path / "a", "spin"),
    ):
        pass
    with results_folder(tmp_path / "b", "compare") as folder:
        folder.checkpoint(IDENTITY, lambda _: None).save("a", {"z": np.zeros(1)})
    with (
        pytest.raises(InputError, match="holds results of lcbayes compare"),
        results_folder(tmp_path / "b", "fit"),
    ):
        pass


def test_toml_comes_back(tmp_path):
    from lcbayes.core.toml import read_toml

    content = {
        "curve": 'a "quoted" \\ näme\n.csv',
        "n": 3,
        "yes": True,
        "x": 1e-300,
        "inf": float("inf"),
        "array": np.float64(0.1),
        "count": np.int64(7),
        "options": {"period": 5.76198, "law": "lambertian", "no": False},
        "empty": {},
    }
    (tmp_path / "run.toml").write_text(to_toml(content))
    result = read_toml(tmp_path / "run.toml").values
    assert result == content
    assert result["yes"] is True


def test_digests_tell_light_curves_apart():
    """By everything that decides numbers: a run must not go on from that of another curve."""
    n, t = 4, np.arange(4.0)
    axis = np.eye(3)[np.zeros(n, int)]
    curve = LightCurve(
        t=t,
        brightness=np.ones(n),
        error=np.full(n, 0.1),
        sun=axis,
        obs=axis,
        band=np.array(["V", "R", "V", "R"]),
        site=np.array(["a", "bc", "a", "bc"]),
        range_km=np.full(n, 700.0),
    )
    others = [
        replace(curve, kind="mag"),
        replace(curve, frame="icrs"),  # where laws find north
        replace(curve, site=np.array(["ab", "c", "ab", "c"])),
    ]
    assert len({digest(c) for c in (curve, *others)}) == 1 + len(others)
    assert digest(curve) == digest(replace(curve, source={"file": "other.csv"}))
