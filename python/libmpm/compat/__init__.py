"""Scenes of other programs: `claymore` reads those of ClaymoreUW and HydroUQ."""

from libmpm.compat import claymore

__all__ = ["claymore"]
