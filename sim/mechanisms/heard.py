"""What is said of a mechanism that sound alone can show."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Heard:
    """`called`: in a list of what was listened for; `then`: what to record next where it is heard; `left_out`: why it
    was weighed and not named; `silent`: the same beside telemetry, along its path."""

    called: str
    then: str
    left_out: str = ""
    silent: str = ""
