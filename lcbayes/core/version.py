"""Version of the installed package."""

from functools import cache
from importlib.metadata import PackageNotFoundError, version


@cache
def installed_version() -> str:
    """The installed version of lcbayes."""
    try:
        return version("lcbayes")
    except PackageNotFoundError:  # an uninstalled checkout
        return "0+checkout"
