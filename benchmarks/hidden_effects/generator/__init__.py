"""Generated recordings of robot joints with known hidden effects; shares no code with what is tested on them.

>>> from benchmarks.hidden_effects.generator import draw_recipe, generate, write
>>> scenario = generate(7, draw_recipe(7, effects=("backlash",), level="half"))  # doctest: +SKIP
"""

from benchmarks.hidden_effects.generator.effects import EFFECTS
from benchmarks.hidden_effects.generator.recipe import GROUPS, LEVELS, Recipe, draw_recipe
from benchmarks.hidden_effects.generator.scenario import Hidden, Scenario, generate, write

__all__ = ["EFFECTS", "GROUPS", "LEVELS", "Hidden", "Recipe", "Scenario", "draw_recipe", "generate", "write"]
