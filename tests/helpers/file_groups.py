"""Files of tests that share compiled programs, which one worker then makes once."""

from __future__ import annotations

GROUPS = {
    # one facet without spin, 20 epochs and 16 starts
    "small fits": (
        "tests/contract/test_tasks.py",
        "tests/e2e/test_batch.py",
        "tests/e2e/test_faults.py",
        "tests/e2e/test_fit.py",
        "tests/e2e/test_folders.py",
    ),
    # one and two facets without spin, 16 epochs and 8 starts
    "small comparisons": ("tests/e2e/test_compare.py", "tests/e2e/test_compare_bodies.py"),
}
GROUP_OF = {file: name for name, files in GROUPS.items() for file in files}


def group(file: str) -> str:
    """The group of a file of tests; the file itself if it shares with no other."""
    return GROUP_OF.get(file, file)
