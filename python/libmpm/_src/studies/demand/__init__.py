"""Demand of debris fields on structures: laws, expected loads, curves of exceedance."""
