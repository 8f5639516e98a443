"""Laws of contact between bodies (`Scene.add_contact`): `Friction`, `Fluid` and `Stick`."""

from libmpm._src.boundaries.contact_laws import ContactLaw, Fluid, Friction, Stick

__all__ = ["ContactLaw", "Fluid", "Friction", "Stick"]
