"""Damaged files of every kind are read or refused in one line, never otherwise."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tests.helpers import file_readers

PIECES = [
    b"\n",
    b",",
    b";",
    b'"',
    b"-",
    b"e999",
    b"nan",
    b"inf",
    b"#",
    b" ",
    b"\xff",
    b"\x00",
    b"\r",
    b"\xef\xbb\xbf",
    b"=",
    b"[",
    b"[[",
    b"]",
    b"{",
    b"}",
    b"'",
    b"'''",
    b"0",
    b"9" * 40,
    b"1e308",
    b"\xc3\xa9",
    b"true",
    b"2024-02-30T25:61:00Z",
    b"%",
    b"../",
    b"/",
    b"\\",
    b"-0",
    b"1_0",
    b"&a ",
    b"*a",
    b"<<: ",
    b"\\u0000",
    b"1" * 400,
    b"0x" + b"f" * 5000,
    b"x" * 2000,
]


@st.composite
def damaged(draw, name: str) -> bytes:
    """A sound text with pieces put in, cut out, doubled or changed."""
    text = bytearray(draw(st.sampled_from(file_readers.READERS[name].texts)).encode())
    for _ in range(draw(st.integers(1, 5))):
        at = draw(st.integers(0, len(text)))
        kind = draw(st.integers(0, 3))
        if kind == 0:
            text[at:at] = draw(st.sampled_from(PIECES))
        elif kind == 1:
            del text[at : at + draw(st.integers(1, 60))]
        elif kind == 2:
            text[at:at] = text[max(0, at - draw(st.integers(1, 60))) : at]
        else:
            text[at : at + 1] = draw(st.binary(max_size=2))
    return bytes(text)


@pytest.mark.parametrize("name", file_readers.READERS)
def test_sound_texts_are_read(name, tmp_path):
    for text in file_readers.READERS[name].texts:
        assert file_readers.give(name, text.encode(), tmp_path), text


@pytest.mark.parametrize("name", file_readers.READERS)
def test_damaged_texts_are_read_or_refused(name, tmp_path):
    @settings(
        max_examples=40,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(damaged(name))
    @example(b"")
    @example(b"\x00" * 50)
    @example(b"\xa0")  # a space of Latin-1, and a file of nothing else is empty
    @example(file_readers.TLE.encode().replace(b"2927", b"\xb2927"))  # a digit, but no number
    @example(b"#a\n# - {name: a1")
    @example(b"a = " + b"[" * 5000)
    @example(b"a = " + b"1" * 5000)
    @example(file_readers.ECSV.replace("# meta: {frame: icrs}", "# meta: hello").encode())
    @example(file_readers.ECSV.replace("# ---", "# ---\n# delimiter: 5").encode())
    @example(file_readers.ECSV.replace("# ---", "# ---\n# a: &a [*a]").encode())
    @example(file_readers.BATCH.replace("x.tle", "x" * 140_000).encode())
    @example(file_readers.OBJ.replace("1 0 0", "1e200 0 0").encode())
    def try_one(content: bytes) -> None:
        file_readers.give(name, content, tmp_path)

    try_one()
