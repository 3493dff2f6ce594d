"""Gearboxes whose fault grows from recording to recording: when is it told, and how often is a good one suspected?

The sounds are those of `benchmarks/field_bank`, which shares no code with the product.
"""
