"""The catalogue: every effect by name, in the order of the chain.

The only list of effect names in the package. A user's own effect needs no entry: it is passed to
``+`` and to the diagnosis like any other.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from piezo_opt.effects.base import Effect
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
from piezo_opt.errors import InputError

CATALOGUE: Mapping[str, type[Effect]] = MappingProxyType(
    {
        kind().name: kind
        for kind in (
            # INPUT line
            Saturation,
            DeadZone,
            SlewLimit,
            AmplifierLag,
            ChargeBackCoupling,
            Delay,
            # LOOP balance
            Asymmetry,
            RateDependence,
            # STRAIN balance
            PiezoGain,
            NonlinearGain,
            BoucWen,
            GeneralisedBoucWen,
            Dahl,
            Duhem,
            PrandtlIshlinskii,
            MaxwellSlip,
            Preisach,
            Creep,
            Temperature,
            # MOTION balance
            SecondOrder,
            Spring,
            CubicStiffness,
            Friction,
            NonlinearDamping,
            HystereticForce,
            Load,
            LoadMass,
            # OUTPUT line
            SecondMode,
            SensorLag,
            SensorNonlinearity,
            Drift,
            MainsPickup,
            Offset,
        )
    }
)
"""Effect classes by snake_case name, in the order of the chain."""


def effect(name: str, **options: Any) -> Effect:
    """The effect of that name with its structural options: ``effect("creep", elements=4)``.

    Raises:
        InputError: no effect has that name, or it has no such option.
    """
    kind = CATALOGUE.get(name)
    if kind is None:
        having = [own for own, listed in CATALOGUE.items() if name in listed().options]
        if having:
            raise InputError(
                f"There is no effect '{name}': it is an option of {' and of '.join(having)}."
            )
        near = difflib.get_close_matches(name, CATALOGUE, n=3)
        if near:
            raise InputError(f"There is no effect '{name}': did you mean {' or '.join(near)}?")
        raise InputError(f"There is no effect '{name}': there are {', '.join(CATALOGUE)}.")
    known = kind().options
    for option in options:
        if option not in known:
            has = f"it has {', '.join(known)}" if known else "it has none"
            raise InputError(f"The effect {name} has no option '{option}': {has}.")
    return kind(**options)


def model_from_dict(data: Mapping[str, Any]) -> Model:
    """The model that ``Model.to_dict`` wrote: ``{"effects": [{"effect": name, **options}]}``.

    Raises:
        InputError: the data has another shape, or names an effect or option that does not exist.
        ModelError: the effects do not make a model.
    """
    entries = data.get("effects") if isinstance(data, Mapping) else None
    if not isinstance(entries, list):
        raise InputError('A model is {"effects": [{"effect": NAME}, ...]}: no list of effects.')
    effects: list[Effect] = []
    for position, entry in enumerate(entries, start=1):
        if not isinstance(entry, Mapping) or not isinstance(entry.get("effect"), str):
            raise InputError(f'Effect {position} of the model has no name: write "effect": NAME.')
        options = {str(key): value for key, value in entry.items() if key != "effect"}
        effects.append(effect(entry["effect"], **options))
    return Model.of(*effects)
