"""Track household objects never seen before in RGB-D, and guide an aerial manipulator to them."""

__version__ = "0.1.0.dev0"
