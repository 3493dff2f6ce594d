"""What is known of labels."""

BASELINES = ("normal", "healthy")
"""Labels of gears without a fault."""
OTHER_WORDS = {"normal": ("good", "healthy", "as new", "ok", "no fault"), "notch": ("chipped",)}
"""What else people call them, in names of files too."""
PARAMETERS = {"play": "gap_rad", "notch": "depth_rad"}
"""What the size of a label is called in the contract."""

GEAR_DAMAGE = {
    "normal_wear": "sliding wear: normal wear",
    "abrasive_wear": "sliding wear: abrasive wear",
    "corrosion": "corrosion",
    "electric_erosion": "electric erosion",
    "scuffing": "scuffing",
    "plastic_deformation": "permanent deformation: plastic deformation",
    "pitting": "surface fatigue: pitting",
    "micropitting": "surface fatigue: micropitting",
    "spalling": "surface fatigue: spalling",
    "tooth_crack": "fissures and cracks: fatigue crack",
    "tooth_breakage": "tooth breakage",
}
"""Labels for damage that is seen on teeth, to the class and name that it has in ISO 10825 (1995; since 2022 part 1)."""
