"""Loss in a mesh that grows with the torque it carries."""

from sim.chain.model import with_loss
from sim.errors import CompositionError
from sim.mechanisms.locations import stage_names
from sim.mechanisms.mechanism import Law, Mechanics, Parameter, Signature, Traits
from sim.rotational.components import IdealGear, LossyGear
from sim.rotational.drive_train import DriveTrain


class LoadDependentLoss(Mechanics):
    """A fraction of the torque in the mesh acts against the motion, on top of the efficiency that is described.

    Equations: tau_a = tau_load (1 + fraction) when the driver drives, tau_load (1 - fraction) else
    Source: LossyGear of the Modelica Standard Library 4.1 with eta = 1 / (1 + f), 1 - f
    """

    name = "load_dependent_loss"
    parameters = (Parameter("fraction", "1", 0.0, 0.5, 0.05),)
    size = "fraction"
    locations = stage_names
    signature = Signature("torque", direction="opposite")
    sentence = "The {where} gear pair loses {fraction:.1%} of the torque it transmits."
    action = (
        "Check lubrication and contact pattern of the {where} gear pair, and enter its efficiency in the axis "
        "description. Do it at the next service."
    )
    check = "Repeat the motion without payload: a loss of the teeth shrinks with the torque, friction stays."
    traits = Traits(
        own_hypothesis=True,
        laws=frozenset({Law.FRICTION, Law.DISSIPATION}),
        damping=0.1,
        over_strokes=True,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        name, fraction = f"{place}_gear", self["fraction"]
        gear = train[name]
        if isinstance(gear, IdealGear):
            return train.replace(name, LossyGear(gear.ratio, [0, *with_loss((1.0, 1.0), fraction), 0, 0]))
        if not isinstance(gear, LossyGear):
            raise CompositionError(f"{name}: must be a gear to have a loss")
        rows = [[w, *with_loss((eta1, eta2), fraction), *bf] for w, eta1, eta2, *bf in gear.table.rows]
        return train.replace(name, LossyGear(gear.ratio, rows))
