"""Responses of boundaries: `Sticky`, `Slip`, `Separable`."""

from libmpm._src.boundaries import Response, Separable, Slip, Sticky

__all__ = ["Response", "Separable", "Slip", "Sticky"]
