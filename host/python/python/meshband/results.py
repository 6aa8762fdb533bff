"""What a command found, for programs and for notebooks."""

from __future__ import annotations

import html as _html
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any


class Result(Mapping):
    """The JSON of a command as a mapping, with its text and its report.

    ``result["key"]`` reads the JSON; ``print(result)`` shows what the command shows; in a notebook the report appears.
    """

    def __init__(self, outcome: Any):
        self._json: str = outcome.json
        self._data: dict[str, Any] = json.loads(outcome.json)
        #: What the command shows in a terminal.
        self.text: str = outcome.text
        #: The report: one self-contained HTML page, empty where none was made.
        self.html: str = outcome.html

    def __getitem__(self, key: str) -> Any:
        return self._data[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._data)

    def __len__(self) -> int:
        return len(self._data)

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"<{type(self).__name__} with {', '.join(self._data)}>"

    def _repr_html_(self) -> str:
        if not self.html:
            return f"<pre>{_html.escape(self.text)}</pre>"
        # A frame of its own: the page's style does not touch the notebook's.
        page = _html.escape(self.html, quote=True)
        return f'<iframe style="width:100%;height:42rem;border:1px solid #d5dae0" srcdoc="{page}"></iframe>'

    def to_dict(self) -> dict[str, Any]:
        """A copy of the JSON."""
        return json.loads(self._json)

    def to_json(self) -> str:
        """The JSON as the command writes it."""
        return self._json

    def save_json(self, path: str | Path) -> None:
        """Writes the JSON as the command's ``--json`` does; an existing file is replaced."""
        Path(path).write_text(self._json, encoding="utf-8")

    def save_html(self, path: str | Path) -> None:
        """Writes the report as the command's ``--report`` does; an existing file is replaced."""
        if not self.html:
            raise ValueError("no report was made of this result")
        Path(path).write_text(self.html, encoding="utf-8")
