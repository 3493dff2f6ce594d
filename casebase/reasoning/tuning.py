"""What a diagnosis is tuned by, in one place."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Tuning:
    """Numbers of a diagnosis that experience gave, not physics.

    Args:
        present: a second fault is listed from there on: it is then more probable than not.
        prior_freedom: how alike the scatters of one kind of features are: as if each were known from so many
            gearboxes (Smyth's estimate from normal recordings of ten gearboxes: 2.5 to 3.3 on four draws of the
            field bank, 1.9 on shared recordings).
        level: a recording of a known label, of a gearbox that the library has not seen, gets a smaller p-value
            so seldom.
        recorder_scatter_db: levels of two recordings differ by so much where the microphone was put up again [dB].
        nearly_all: where so large a share of the cases follow a motion, what does not is of none of them.
        strength: inverse strength of the prior on the coefficients. One that the likelihood of gearboxes left out chose
            gave more answers, of which three in four were right.
        mostly: where at least this share of the cases follow a motion, features of a motion count.
        usual_slope: of the score: a regression drawn to a prior is less sure than it could be (1.0 to 4.5 on seven
            libraries).
    """

    present: float = 0.5
    prior_freedom: float = 3.0
    level: float = 0.02
    recorder_scatter_db: float = 1.0
    nearly_all: float = 0.95
    strength: float = 0.3
    mostly: float = 0.5
    usual_slope: float = 2.7


TUNING = Tuning()
