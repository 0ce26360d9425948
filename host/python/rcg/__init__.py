"""Measured BRDFs: read, evaluate, export, measure.

Conventions. Directions are unit vectors away from the surface, the incident one too, in the sample frame: z is the normal, x the
sample's reference direction; polar angles θ count from z, azimuths φ from x towards y. ``f`` is the BRDF in 1/sr, without the cosine.
Standard uncertainties have k = 1. Where there is no value there is NaN, and a reason.

>>> import rcg
>>> brdf = rcg.Brdf("ward:brass")
>>> wi, wo = rcg.from_degrees(30, 0), rcg.from_degrees(30, 180)
>>> brdf.eval(wi, wo).shape
(3,)

Wrong input is a ``ValueError``, what the system refuses an ``OSError``, all else that fails a ``RuntimeError``; each says in one
sentence what was expected and what was found.
"""

from .brdf import Brdf, Reason
from .dataset import open
from .directions import from_degrees, to_degrees
from .files import export, fill, info
from .measurement import measure, plan
from .trigger_box import Flag, TriggerBox

__all__ = [
    "Brdf",
    "Flag",
    "Reason",
    "TriggerBox",
    "export",
    "fill",
    "from_degrees",
    "info",
    "measure",
    "open",
    "plan",
    "to_degrees",
]
