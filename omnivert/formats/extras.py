"""Libraries that are installed only by who needs them."""

from importlib import import_module

from omnivert.errors import DataError


def hold_installed(package: str, extra: str, what: str) -> None:
    """raises DataError when the package is not there; `extra` of omnivert brings it, `what` cannot be done without"""
    try:
        import_module(package)
    except ImportError as error:
        because = f"the library {error.name or package} is not installed"
        raise DataError("OV330", f"{what} needs {package}", because, f"pip install 'omnivert[{extra}]'") from error
