"""What every folder stands on: checked values, formulas, time tables, text tables."""
