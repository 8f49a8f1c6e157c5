"""What a file of arrays contains: arrays, sampling rates that it states, and what cannot be read."""

import re
from dataclasses import dataclass, field
from pathlib import Path

from texclass.loaders.columns import listed, refused

_RATES = (
    *("fs", "sr", "srate"),
    *(f"sampl{end}{kind}" for end in ("e", "ing") for kind in ("rate", "frequency", "freq")),
)
"""Names of a scalar with the sampling rate in Hz, see `is_rate`."""


@dataclass
class Contents:
    """What a file contains.

    Attributes
    ----------
    mark
        Character between the name of a group (or struct) and that of its member.
    sizes
        Array of real numbers -> number of its values.
    rates
        Scalar or attribute with a sampling rate -> its value in Hz.
    others
        Anything else -> its class.
    """

    mark: str = "/"
    sizes: dict[str, int] = field(default_factory=dict)
    rates: dict[str, float] = field(default_factory=dict)
    others: dict[str, str] = field(default_factory=dict)

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the arrays; single values only where there is nothing else."""
        arrays = tuple(name for name, size in self.sizes.items() if size > 1)
        return arrays or tuple(name for name in self.sizes if name not in self.rates)

    @property
    def unread(self) -> str:
        """Names and classes of what cannot be read."""
        return listed([f"{name} ({kind})" for name, kind in self.others.items()])

    def rate_of(self, wanted: tuple[str, ...], path: Path, given: float | None) -> tuple[float | None, str]:
        """Return the sampling rate of some arrays in Hz, and the name of the scalar that states it.

        A scalar states the rate of the arrays in its group, or in the next group above that has any.

        Parameters
        ----------
        wanted
            Names of the arrays.
        path
            Path of the file, for messages.
        given
            Sampling rate in Hz that selects one of several.

        Raises
        ------
        RecordingError
            If the file states several rates of these arrays, and none is the given one.
        """
        scopes = {name: self._scope(name) for name in self.rates}
        stated: dict[str, float] = {}
        for signal in wanted:
            above = [scope for scope in scopes.values() if self._is_in(signal, scope)]
            nearest = max(above, key=len, default=None)
            stated |= {name: self.rates[name] for name, scope in scopes.items() if scope == nearest}
        if len(set(stated.values())) > 1 and given not in stated.values():
            shown = ", ".join(f"{name} = {rate:g}" for name, rate in stated.items())
            raise refused(
                path, f"it states several sampling rates: {shown}", "one rate, or --fs to select one"
            )
        name = next((name for name, rate in stated.items() if rate == given), next(iter(stated), ""))
        return stated.get(name), name

    def _scope(self, rate: str) -> str:
        scope = rate.rpartition(self.mark)[0]
        while scope and not any(self._is_in(signal, scope) for signal in self.signals):
            scope = scope.rpartition(self.mark)[0]
        return scope

    def _is_in(self, signal: str, scope: str) -> bool:
        return not scope or f"{signal}{self.mark}".startswith(f"{scope}{self.mark}")


def is_rate(name: str) -> bool:
    """Whether a name is that of a sampling rate in Hz: "Fs", "data.sampling_rate", "SampleRate (Hz)"."""
    plain = re.sub(r"[\s_()\[\]-]", "", re.split(r"[./]", name)[-1].lower())
    return plain.removesuffix("hz") in _RATES
