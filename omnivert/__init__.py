"""omnivert: a wheeled robot finds out by itself where its omnidirectional camera sits."""

from importlib.metadata import version

__version__ = version("omnivert")
