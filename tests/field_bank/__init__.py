"""A bank of recordings that asks the product from outside: own machines, own disturbances, foreign sounds.

It shares no code with the product: everything is made with numpy, scipy and soundfile, and the product is only driven
through its command line (`__main__`). Speech comes from espeak-ng where that is installed, else from a formant voice.
"""
