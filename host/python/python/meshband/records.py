"""Records: measured or simulated runs as arrays, and everything that is found in them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _meshband
from .machines import Machine, numbers
from .results import Result

if TYPE_CHECKING:
    import pandas
    from numpy.typing import ArrayLike, NDArray


class Record:
    """Runs with their channels, tach edges and declaration; ``len(record)`` is the number of runs."""

    def __init__(self, native: Any, summary: Result | None = None):
        self._native = native
        #: What the import said of the files, of a record that :func:`import_files` made; else None.
        self.summary = summary

    @classmethod
    def read(cls, folder: str | Path) -> Record:
        """Reads a record folder."""
        return cls(_meshband.Record.read(Path(folder)))

    @classmethod
    def from_arrays(
        cls,
        samples: ArrayLike,
        rate_hz: float,
        *,
        edges_s: ArrayLike | None = None,
        pulses_per_turn: int = 1,
        tach_shaft: str = "pinion",
        teeth: tuple[int, int] | None = None,
        channels: Sequence[str] | None = None,
        title: str = "arrays",
        torque_n_m: float | None = None,
        unit: str | None = None,
    ) -> Record:
        """One run from samples (samples, or samples x channels; m/s2 unless ``unit`` says otherwise) and tach edges in s."""
        values = np.ascontiguousarray(np.atleast_2d(np.asarray(samples, dtype=np.float64).T).T)
        names = list(channels) if channels is not None else [f"channel {c}" for c in range(values.shape[1])]
        tach = None
        if edges_s is not None:
            tach = (tach_shaft, pulses_per_turn, np.ascontiguousarray(edges_s, dtype=np.float64))
        return cls(_meshband.Record.from_arrays(values, float(rate_hz), names, title, teeth, tach, torque_n_m, unit))

    def write(self, folder: str | Path, force: bool = False) -> Record:
        """Writes the record as a folder (with ``force`` over a former record) and gives the record read from there."""
        self._native.write(Path(folder), force)
        return Record.read(folder)

    @property
    def folder(self) -> Path:
        """Folder it was read from, or that its machine's tables lie in."""
        return Path(self._native.folder)

    @property
    def title(self) -> str:
        """Title of the declaration."""
        return self._native.title

    @property
    def teeth(self) -> tuple[int, int] | None:
        """Tooth counts of pinion and gear, where declared."""
        return self._native.teeth

    @property
    def channels(self) -> list[str]:
        """Names of the channels."""
        return self._native.channels

    @property
    def unit(self) -> str:
        """Unit of the samples."""
        return self._native.unit

    @property
    def sample_rate_hz(self) -> float:
        """Sampling rate, Hz."""
        return self._native.sample_rate_hz

    @property
    def pulses_per_turn(self) -> int | None:
        """Tach pulses per turn of the tach's shaft, where there is a tach."""
        return self._native.pulses_per_turn

    def __len__(self) -> int:
        return len(self._native)

    def to_toml(self) -> str:
        """The declaration as text."""
        return self._native.to_toml()

    def signals(self, run: int = 0) -> NDArray[np.float64]:
        """Samples of a run, samples x channels, in :attr:`unit`."""
        return self._native.signals(run)

    def signal(self, run: int = 0, channel: int = 0) -> NDArray[np.float64]:
        """Samples of one channel of a run."""
        return np.ascontiguousarray(self.signals(run)[:, channel])

    def codes(self, run: int = 0) -> NDArray[np.int16]:
        """Codes of a run, samples x channels."""
        return self._native.codes(run)

    def time_s(self, run: int = 0) -> NDArray[np.float64]:
        """Times of the samples of a run, s."""
        return np.arange(len(self.signals(run))) / self.sample_rate_hz

    def edges_s(self, run: int = 0) -> NDArray[np.float64]:
        """Tach edges of a run, s from its first sample."""
        return self._native.edges_s(run)

    def torque_n_m(self, run: int = 0) -> float | None:
        """Declared torque of a run, N m."""
        return self._native.torque_n_m(run)

    def speed_hz(self, run: int = 0) -> float:
        """Mean speed of the pinion over a run, Hz."""
        return self._native.speed_hz(run)

    def frame(self, run: int = 0) -> pandas.DataFrame:
        """A run as a pandas frame: index ``time, s``, one column per channel, units in ``frame.attrs``."""
        import pandas

        index = pandas.Index(self.time_s(run), name="time, s")
        frame = pandas.DataFrame(self.signals(run), index=index, columns=self.channels)
        frame.attrs.update(unit=self.unit, sample_rate_hz=self.sample_rate_hz, title=self.title)
        return frame

    def check(self) -> Result:
        """What is wrong with a record that declares its machine."""
        return Result(_meshband.check(self._native))

    def analyse(self, run: int | None = None, channel: int | None = None) -> Result:
        """Order spectrum and map, sidebands, averages, envelope and the orders that the mesh does not explain."""
        return Result(_meshband.analyse(self._native, run, channel))

    def loop(self, *, seed: int = 1, level: str | None = None, report: bool = True) -> Result:
        """The closed loop: what the declared machine lacks, or (signal-based inference) which families of lines the mesh leaves."""
        return Result(_meshband.close_loop(self._native, seed, level, report))

    def predict(
        self,
        machine: Machine | None = None,
        *,
        effects: Iterable[str] = (),
        model: str = "bending-torsional",
    ) -> list[NDArray[np.float64]]:
        """What the declared (or another) machine gives for each run: samples x 2 in m/s2, one array per run."""
        native = machine._native if machine else None
        return [np.column_stack(run) for run in _meshband.predict(self._native, native, list(effects), model)]

    def __repr__(self) -> str:
        return f"<Record {self.title}: {len(self)} runs, {', '.join(self.channels)}; {self.sample_rate_hz:g} Hz>"


