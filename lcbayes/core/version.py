"""The version of the package that runs."""

from importlib.metadata import PackageNotFoundError, version


def installed_version() -> str:
    """Of lcbayes."""
    try:
        return version("lcbayes")
    except PackageNotFoundError:  # an uninstalled checkout
        return "0+checkout"
