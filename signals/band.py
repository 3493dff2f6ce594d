"""The bands in which events are looked for."""

from enum import Enum


class Band(Enum):
    """Bands in which events are looked for: (low [Hz], high [Hz], width of whitening [Hz])."""

    LOW = (12.0, 200.0, 8.0)
    MIDDLE = (200.0, 1000.0, 100.0)
    HIGH = (1000.0, 3600.0, 100.0)

    @property
    def label(self) -> str:
        """The band as it stands in names of features, for example `12_200_hz`."""
        return f"{self.value[0]:.0f}_{self.value[1]:.0f}_hz"
