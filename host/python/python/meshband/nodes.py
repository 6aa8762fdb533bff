"""The node's own chain: the code that the firmware runs, fed with arrays."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from . import _meshband
from .machines import Law

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from .records import Record


class Message(NamedTuple):
    """A message of a node: its kind ("Status", "Spectrum", ...) and its fields."""

    kind: str
    fields: Any


def _messages(text: str) -> list[Message]:
    def one(value: Any) -> Message:
        return Message(value, None) if isinstance(value, str) else Message(*next(iter(value.items())))

    return [one(value) for value in json.loads(text)]


class Replay(list):
    """What a node said of a run: a list of messages, and the bytes of its link."""

    def __init__(self, messages: Iterable[Message], link: bytes):
        super().__init__(messages)
        #: Every byte that was sent; ``meshband monitor --replay`` reads them from a file.
        self.link = link

    def of(self, kind: str) -> list[Any]:
        """Fields of all messages of one kind, oldest first."""
        return [message.fields for message in self if message.kind == kind]

    def last(self, kind: str) -> Any:
        """Fields of the newest message of a kind; None where none came."""
        fields = self.of(kind)
        return fields[-1] if fields else None

    def __repr__(self) -> str:
        kinds: dict[str, int] = {}
        for message in self:
            kinds[message.kind] = kinds.get(message.kind, 0) + 1
        return "<Replay: " + ", ".join(f"{count} {kind}" for kind, count in kinds.items()) + ">"


def replay(
    record: Record,
    run: int = 0,
    channel: int | str = 0,
    *,
    start_s: float = 0.0,
    duration_s: float | None = None,
    law: Law | None = None,
    rate_hz: float | None = None,
) -> Replay:
    """Runs the node's own code on a channel of a record, as a board with one sensor does that is never late.

    The converter is simulated: the node asks for its rate, as on a board. ``rate_hz`` forces a rate without decimation.
    """
    native = law._native if law else None
    link, text = _meshband.replay(record._native, run, str(channel), start_s, duration_s, native, rate_hz)
    return Replay(_messages(text), link)


class Node:
    """A node on the host that is fed block by block with samples and tach edges; it gives back what it sends.

    One time base serves samples and edges (``ticks_per_second``). The node asks for a sample period
    (:attr:`requested_period_ticks`); a block may have any period, and a change of it is what a change of rate is on a board.
    """

    #: Most samples of a block.
    BLOCK_SAMPLES: int = _meshband.Node.BLOCK_SAMPLES

    def __init__(
        self,
        teeth: tuple[int, int],
        *,
        pulses_per_turn: int = 1,
        pinion_per_tach: float = 1.0,
        full_scale_m_s2: float = 100.0,
        ticks_per_second: int = 25_000_000,
        law: Law | None = None,
    ):
        #: Time base, Hz.
        self.ticks_per_second = ticks_per_second
        #: Acceleration of the largest code, m/s2.
        self.full_scale_m_s2 = full_scale_m_s2
        self._sequence = 0
        self._native = _meshband.Node(
            teeth, pulses_per_turn, pinion_per_tach, full_scale_m_s2 / 32767.0, ticks_per_second, law._native if law else None
        )

    @property
    def requested_period_ticks(self) -> int:
        """Sample period that the node asks for, ticks."""
        return self._native.requested_period_ticks

    @property
    def state(self) -> str:
        """"WaitingForTach", "Settling", "Measuring" or "Stopped"."""
        return self._native.state

    def feed(self, samples: ArrayLike, first_tick: int, period_ticks: int, edge_ticks: ArrayLike = ()) -> list[Message]:
        """A block of samples in m/s2 whose first was taken at ``first_tick``, after the edges up to its end."""
        codes = np.rint(np.asarray(samples, dtype=np.float64) / self.full_scale_m_s2 * 32767.0)
        codes = (np.clip(codes, -32767, 32767) + 0x8000).astype(np.uint16)
        edges = (np.asarray(edge_ticks, dtype=np.int64) & 0xFFFF_FFFF).astype(np.uint32)
        sent = self._native.feed(
            np.ascontiguousarray(codes), first_tick & 0xFFFF_FFFF, period_ticks, self._sequence, np.ascontiguousarray(edges)
        )
        self._sequence = (self._sequence + 1) & 0xFFFF_FFFF
        text, _, _ = _meshband.Node.decode(sent)
        return _messages(text)
