"""The uncertainty sources: the causes that a game of coalitions shares the uncertainty out among.

How each acts on a pair of scans is in perturbation.py; what a further source takes is in
docs/extending.md.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class UncertaintySource:
    """A cause of uncertainty, a player of the game; `off` is its reference value (Algorithm 1)."""

    name: str
    title: str
    symbol: str
    unit: str
    off: float

    @property
    def label(self):
        """Title, symbol and unit, as an axis shows them."""
        return f"{self.title} {self.symbol}" + (f" [{self.unit}]" if self.unit else "")


SOURCES = (
    UncertaintySource("sensor_noise", "sensor noise", "σ", "m", off=0.0),
    UncertaintySource("initial_pose", "initial pose scale", "s", "", off=1.0),
    UncertaintySource("partial_overlap", "partial overlap", "λ", "", off=0.0),
)
NAMES = tuple(source.name for source in SOURCES)
