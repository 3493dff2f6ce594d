"""A bank of test recordings by strangers: simulated robot axes that share nothing with the product.

Use it as the judge of a diagnosis by sound::

    from tests.stranger_bank import gearboxes, library, questions, record, use_folder

    use_folder("/somewhere/bank")             # where `python -m tests.stranger_bank` wrote it
    cases = library("work", "rv", 6)          # 6 gearboxes x (3 normal, 3 notch, 3 play)
    for asked in questions("work"):           # named sets on held-out gearboxes
        for rec in asked:                     # Recorded: samples, rate_hz and the truth
            ...                               # asked.library_axis: the library to ask

    box = gearboxes("work")[7]
    rec = record(box, "play+notch", "s_curve", seed=3, snr_db=5.0, size=1e-3)

Everything follows from the arguments: the same call gives the same samples. `library` and the sets
of `questions` read recordings from the folder and make those that are missing. The folder is that
of `use_folder`, else $STRANGER_BANK, else stranger_bank in the temporary folder.

Halves: "work" is to develop against, "final" to judge with, once. They have no gearbox in common
and differ in structure: axis designs, spread of parameters, contact law, friction, servo, motion
profiles, form of the tooth damage, housing model and surrounding noise. "final" also has one axis
type ("worm") more, and its strain wave gears have their play in the input stage.

Axis types: rv (two-stage cycloidal, heavy), harmonic (strain wave, small), planetary (two stages),
belt (belt, bevel, helical), worm (final only). Motions: see `MOTIONS`. Sets of questions:
known/AXIS/MOTION, unseen/AXIS/FAULT, two/AXIS/FAULTS, noise/AXIS/LEVEL, cross/AXIS/on_OTHER.

Seeds and twins: recordings of one gearbox, motion and seed share motion, payload, start,
microphone and noise whatever their state, so `record(box, "normal", m, seed=s)` is the healthy twin
of `record(box, "play", m, seed=s)`. The sets use different seeds for different states.

Audibility (see `Recorded`): faults below about -20 dB both in the full band and in
`audibility_low_db`, with `audibility_peak_db` below about 3 dB, cannot be expected to be heard.
Faults that only shift the phase of steady tones can have a large difference and yet sound alike.

Units: rad, rad/s, s, kg m2 and N m at the output flange; Hz; dB of energy.
"""

from .axes import DESIGNS, IN_HOUSE, gearboxes
from .bank import QuestionSet, Spec, all_specs, cached, library, questions, record, use_folder
from .kinds import KNOWN_STATES, MOTIONS, TWO_AT_ONCE, UNSEEN_FAULTS, Gearbox, Half, Recorded

__all__ = [
    "DESIGNS",
    "IN_HOUSE",
    "KNOWN_STATES",
    "MOTIONS",
    "TWO_AT_ONCE",
    "UNSEEN_FAULTS",
    "Gearbox",
    "Half",
    "QuestionSet",
    "Recorded",
    "Spec",
    "all_specs",
    "cached",
    "gearboxes",
    "library",
    "questions",
    "record",
    "use_folder",
]
