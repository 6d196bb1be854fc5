"""Which pairs of a long sequence an experiment takes: every so many scans, so many of them."""

from dataclasses import dataclass

from icpshap.options import option

MOST_SCANS = 1_000_000  # of a sequence
FEWEST_OF_A_DRIVE = 5  # pairs of a sequence, from which on there is a figure along it


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Pairs (i, i + step) of i = start, start + every, ..., as far as there are scans."""

    start: int = option(
        0, "Reference of the first pair; 0 when absent", minimum=0, maximum=MOST_SCANS
    )
    every: int = option(
        1,
        "From the reference of a pair to that of the next; 1 when absent",
        minimum=1,
        maximum=MOST_SCANS,
    )
    step: int = option(
        1,
        "From the reference of a pair to its source; 1 when absent, above it scans are skipped",
        minimum=1,
        maximum=MOST_SCANS,
    )
    count: int | None = option(
        None, "Pairs of a sequence, at most; null or absent: all", minimum=1, maximum=MOST_SCANS
    )

    def pairs(self, scans: int) -> tuple[tuple[int, int], ...]:
        """The pairs (reference, source) of a sequence of so many scans, in order."""
        references = range(self.start, scans - self.step, self.every)[: self.count]
        return tuple((i, i + self.step) for i in references)

    def remark(self, sequence: str, scans: int) -> str:
        """What a sequence of so many scans lacks for what is asked for, in words; "" if nothing."""
        found = len(self.pairs(scans))
        if not found:
            return (
                f"no pair of {sequence}: the first would be scans {self.start} and "
                f"{self.start + self.step}, and data.{sequence}.scans is {scans}"
            )
        if self.count is not None and found < self.count:
            return (
                f"{found} pair{'s' * (found > 1)} of {sequence}, not count: {self.count}: with "
                f"start: {self.start}, every: {self.every} and step: {self.step} its {scans} scans "
                "have no more"
            )
        return ""
