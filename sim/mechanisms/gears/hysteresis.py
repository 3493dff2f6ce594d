"""A transmission that gives back less than it took: lost motion without a gap."""

from dataclasses import replace

from sim.description.axis import Axis
from sim.mechanisms.locations import gear_mesh, meshes
from sim.mechanisms.mechanism import SECURED, Discriminating, Law, Mechanics, Need, Parameter, Signature, Traits
from sim.rotational.drive_train import DriveTrain


class Hysteresis(Mechanics):
    """A friction torque beside the spring that builds up over a small twist.

    Equations: F = c x + d x' + z, z' = x' (torque - sign(x') z) / width
    Source: Dahl, AIAA Journal 14 (1976) 1675
    """

    name = "hysteresis"
    parameters = (
        Parameter("torque_n_m", "N m", 0.0, 1e5, 20.0),
        Parameter("width_rad", "rad", 1e-8, 0.1, 1e-4),
    )
    size = "torque_n_m"
    locations = meshes
    shown_by = frozenset({Need.LOAD_ENCODER})
    signature = Signature("twist", direction="opposite")
    sentence = (
        "When the twist of the {where} gear pair turns back, {torque_n_m:.3g} N m are lost: torque over twist is a "
        "loop (hysteresis)."
    )
    action = (
        f"{SECURED} check clamping and fastening of the {{where}} gear (slipping fits, loose screws) and its preload. "
        "Do it at the next stop."
    )
    check = (
        "Block the load, let the motor push slowly to and fro up to its torque limit: hysteresis shows a loop, "
        "hardening a bend, backlash a flat middle."
    )
    discriminated_by = frozenset({Discriminating.BLOCKED})
    traits = Traits(
        behind_the_motor=True,
        of_links=True,
        own_hypothesis=True,
        least_share=0.001,  # it bends to much
        laws=frozenset({Law.SPRING, Law.DISSIPATION}),
        damping=0.4,
    )

    @classmethod
    def looks_like(cls, axis: Axis, location: str | None, load_encoder: bool) -> tuple[str, ...]:
        """Errors of teeth whose number is not known are looked for nowhere, and a loop of the spring bends to them."""
        unknown = any(stage.name == location and stage.driven_teeth is None for stage in axis.stages)
        return ("mesh_error",) if unknown else ()

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        name, mesh = gear_mesh(train, place)
        return train.replace(
            name, replace(mesh, hysteresis=mesh.hysteresis + self["torque_n_m"], hysteresis_width=self["width_rad"])
        )
