"""Version of the installed package."""

from importlib.metadata import PackageNotFoundError, version


def installed_version() -> str:
    """The installed version of lcbayes."""
    try:
        return version("lcbayes")
    except PackageNotFoundError:  # an uninstalled checkout
        return "0+checkout"
