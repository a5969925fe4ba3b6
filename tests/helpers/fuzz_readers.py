"""Coverage-guided fuzzing of every reader: `python -m tests.helpers.fuzz_readers`.

Needs atheris (the extra ``fuzz``). Texts that reach new code are kept and changed further. What a
reader does neither read nor refuse in one line is counted by its kind, and the first text of each
kind is written to `fuzz-faults/`; it belongs into `tests/unit/data/test_damaged_files.py` with its
mending.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from pathlib import Path

import atheris  # pyright: ignore[reportMissingImports]

with atheris.instrument_imports(include=["lcbayes"]):  # pyright: ignore[reportAttributeAccessIssue]
    from tests.helpers import file_readers

NAMES = tuple(file_readers.READERS)
SECONDS = 10.0  # for one text: no hang


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    with file_readers.scratch() as made:
        fuzz(Path(made), args.minutes, args.seed)


def fuzz(folder: Path, minutes: float, seed: int) -> None:
    corpus, faults = folder / "corpus", Path("fuzz-faults")
    corpus.mkdir()
    for i, name in enumerate(NAMES):
        for j, text in enumerate(file_readers.READERS[name].texts):
            (corpus / f"{i}-{j}").write_bytes(bytes([i]) + text.encode())
            file_readers.give(name, text.encode(), folder)  # loads what is loaded lazily
    before = memory()
    begun = time.monotonic()
    counts: dict[str, float] = {"texts": 0, "read": 0, "slowest_s": 0.0}
    kinds: dict[str, int] = {}

    def one(content: bytes) -> None:
        if not content:
            return
        start = time.monotonic()
        try:
            counts["read"] += file_readers.give(NAMES[content[0] % len(NAMES)], content[1:], folder)
        except file_readers.Fault as fault:
            kind = f"{NAMES[content[0] % len(NAMES)]}-{type(fault.__cause__).__name__}"
            kinds[kind] = kinds.get(kind, 0) + 1
            if kinds[kind] == 1:
                faults.mkdir(exist_ok=True)
                (faults / kind).write_bytes(content)
                print(f"{kind}: {fault}", flush=True)
        took = time.monotonic() - start
        counts["texts"] += 1
        if took > counts["slowest_s"]:
            counts["slowest_s"] = took
            if took > SECONDS:
                print(f"slow, {took:.0f} s: {content!r}", flush=True)
        if counts["texts"] % 2000 == 0:
            print(
                f"{time.monotonic() - begun:.0f} s: {counts}, faults {kinds}, "
                f"memory + {memory() - before:.0f} MiB",
                flush=True,
            )

    options = [f"-max_total_time={60 * minutes:.0f}", f"-seed={seed}", "-max_len=4096"]
    atheris.Setup([sys.argv[0], str(corpus), *options, "-rss_limit_mb=4096"], one)
    atheris.Fuzz()


def memory() -> float:
    """The most that this process has held, MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
