"""What an effect is: a place in the chain, its states, its parameters, and one pure method.

The chain (DESIGN of the package)::

    command -- INPUT line [V] --> drive -- LOOP balance [m/s] --> hysteretic displacement
            -- STRAIN balance [m] --> free displacement -- MOTION balance [m/s2] --> position
            -- OUTPUT line [m] --> reading

On a *line* effects act one after another in the order written; on a *balance* contributions add
and their order cannot matter.
"""

from __future__ import annotations

from piezo_opt.effects.chain import Chain, Equations, Signal, Symbols
from piezo_opt.effects.declare import Parameter, Place, State
from piezo_opt.effects.effect import Effect

__all__ = ["Chain", "Effect", "Equations", "Parameter", "Place", "Signal", "State", "Symbols"]
