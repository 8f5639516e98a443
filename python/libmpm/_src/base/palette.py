"""The colours of all pictures; no matplotlib is needed to know them."""

from __future__ import annotations

__all__ = ["CYCLE", "FLUIDS", "LOAD_CELL", "OUTLINE", "SENSOR", "SOLIDS", "STRUCTURE"]

#: The colours of all pictures, which differ in print and for the colour-blind, after Okabe and Ito
#: (2008): those of lines, in order,
CYCLE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
#: of bodies of water and other fluids, of solids (the second four are the first, darker),
FLUIDS = ("#0072B2", "#56B4E9")
SOLIDS = ("#E69F00", "#CC79A7", "#F0E442", "#009E73", "#7F5800", "#7A3F62", "#8C8420", "#005F45")
#: of load cells, which no body has, of other sensors,
LOAD_CELL = "#D55E00"
SENSOR = "#000000"
#: and of structures: their faces, and their outlines where no legend says what they do.
STRUCTURE, OUTLINE = "#a6a6a6", "0.25"
