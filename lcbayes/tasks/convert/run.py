"""`lcbayes convert`."""

from __future__ import annotations

from pathlib import Path

from lcbayes.core.errors import EXIT_DONE, InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.write import write
from lcbayes.tasks.convert.options import ConvertOptions


def command(curve: LightCurve, options: ConvertOptions) -> int:
    """Write the light curve, and print what was read and what was omitted."""
    if options.output.resolve() == Path(curve.source["file"]).resolve():
        raise InputError(f"OUT is the input, {options.output}; give another name")
    write(curve, options.output)
    print(f"{options.output}: {curve!r}")
    for note in filter(None, curve.source.get("notes", "").split("; ")):
        print(f"note: {note}")
    return EXIT_DONE
