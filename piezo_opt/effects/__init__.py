"""Effects, the models they add up to, and the catalogue of those that come with the package."""

from piezo_opt.effects.base import (
    Chain,
    Effect,
    Equations,
    Parameter,
    Place,
    Signal,
    State,
)
from piezo_opt.effects.catalogue import CATALOGUE, effect, model_from_dict
from piezo_opt.effects.input.amplifier_lag import AmplifierLag
from piezo_opt.effects.input.charge_back_coupling import ChargeBackCoupling
from piezo_opt.effects.input.dead_zone import DeadZone
from piezo_opt.effects.input.delay import Delay
from piezo_opt.effects.input.saturation import Saturation
from piezo_opt.effects.input.slew_limit import SlewLimit
from piezo_opt.effects.loop.asymmetry import Asymmetry
from piezo_opt.effects.loop.rate_dependence import RateDependence
from piezo_opt.effects.model import Model
from piezo_opt.effects.motion.cubic_stiffness import CubicStiffness
from piezo_opt.effects.motion.friction import Friction
from piezo_opt.effects.motion.hysteretic_force import HystereticForce
from piezo_opt.effects.motion.load import Load
from piezo_opt.effects.motion.load_mass import LoadMass
from piezo_opt.effects.motion.nonlinear_damping import NonlinearDamping
from piezo_opt.effects.motion.second_order import SecondOrder
from piezo_opt.effects.motion.spring import Spring
from piezo_opt.effects.output.drift import Drift
from piezo_opt.effects.output.mains_pickup import MainsPickup
from piezo_opt.effects.output.offset import Offset
from piezo_opt.effects.output.second_mode import SecondMode
from piezo_opt.effects.output.sensor_lag import SensorLag
from piezo_opt.effects.output.sensor_nonlinearity import SensorNonlinearity
from piezo_opt.effects.strain.bouc_wen import BoucWen
from piezo_opt.effects.strain.creep import Creep
from piezo_opt.effects.strain.dahl import Dahl
from piezo_opt.effects.strain.duhem import Duhem
from piezo_opt.effects.strain.generalised_bouc_wen import GeneralisedBoucWen
from piezo_opt.effects.strain.maxwell_slip import MaxwellSlip
from piezo_opt.effects.strain.nonlinear_gain import NonlinearGain
from piezo_opt.effects.strain.piezo_gain import PiezoGain
from piezo_opt.effects.strain.prandtl_ishlinskii import PrandtlIshlinskii
from piezo_opt.effects.strain.preisach import Preisach
from piezo_opt.effects.strain.temperature import Temperature

__all__ = [
    "CATALOGUE",
    "AmplifierLag",
    "Asymmetry",
    "BoucWen",
    "Chain",
    "ChargeBackCoupling",
    "Creep",
    "CubicStiffness",
    "Dahl",
    "DeadZone",
    "Delay",
    "Drift",
    "Duhem",
    "Effect",
    "Equations",
    "Friction",
    "GeneralisedBoucWen",
    "HystereticForce",
    "Load",
    "LoadMass",
    "MainsPickup",
    "MaxwellSlip",
    "Model",
    "NonlinearDamping",
    "NonlinearGain",
    "Offset",
    "Parameter",
    "PiezoGain",
    "Place",
    "PrandtlIshlinskii",
    "Preisach",
    "RateDependence",
    "Saturation",
    "SecondMode",
    "SecondOrder",
    "SensorLag",
    "SensorNonlinearity",
    "Signal",
    "SlewLimit",
    "Spring",
    "State",
    "Temperature",
    "effect",
    "model_from_dict",
]
