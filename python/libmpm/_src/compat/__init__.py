"""Scenes of other programs: `claymore` reads those of ClaymoreUW and HydroUQ."""
