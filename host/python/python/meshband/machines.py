"""Machines, their stiffness, natural frequencies and bandwidth laws."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _meshband
from .results import Result

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from .records import Record


def numbers(value: float | Iterable[float] | None) -> list[float]:
    """None, one number or several as a list."""
    return [] if value is None else [float(x) for x in np.atleast_1d(value)]


class Law:
    """A bandwidth law: bandwidth of the vibration over pinion speed, for one machine."""

    def __init__(self, native: Any, fit: Result | None = None):
        self._native = native
        #: The fit with its check at speeds not fitted, of a law that :meth:`Machine.law` made; else None.
        self.fit = fit

    @classmethod
    def read(cls, path: str | Path) -> Law:
        """Reads a law.toml."""
        return cls(_meshband.Law.read(Path(path)))

    @classmethod
    def from_toml(cls, text: str) -> Law:
        """Reads a law from TOML text."""
        return cls(_meshband.Law.from_toml(text))

    def bandwidth_hz(self, speed_hz: ArrayLike) -> NDArray[np.float64] | float:
        """Bandwidth in Hz at pinion speeds in Hz; outside the domain the form goes on without claim."""
        speeds = np.asarray(speed_hz, dtype=np.float64)
        values = self._native.bandwidth_hz(np.ascontiguousarray(speeds.ravel())).reshape(speeds.shape)
        return float(values) if speeds.ndim == 0 else values

    @property
    def machine(self) -> str:
        """Title of the machine."""
        return self._native.machine

    @property
    def domain_hz(self) -> tuple[float, float]:
        """Slowest and fastest pinion speed of the fit, Hz."""
        return self._native.domain_hz

    @property
    def relative_uncertainty(self) -> float:
        """Relative standard uncertainty inside the domain."""
        return self._native.relative_uncertainty

    def to_toml(self) -> str:
        """The text of the law.toml that a node takes."""
        return self._native.to_toml()

    def save(self, path: str | Path) -> None:
        """Writes the law.toml; an existing file is replaced."""
        Path(path).write_text(self.to_toml(), encoding="utf-8")

    def __repr__(self) -> str:
        low, high = self.domain_hz
        return f"<Law of {self.machine}, {low:g} to {high:g} Hz, uncertainty {100 * self.relative_uncertainty:.2g} %>"

    def _repr_html_(self) -> str:
        return self.fit._repr_html_() if self.fit else f"<pre>{self.to_toml()}</pre>"


class Machine:
    """A gear pair with its shafts, as declared; SI units."""

    def __init__(self, native: Any):
        self._native = native

    @classmethod
    def read(cls, path: str | Path) -> Machine:
        """Reads a machine file, or the machine of a record folder."""
        return cls(_meshband.Machine.read(Path(path)))

    @classmethod
    def from_toml(cls, text: str, folder: str | Path = ".") -> Machine:
        """Reads a machine from TOML text; tables it names are looked up in ``folder``."""
        return cls(_meshband.Machine.from_toml(text, Path(folder)))

    @property
    def title(self) -> str:
        """Short name."""
        return self._native.title

    @property
    def teeth(self) -> tuple[int, int]:
        """Tooth counts of pinion and gear."""
        return self._native.teeth

    @property
    def hash(self) -> str:
        """Fingerprint that the machine's laws carry."""
        return self._native.hash

    def to_dict(self) -> dict[str, Any]:
        """The declaration, table by table."""
        return json.loads(self._native.to_json())

    def stiffness(self, points: int = 21) -> Result:
        """Mesh stiffness over the path of contact, its parts, and ISO 6336 beside it."""
        return Result(self._native.stiffness(points))

    def pair_stiffness(self, position: ArrayLike) -> NDArray[np.float64]:
        """Stiffness of one tooth pair, N/m, at positions in base pitches from the start of contact."""
        return self._stiffness_at(position, False)

    def mesh_stiffness(self, position: ArrayLike) -> NDArray[np.float64]:
        """Stiffness of all pairs in contact, N/m, at positions in base pitches; periodic with 1."""
        return self._stiffness_at(position, True)

    def _stiffness_at(self, position: ArrayLike, all_pairs: bool) -> NDArray[np.float64]:
        places = np.asarray(position, dtype=np.float64)
        return self._native.stiffness_at(np.ascontiguousarray(places.ravel()), all_pairs).reshape(places.shape)

    def natural_frequencies_hz(self, model: str = "bending-torsional") -> NDArray[np.float64]:
        """Undamped natural frequencies at the mean mesh stiffness, Hz, ascending."""
        return self._native.natural_frequencies_hz(model)

    def law(self, domain_hz: tuple[float, float] | None = None) -> Law:
        """Fits the bandwidth law over pinion speeds (default: 1 to 25 Hz, reaching beyond the nominal speed)."""
        native, outcome = self._native.law(domain_hz)
        return Law(native, Result(outcome))

    def simulate(
        self,
        speed_hz: float | Iterable[float] | None = None,
        torque_n_m: float | Iterable[float] | None = None,
        *,
        run_up: tuple[float, float, float] | None = None,
        effects: Iterable[str] = (),
        model: str = "bending-torsional",
        rate_hz: float = 51_200.0,
        duration_s: float | None = None,
        pulses_per_turn: int = 1,
        jitter_s: float = 0.0,
        noise_m_s2: float = 0.0,
        seed: int = 1,
    ) -> Record:
        """Simulates one run per pair of speed and torque; the record is in memory until it is written.

        ``run_up`` is (from Hz, to Hz, seconds) and takes the place of ``speed_hz``. Effects are texts as the command takes them,
        ``"eccentricity:side=pinion,amplitude=2e-5"``. Same arguments and seed give the command's samples.
        """
        from .records import Record

        default_s = run_up[2] if run_up else 2.0
        return Record(
            self._native.simulate(
                {
                    "speeds_hz": numbers(speed_hz),
                    "run_up": run_up,
                    "torques_n_m": numbers(torque_n_m),
                    "effects": list(effects),
                    "model": model,
                    "rate_hz": rate_hz,
                    "duration_s": default_s if duration_s is None else duration_s,
                    "pulses_per_turn": pulses_per_turn,
                    "jitter_s": jitter_s,
                    "noise_m_s2": noise_m_s2,
                    "seed": seed,
                }
            )
        )

    def __repr__(self) -> str:
        pinion, gear = self.teeth
        return f"<Machine {self.title}, {pinion}/{gear} teeth>"
