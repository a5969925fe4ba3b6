"""What `lcbayes models` prints."""

from __future__ import annotations

from lcbayes.cli.main import main
from lcbayes.core.errors import EXIT_DONE
from lcbayes.modelling import registry


def printed(capsys, *flags: str) -> list[str]:
    assert main(["models", *flags]) == EXIT_DONE
    return capsys.readouterr().out.splitlines()


def test_every_model_is_listed_with_its_summary(capsys):
    lines = printed(capsys)
    assert [line.split()[0] for line in lines] == list(registry.BUILT_IN)
    assert all(line.endswith(registry.find(line.split()[0]).summary) for line in lines)


def test_a_model_is_described_with_its_options_and_bodies(capsys):
    lines = printed(capsys, "body")
    options = lines[lines.index("options:") + 1 : lines.index("bundled bodies:") - 1]
    assert [line.split()[0] for line in options] == list(registry.find("body").options)
    assert "must be given" in options[0]  # the body
    assert any(line.split()[:1] == ["rocket-stage"] for line in lines)


def test_the_requirements_of_a_model_file(capsys):
    assert "\n".join(printed(capsys, "--contract")).strip() == (registry.__doc__ or "").strip()