def import_files(
    files: str | Path | Iterable[str | Path],
    *,
    machine: Machine | None = None,
    teeth: tuple[int, int] | None = None,
    rate_hz: float | None = None,
    override_rate: bool = False,
    mesh_hz: float | None = None,
    mesh_range_hz: tuple[float, float] | None = None,
    unit: str | None = None,
    override_unit: bool = False,
    volt_per_g: float | None = None,
    columns: Sequence[str] = (),
    skip: Sequence[str] = (),
    channel_names: Sequence[str] | None = None,
    full_scale: float | None = None,
    source_full_scale: float | Iterable[float] | None = None,
    keep_float: bool = False,
    torque_n_m: float | Iterable[float] | None = None,
    files_are_runs: bool = False,
    tach: str | Sequence[str] | None = None,
    no_tach: bool = False,
    pulses_per_turn: int = 1,
    tach_shaft: str = "pinion",
    remove_mean: bool = False,
    title: str = "import",
) -> Record:
    """Measurement files (MATLAB, HDF5, TDMS, csv, wav, FLAC, npy, uff58) as a record in memory.

    ``unit`` is for files that state none. ``tach`` names the tachometer's channel or file; without it a virtual one comes from the mesh
    line (needs ``teeth``), or none with ``no_tach``. The keywords are those of ``meshband import``, whose help says more.
    """
    paths = [files] if isinstance(files, (str, Path)) else list(files)
    choices = {
        "title": title,
        "rate_hz": rate_hz,
        "override_rate": override_rate,
        "teeth": teeth,
        "mesh_hz": mesh_hz,
        "mesh_range_hz": mesh_range_hz,
        "unit": unit,
        "override_unit": override_unit,
        "volt_per_g": volt_per_g,
        "columns": list(columns),
        "skip": list(skip),
        "channel_names": None if channel_names is None else list(channel_names),
        "full_scale": full_scale,
        "source_full_scale": numbers(source_full_scale),
        "keep_float": keep_float,
        "torques_n_m": numbers(torque_n_m),
        "files_are_runs": files_are_runs,
        "tach": [] if tach is None else [tach] if isinstance(tach, str) else list(tach),
        "no_tach": no_tach,
        "pulses": pulses_per_turn,
        "tach_shaft": tach_shaft,
        "remove_mean": remove_mean,
    }
    native = machine._native if machine else None
    record, outcome = _meshband.import_files([Path(path) for path in paths], native, choices)
    return Record(record, Result(outcome))
