"""A bank of recordings that asks the product from outside: own machines, own disturbances, foreign sounds.

It shares no code with the product: everything is made with numpy, scipy and soundfile, and the product is only driven
through its command line. Speech comes from espeak-ng where that is installed, else from a formant voice.

`python -m benchmarks.field_bank --half work` is the half to work with. The half `final` has other gearboxes, other
families of foreign sounds and some kinds of disturbances that `work` does not have; it is run once, at the end.
"""
