"""Gear-vibration workbench on numpy arrays: machines, laws, records, the node's own chain and the closed loop.

Everything the command ``meshband`` does, by the same library calls: same figures, same JSON, same one-line errors.

>>> import meshband
>>> machine = meshband.Machine.read("machines/17-38.toml")
>>> record = machine.simulate(40.0, 10.0, duration_s=1.0)
>>> record.signals().shape
(51200, 2)
"""

from . import errors
from ._meshband import __version__
from .errors import Error, FileError, Impossible, InvalidInput, ToolError
from .machines import Law, Machine
from .nodes import Message, Node, Replay, replay
from .records import Record, import_files
from .results import Result

__all__ = [
    "Error",
    "FileError",
    "Impossible",
    "InvalidInput",
    "Law",
    "Machine",
    "Message",
    "Node",
    "Record",
    "Replay",
    "Result",
    "ToolError",
    "__version__",
    "errors",
    "import_files",
    "replay",
]
