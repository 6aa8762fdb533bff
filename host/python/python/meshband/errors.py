"""Exceptions of the package: each carries the one line that the command would show."""


class Error(Exception):
    """Base of everything the workbench refuses."""


class InvalidInput(Error, ValueError):
    """A file, argument or value was read but makes no sense; the line says where and what."""


class FileError(Error, OSError):
    """A file could not be read or written."""


class Impossible(Error, ArithmeticError):
    """The input is sound, but the computation is impossible for it."""


class ToolError(Error, RuntimeError):
    """A tool that is needed is absent or failed."""
