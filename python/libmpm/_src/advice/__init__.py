"""Which settings to take: advice from measurements, trade-offs, reference cases."""
