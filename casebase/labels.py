"""What is known of labels: a leaf that stored documents and reasoning share."""

BASELINES = ("normal", "healthy")
"""Labels of gears without a fault."""
PARAMETERS = {"play": "gap_rad", "notch": "depth_rad"}
"""What the size of a label is called in the contract."""
