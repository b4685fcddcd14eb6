"""omnivert: a wheeled robot finds out by itself where its omnidirectional camera sits."""


def __getattr__(name: str) -> str:
    """`__version__`, asked of the installation when it is wanted: that takes longer than all else in here."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import version

    return version("omnivert")
